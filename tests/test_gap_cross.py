"""Proves that noise which two channels share is named once, with its correlation, and kept in both models.

Two channels of plain numpy normal samples of a known correlation. A correlation of 0.12 in 4096 samples is worth about 30 nats; it is held to
2.5 half-widths of its 95 % interval (1e-6). Without one, a Bayes factor exceeds e^x in at most e^-x of the records: with the
cost of the candidates subtracted, e^-1.5 and less in 30 pairs is at most a tenth of one. Seeds are fixed.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from kfgen.effects import make
from kfgen.effects.noise_model import ChannelNoise, NoiseModel, Term, read_noise, write_noise
from kfgen.gap.rest.channel_gap import channel_gap
from kfgen.gap.rest.comparison import ChannelGap
from kfgen.gap.rest.cross_axis import with_pairs
from kfgen.identify.evidence.record import Record

Array = NDArray[np.float64]

N, DT = 4096, 0.1
T = np.arange(N) * DT
ASSUMED = ChannelNoise("rad/s", (Term(make("white_noise", N=np.sqrt(DT))),))


def pair(rho: float, seed: int) -> Array:
    L = np.linalg.cholesky(np.array([[1.0, rho], [rho, 1.0]]))
    return L @ np.random.default_rng([seed, 61]).standard_normal((2, N))


@pytest.fixture(scope="module")
def quiet() -> ChannelGap:
    """The answer for one channel without a gap, to be given other white series."""
    gap = channel_gap("gyro_x", Record(T, pair(0.0, 1)[0]), ASSUMED)
    assert gap.verdict == "no_gap"
    return gap


def answers(quiet: ChannelGap, series: Array) -> dict[str, ChannelGap]:
    return {f"gyro_{a}": replace(quiet, channels=(f"gyro_{a}",), white=x) for a, x in zip("xyz", series)}


@pytest.mark.parametrize("rho", [0.12, -0.12, 0.6])
def test_shared_noise_is_named_once(rho: float) -> None:
    """Through the whole workflow: what it leaves of two channels correlates as they do."""
    gaps = {f"gyro_{a}": channel_gap(f"gyro_{a}", Record(T, y), ASSUMED) for a, y in zip("xy", pair(rho, 2))}
    assert [g.verdict for g in gaps.values()] == ["no_gap", "no_gap"]
    out = with_pairs(gaps)
    (found,) = out["gyro_x"].findings
    assert found.effect.name == "cross_axis_noise"
    lo, hi = found.ci95["rho"]
    assert abs(rho - 0.5 * (lo + hi)) < 2.5 * 0.5 * (hi - lo)
    # Fisher's standard deviation, of the 95 % of the ordinates that are compared
    assert 0.5 * (hi - lo) == pytest.approx(1.96 * (1 - rho**2) / np.sqrt(N), rel=0.1)
    assert found.probability > 0.99
    assert out["gyro_x"].verdict == "effects_found"
    assert (out["gyro_y"].verdict, out["gyro_y"].findings) == ("no_gap", ())
    for g in out.values():
        assert [e.name for e in g.updated.effects] == ["white_noise", "cross_axis_noise"]


def test_beside_misfit_shared_noise_is_not_certain(quiet: ChannelGap) -> None:
    """A table that shakes all axes was noise that they share at more than 99.9 %."""
    gaps = answers(quiet, pair(0.6, 2))
    gaps["gyro_x"] = replace(gaps["gyro_x"], verdict="unknown_effect")
    out = with_pairs(gaps)["gyro_x"]
    assert out.verdict == "unknown_effect"
    assert [f.probability for f in out.findings] == [0.9]


def test_only_the_pair_that_shares_is_named(quiet: ChannelGap) -> None:
    x, y = pair(0.3, 3)
    out = with_pairs(answers(quiet, np.array([x, pair(0.0, 4)[0], y])))
    assert [len(g.findings) for g in out.values()] == [1, 0, 0]
    assert [len(g.updated.terms) for g in out.values()] == [2, 1, 2]


def test_independent_channels_share_nothing(quiet: ChannelGap) -> None:
    for seed in range(10):
        series = np.random.default_rng([seed, 62]).standard_normal((3, N))
        out = with_pairs(answers(quiet, series))
        assert all(g.findings == () and g.verdict == "no_gap" for g in out.values()), seed


def test_channels_of_other_lengths_are_not_compared(quiet: ChannelGap) -> None:
    x, y = pair(0.9, 5)
    gaps = answers(quiet, np.array([x, y]))
    gaps["gyro_y"] = replace(gaps["gyro_y"], white=y[:-1])
    assert with_pairs(gaps) == gaps


def test_what_is_assumed_is_not_said_again_and_goes_through_a_file(quiet: ChannelGap, tmp_path) -> None:  # type: ignore[no-untyped-def]
    out = with_pairs(answers(quiet, pair(0.3, 6)))
    write_noise(NoiseModel({n: g.updated for n, g in out.items()}), tmp_path / "n.toml")
    back = read_noise(tmp_path / "n.toml")
    again = {
        n: channel_gap(n, Record(T, y), back.channel(n)) for n, y in zip(("gyro_x", "gyro_y"), pair(0.3, 6))
    }
    assert all(g.findings == () for g in with_pairs(again).values())
