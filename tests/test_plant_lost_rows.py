"""Proves that rows which a log of a plant has lost are no gap: what its inputs did meanwhile is unknown, and is said to be.

The expected motion is the closed solution of ``m q'' = u - k q - c q'`` under held inputs. Seeds are fixed; a sound log is
falsely alarmed at 0.2 % by the battery.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from driven_cart import N, cart, gap_of
from in_part import in_part
from numpy.typing import NDArray

from kfgen.gap.plant.hole_responses import Responses
from kfgen.gap.plant.lost_rows import Disturbed, LostRows
from kfgen.gap.plant.words import of_lost_rows

Array = NDArray[np.float64]


def lost_at_random(rng: np.random.Generator) -> NDArray[np.bool_]:
    kept = rng.random(N) > 0.1
    kept[0] = True
    return kept


@pytest.mark.long
@pytest.mark.parametrize("seed", [1, *(pytest.param(s, marks=pytest.mark.long) for s in (2, 3))])
def test_a_tenth_of_the_rows_lost_at_random(tmp_path: Path, seed: int) -> None:
    rng = np.random.default_rng([176117, seed])
    found = gap_of(tmp_path, *cart(rng), lost_at_random(rng))
    assert found.verdict == "no_gap"
    assert any("rows of the log are lost" in w and "counts as unknown" in w for w in found.warnings)


@pytest.mark.parametrize("length", in_part([12, pytest.param(60, marks=pytest.mark.long), 400]))
def test_a_long_hole(tmp_path: Path, length: int) -> None:
    rng = np.random.default_rng([176118, length])
    kept = np.ones(N, bool)
    kept[900 : 900 + length] = False
    found = gap_of(tmp_path, *cart(rng), kept)
    assert found.verdict == "no_gap"
    assert any(f"{length} rows of the log are lost" in w for w in found.warnings)


@pytest.mark.long
def test_what_is_hidden_beside_lost_rows_is_found(tmp_path: Path) -> None:
    rng = np.random.default_rng(176119)
    found = gap_of(tmp_path, *cart(rng, damping=1.15), lost_at_random(rng))
    assert [f.name for f in found.findings] in (["viscous_friction"], ["parameter_error"])
    assert all(f.where in ("v", "c") for f in found.findings)


def test_a_log_without_losses_says_nothing(tmp_path: Path) -> None:
    found = gap_of(tmp_path, *cart(np.random.default_rng(176120)), np.ones(N, bool))
    assert found.verdict == "no_gap"
    assert not found.warnings


def test_uneven_times_are_no_losses() -> None:
    rng = np.random.default_rng(5)
    t = np.cumsum(rng.exponential(0.02, 1000))
    assert LostRows.of(t).before.size == 0


def test_holes_by_their_times() -> None:
    t = np.delete(np.arange(200) * 0.02, [50, 90, 91, *range(120, 140)])
    lost = LostRows.of(t)
    assert lost.before.tolist() == [49, 88, 116]
    np.testing.assert_allclose(lost.steps, [2.0, 3.0, 21.0])
    assert lost.is_long.tolist() == [False, False, True]
    assert lost.anew(t.size) == (117,)
    assert lost.clock(t)[-1] == pytest.approx(t[-1] - (21.0 - 3.5) * 0.02)
    assert of_lost_rows(lost, t) == [
        "23 rows of the log are lost, the longest hole lasts 0.42 s from 2.38 s on: what the inputs did there and where "
        "the plant is after the long ones counts as unknown. Log without losses where small effects matter"
    ]
    only = lost.moving({"u": np.where(np.arange(t.size) < 60, 0.0, 1.0)})
    assert only.before.tolist() == [116]


def test_integrated_deviates_leave_the_likelihood() -> None:
    rng = np.random.default_rng(7)
    E, x = rng.standard_normal((40, 3)), rng.standard_normal((40, 2))
    C = np.eye(40) + E @ E.T
    left = Disturbed(E).without(x)
    np.testing.assert_allclose((left**2).sum(axis=0), np.einsum("ij,ij->j", x, np.linalg.solve(C, x)))
    assert Disturbed(E).spread == pytest.approx(0.5 * np.linalg.slogdet(C)[1])


def test_moves_pass_from_hole_to_hole_until_the_plant_starts_anew() -> None:
    # One state that decays by a half each sample, seen as it is: a move of 1 at sample 2, none after sample 6.
    decay = 0.5 ** np.array([0, 1, 0, 1, 0, 1, 0, 1])
    there = Responses(
        [0, 2, 4, 6], decay.reshape(1, 8, 1), np.array([0.25, 0.25, 0.0, 0.25]).reshape(4, 1, 1)
    )
    out = there.columns({2: np.ones((1, 1))})
    np.testing.assert_allclose(out[0, :, 0], [0, 0, 1, 0.5, 0.25, 0.125, 0, 0])
