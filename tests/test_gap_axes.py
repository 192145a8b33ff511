"""Wrong signs, exchanged axes and wrong units of a triad, seen against its reference; a contradicted rate."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from click.testing import Result
from in_part import in_part

from kfgen.effects import make
from kfgen.effects.noise_model import ChannelNoise, NoiseModel, Term
from kfgen.gap.motion.motion_scene import motion_scene
from kfgen.gap.scene.scene_gap import SceneGap, scene_gap
from kfgen.log.log import Channel, Log

N, DT = 1e-4, 0.01


def truth(n: int = 3000) -> np.ndarray:
    """Body rates of three axes that move on their own [rad/s], shape (n, 3)."""
    t = np.arange(n) * DT
    return np.array([np.sin(2 * np.pi * f * t + k) for k, f in enumerate((0.11, 0.17, 0.31))]).T


def gap_of(y: np.ndarray, seed: int = 0) -> SceneGap:
    """The gap of a triad of gyros that reads `y` and some noise."""
    rng, x = np.random.default_rng(seed), truth()
    read = y + N / np.sqrt(DT) * rng.standard_normal(y.shape)
    channels = {f"gyro_{a}": Channel(read[:, k], "rad/s") for k, a in enumerate("xyz")}
    channels |= {f"ref_gyro_{a}": Channel(x[:, k], "rad/s") for k, a in enumerate("xyz")}
    noise = ChannelNoise("rad/s", (Term(make("white_noise", N=N)),))
    log = Log(np.arange(x.shape[0]) * DT, channels)
    scene = motion_scene(log, NoiseModel({f"gyro_{a}": noise for a in "xyz"}))
    assert scene is not None
    return scene_gap(scene)


def names(gap: SceneGap) -> set[tuple[str, str]]:
    """Effects and places."""
    return {(f.effect.name, f.where) for f in gap.findings}


def test_an_axis_that_is_turned_round() -> None:
    gap = gap_of(truth() * [1.0, -1.0, 1.0])
    assert gap.verdict == "bad_data"
    assert names(gap) == {("sign_error", "gyro_y")}


def test_two_axes_that_are_exchanged() -> None:
    gap = gap_of(truth()[:, [1, 0, 2]])
    assert gap.verdict == "bad_data"
    assert names(gap) == {("axis_swap", "gyro_x"), ("axis_swap", "gyro_y")}


def test_degrees_for_radians() -> None:
    gap = gap_of(truth() * np.degrees(1.0))
    assert gap.verdict == "bad_data"
    assert names(gap) == {("unit_error", f"gyro_{a}") for a in "xyz"}
    factor = gap.findings[0].effect
    assert float(factor.factor) == pytest.approx(180.0 / np.pi)  # type: ignore[attr-defined]


@pytest.mark.parametrize("coefficient", in_part([0.8, 1.2]))
def test_a_scale_factor_is_no_fault(coefficient: float) -> None:
    gap = gap_of(truth() * [coefficient, 1.0, 1.0])
    assert gap.verdict != "bad_data"
    assert ("scale_factor", "gyro_x") in names(gap)


def test_a_header_that_contradicts_itself(tmp_path: Path, kfgen: Callable[..., Result]) -> None:
    """55.6 Hz by its samples, 50 Hz by its header: named, with the factor."""
    rng = np.random.default_rng(1)
    n, rate, lasted = 5560, 50.0, 100.0
    lines = [f"Fs,{rate}", f"Logging time,{lasted}", "a [m]"]
    (tmp_path / "log.csv").write_text("\n".join([*lines, *map(str, rng.standard_normal(n))]) + "\n")
    noise = 'format = "kfgen-noise-1"\n[a]\nunit = "m"\neffects = [{ effect = "white_noise", N = "0.1414 m/sqrt(Hz)" }]\n'
    (tmp_path / "noise.toml").write_text(noise)
    paths = [str(tmp_path / name) for name in ("log.csv", "noise.toml", "gap.json")]
    done = kfgen("gap", paths[0], "--model", paths[1], "--json", paths[2])
    assert done.exit_code == 0, done.output
    (step,) = json.loads((tmp_path / "gap.json").read_text())["steps"]
    assert step["effect"] == "sample_rate_error"
    assert step["parameters"]["factor"]["value"] == pytest.approx(n / rate / lasted)
