"""Proves that an output of a plant that is slower than its log is compared by the values that its sensor gave.

Seeds are fixed; a sound log is falsely alarmed at 0.2 % by the battery.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from click.testing import Result
from driven_cart import CART, RATE, SIGMA, N, cart, driven, gap_of
from in_part import in_part

import kfgen as kf
from kfgen.gap.plant.wiring import plant_scene
from kfgen.log.log import Channel
from kfgen.model.plant.user import read_model

Cli = Callable[..., Result]


@pytest.mark.parametrize("rows", in_part([2, 3, 5]))
def test_an_output_that_is_held(tmp_path: Path, rows: int) -> None:
    u, seen = cart(np.random.default_rng([176125, rows]))
    found = gap_of(tmp_path, u, seen[np.arange(N) // rows * rows], rate=RATE / rows)
    assert (found.verdict, found.findings) == ("no_gap", ())
    assert any(
        "q_seen: its sensor is slower than the log, which holds each value" in w for w in found.warnings
    )


@pytest.mark.parametrize("rows", in_part([2, 4]))
def test_an_output_that_was_interpolated(tmp_path: Path, rows: int) -> None:
    u, seen = cart(np.random.default_rng([176126, rows]))
    at = np.arange(0, N, rows)
    found = gap_of(tmp_path, u, np.interp(np.arange(N), at, seen[at]), rate=RATE / rows)
    assert (found.verdict, found.findings) == ("no_gap", ())
    assert any("which draws straight lines from value to value" in w for w in found.warnings)


@pytest.mark.long
def test_what_is_hidden_behind_a_held_output_is_found(tmp_path: Path) -> None:
    u, seen = cart(np.random.default_rng(176127), damping=1.3)
    found = gap_of(tmp_path, u, seen[np.arange(N) // 3 * 3], rate=RATE / 3)
    assert [f.where for f in found.findings] in (["v"], ["c"])


@pytest.mark.long
def test_heavy_tails_are_said(kfgen: Cli, tmp_path: Path) -> None:
    rng = np.random.default_rng(176128)
    u, place = driven(rng)
    found = gap_of(tmp_path, u, place + SIGMA * rng.standard_t(3.5, N) / np.sqrt(3.5 / 1.5))
    assert (found.verdict, found.findings) == ("unknown_effect", ())
    said = kfgen("gap", tmp_path / "log.csv", "--model", tmp_path / "cart.toml").output
    assert "What is left of q_seen: more large values than Gaussian noise has (excess kurtosis " in said


@pytest.mark.long
def test_coloured_noise_is_said(kfgen: Cli, tmp_path: Path) -> None:
    rng = np.random.default_rng(176129)
    u, place = driven(rng)
    w = rng.standard_normal(N + 1)
    found = gap_of(tmp_path, u, place + SIGMA * (w[1:] + w[:-1]) / np.sqrt(2.0))
    assert (found.verdict, found.findings) == ("unknown_effect", ())
    said = kfgen("gap", tmp_path / "log.csv", "--model", tmp_path / "cart.toml").output
    assert "What is left of q_seen: " in said
    assert " times the power of its noise in " in said


@pytest.mark.long
def test_nothing_is_left_of_a_sound_log(kfgen: Cli, tmp_path: Path) -> None:
    assert gap_of(tmp_path, *cart(np.random.default_rng(176130))).verdict == "no_gap"
    assert "What is left" not in kfgen("gap", tmp_path / "log.csv", "--model", tmp_path / "cart.toml").output


@pytest.mark.parametrize("rows", [1, 4])
def test_noise_may_be_given_of_a_sample(tmp_path: Path, rows: int) -> None:
    """Its standard deviation is that of the samples that the sensor has, however fast the log, and in the filter."""
    model = tmp_path / "cart.toml"
    text = CART.replace('N = "NOISE m/sqrt(Hz)"', f'sd = "{SIGMA} m"')
    model.write_text(text.replace("k = ", "stiffness = ").replace("k*q", "stiffness*q"), encoding="utf-8")
    u, seen = cart(np.random.default_rng([176142, rows]))
    seen[np.arange(N) % rows != 0] = np.nan
    log = kf.Log(np.arange(N) / RATE, {"u": Channel(u, "N"), "q_seen": Channel(seen, "m")}, "log")
    scene = plant_scene(read_model(str(model)), log)
    assert scene.recorded["q_seen"].noise == pytest.approx(SIGMA, rel=1e-6)
    expected = kf.run(model, log).sensors["q_seen"].deviation
    assert expected is not None
    assert expected[0] == pytest.approx(np.hypot(SIGMA, 0.01), rel=1e-6)  # beside the place at the start
