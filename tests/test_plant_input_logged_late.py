"""Proves that an input which was logged after its effect is a fault of the log, and that nothing else is taken for it.

The motor is the exact solution of ``v' = 20 u - 2 v`` between tenths of a sample. A time advance is held to five standard
deviations of its Cramér-Rao bound, 6e-7: the noise over the norm of the speed's slope. Seeds are fixed.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from click.testing import Result
from in_part import in_part
from numpy.typing import NDArray

from kfgen.effects.faults.samples import TooEarly
from kfgen.gap.plant.wiring import plant_scene
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
effects = [ { effect = "white_noise", N = "0.2 rad/s/sqrt(Hz)" } ]
"""
DT, N, NOISE, BEFORE = 0.01, 2000, 2.0, 20
FEW = 1e-3


def recorded(early: int, a: float = 2.0, drag: float = 0.0) -> tuple[Log, float]:
    """A log whose speed leads its input by tenths of a sample, and the bound of that time [s]."""
    rng = np.random.default_rng(54)
    u = np.repeat(rng.uniform(-6.0, 6.0, 60), 40)
    v, out = 0.0, []
    for acting in np.repeat(u, 10):
        out.append(v)
        rate = a + drag * abs(v)
        v = 20.0 * acting / rate + (v - 20.0 * acting / rate) * np.exp(-rate * FEW)
    fine = np.array(out)[10 * BEFORE :]
    clean = fine[early:][::10][:N]
    sd = NOISE / float(np.linalg.norm(np.gradient(clean, DT)))
    t, u = np.arange(N) * DT, u[BEFORE : BEFORE + N]
    speed = Channel(clean + NOISE * rng.standard_normal(N), "rad/s")
    return Log(t, {"u": Channel(u, "V"), "speed": speed}, "log"), sd


@pytest.mark.parametrize(
    "early",
    in_part([pytest.param(15, marks=pytest.mark.long), 30, pytest.param(100, marks=pytest.mark.long), 300]),
)
def test_a_time_advance_is_named(early: int) -> None:
    log, sd = recorded(early)
    (fault,) = plant_scene(parse_model(MOTOR, "motor.toml"), log).spoilt
    assert isinstance(fault.effect, TooEarly)
    assert fault.where == "u"
    assert abs(fault.effect.shift - early * FEW) < 5.0 * sd < 0.005


@pytest.mark.parametrize(
    ("a", "drag"),
    in_part(
        [
            (2.0, 0.0),
            (2.02, 0.0),
            (3.0, 0.0),
            pytest.param(6.0, 0.0, marks=pytest.mark.long),
            (1.0, 0.0),
            (1.5, 0.05),
        ]
    ),
)
def test_what_makes_a_plant_quicker_or_slower_is_no_time_advance(a: float, drag: float) -> None:
    assert not plant_scene(parse_model(MOTOR, "motor.toml"), recorded(0, a, drag)[0]).spoilt


@pytest.mark.long
def test_the_command_says_so(kfgen: Cli, tmp_path: Path) -> None:
    log, _ = recorded(30)
    path, model, out = tmp_path / "log.csv", tmp_path / "model.toml", tmp_path / "out.json"
    table = np.column_stack([log.t, log.values("u"), log.values("speed")])
    np.savetxt(path, table, delimiter=",", header="t [s],u [V],speed [rad/s]", comments="", fmt="%.12g")
    model.write_text(MOTOR, encoding="utf-8")
    done = kfgen("gap", path, "--model", model, "--json", out)
    assert done.exit_code == 0, done.output
    answer = json.loads(out.read_text(encoding="utf-8"))
    assert answer["verdict"] == "bad_data"
    assert [(s["effect"], s["channel"]) for s in answer["steps"]] == [("too_early", "u")]
