"""Proves that a dead zone of an actuator is named, and that of an input of one size it is a wrong gain and not offered.

The motor is the exact solution of ``v' = 20 acting - 2 v``. The width is held to 2.5 half-widths of its 95 % interval
(1e-6); the seed is fixed. A sound log is falsely alarmed at 0.2 % by the battery.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from click.testing import Result
from numpy.typing import NDArray

from kfgen.gap.plant.scene import PlantScene
from kfgen.log.log import Channel, Log
from kfgen.model.plant.file import parse_model

Array = NDArray[np.float64]
Cli = Callable[..., Result]
MOTOR = """format = "kfgen-model-1"
name = "motor"
[parameters]
a = "2.0 1/s"
b = "20.0 rad/s^2/V"
[states]
omega = "rad/s"
[inputs]
u = "V"
[dynamics]
omega = "b*u - a*omega"
[measurements.speed]
unit = "rad/s"
expression = "omega"
effects = [ { effect = "white_noise", N = "0.1 rad/s/sqrt(Hz)" } ]
"""


def turned(u: Array, width: float, seed: int) -> Array:
    """The noisy speed at the samples, 10 ms apart."""
    v, out = 0.0, []
    for sent in u.tolist():
        out.append(v)
        acting = np.sign(sent) * max(abs(sent) - width, 0.0)
        v = 10.0 * acting + (v - 10.0 * acting) * np.exp(-0.02)
    return np.array(out) + np.random.default_rng(seed).standard_normal(u.size)


@pytest.mark.long
@pytest.mark.parametrize("width", [pytest.param(0.1, marks=pytest.mark.long), 0.4])
def test_a_dead_zone_is_named(width: float, kfgen: Cli, tmp_path: Path) -> None:
    u = np.repeat(np.random.default_rng(50).uniform(-5.0, 5.0, 50), 50)
    path, model, out = tmp_path / "log.csv", tmp_path / "model.toml", tmp_path / "out.json"
    table = np.column_stack([np.arange(u.size) * 0.01, u, turned(u, width, 51)])
    np.savetxt(path, table, delimiter=",", header="t [s],u [V],speed [rad/s]", comments="", fmt="%.12g")
    model.write_text(MOTOR, encoding="utf-8")
    updated = tmp_path / "updated.toml"
    done = kfgen("gap", path, "--model", model, "--json", out, "-o", updated)
    assert done.exit_code == 0, done.output
    (step,) = json.loads(out.read_text(encoding="utf-8"))["steps"]
    assert step["effect"] == "input_dead_zone"
    lo, hi = step["parameters"]["width"]["ci95"]
    assert abs(width - 0.5 * (lo + hi)) < 2.5 * 0.5 * (hi - lo) < 0.2 * width
    again = kfgen("gap", path, "--model", updated, "--json", out)
    assert again.exit_code == 0, again.output
    assert not json.loads(out.read_text(encoding="utf-8"))["steps"]


@pytest.mark.parametrize(
    ("sizes", "offered"),
    [
        ([0.0, 1.0], False),
        ([-3.0, 3.0], False),
        ([1.0, -2.0], True),
        ([1.0, 2.0], False),
        ([0.0, 1.0, 2.0], True),
    ],
)
def test_an_input_of_one_size_or_of_one_sign_has_none(sizes: list[float], offered: bool) -> None:
    u = np.repeat(np.random.default_rng(2).choice(sizes, 20), 30)
    speed = Channel(turned(u, 0.0, 3), "rad/s")
    log = Log(np.arange(u.size) * 0.01, {"u": Channel(u, "V"), "speed": speed}, "log")
    scene = PlantScene.of(parse_model(MOTOR, "motor.toml"), log)
    assert ("input_dead_zone" in {c[0].effect.name for c in scene.candidates([])}) == offered
