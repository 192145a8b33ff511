"""Proves that the command finds the gap of a plant and of a rate table, and that its updated model has none any more.

Motions are integrated and sensors made in plain numpy. What is hidden is worth over 100 nats; its number is held to
2.5 half-widths of its 95 % interval (1e-6). A sound log is falsely alarmed at 0.2 % by the battery. Seeds are fixed.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import Result
from in_part import in_part
from numpy.typing import NDArray

from kfgen.effects.noise_model import read_noise
from kfgen.model.plant.user import read_model

Array = NDArray[np.float64]
Cli = Callable[..., Result]

PENDULUM = """format = "kfgen-model-1"
name = "pendulum"
[parameters]
g_over_l = "19.6 1/s^2"
[states]
omega = "rad/s"
theta = "rad"
[inputs]
u = "rad/s^2"
[dynamics]
theta = "omega"
omega = "-g_over_l*sin(theta) + u"
[measurements.angle]
unit = "deg"
expression = "theta"
effects = [ { effect = "white_noise", N = "0.02 deg/sqrt(Hz)" } ]
"""


def swing(friction: float, t: Array, u: Array) -> Array:
    """The angle [rad] by Runge and Kutta's fourth order, ten steps a sample, the input held."""

    def f(x: Array, push: float) -> Array:
        return np.array([-19.6 * np.sin(x[1]) - friction * x[0] + push, x[0]])

    x, out, h = np.array([0.0, 0.4]), np.empty(t.size), (t[1] - t[0]) / 10
    for k in range(t.size):
        out[k] = x[1]
        for _ in range(10):
            a = f(x, u[k])
            b = f(x + 0.5 * h * a, u[k])
            c = f(x + 0.5 * h * b, u[k])
            d = f(x + h * c, u[k])
            x = x + h / 6 * (a + 2 * b + 2 * c + d)
    return out


def asked(kfgen: Cli, log: Path, model: Path, improved: Path | None = None) -> dict[str, Any]:
    out = log.with_suffix(".json")
    more = ["-o", improved] if improved else []
    done = kfgen("gap", log, "--model", model, "--json", out, *more)
    assert done.exit_code == 0, done.output
    answer: dict[str, Any] = json.loads(out.read_text(encoding="utf-8"))
    return answer


@pytest.fixture
def plant(tmp_path: Path) -> Callable[[float], tuple[Path, Path]]:
    def make(friction: float) -> tuple[Path, Path]:
        t = np.arange(1500) * 0.02
        u = 3.0 * np.sign(np.sin(2.1 * t)) * np.cos(0.37 * t)
        noise = 0.02 / np.sqrt(0.02) * np.random.default_rng(1).standard_normal(t.size)
        angle = np.rad2deg(swing(friction, t, u)) + noise
        table = np.column_stack([t, u, angle])
        path = tmp_path / "log.csv"
        np.savetxt(
            path, table, delimiter=",", header="t [s],u [rad/s^2],angle [deg]", comments="", fmt="%.12g"
        )
        (tmp_path / "model.toml").write_text(PENDULUM, encoding="utf-8")
        return path, tmp_path / "model.toml"

    return make


@pytest.mark.long
def test_a_plant_that_lacks_friction(plant: Any, kfgen: Cli, tmp_path: Path) -> None:
    log, model = plant(0.3)
    answer = asked(kfgen, log, model, tmp_path / "improved.toml")
    assert answer["format"] == "kfgen-gap-1"
    assert answer["verdict"] == "effects_found"
    (step,) = answer["steps"]
    assert (step["effect"], step["channel"]) == ("viscous_friction", "omega")
    assert step["parameters"]["coefficient"]["unit"] == "1/s"
    lo, hi = step["parameters"]["coefficient"]["ci95"]
    assert abs(0.3 - 0.5 * (lo + hi)) < 2.5 * 0.5 * (hi - lo)
    assert 0.29 < lo < hi < 0.31
    assert answer["remaining"]["significant"] is False
    assert answer["gap"]["after"] < 0.1 * answer["gap"]["before"]
    updated = read_model(str(tmp_path / "improved.toml"))
    assert set(updated.states) == {"omega", "theta"}
    again = asked(kfgen, log, tmp_path / "improved.toml")
    assert (again["verdict"], again["steps"]) == ("no_gap", [])


def test_a_plant_that_lacks_nothing(plant: Any, kfgen: Cli, tmp_path: Path) -> None:
    """The updated model is the model."""
    log, model = plant(0.0)
    answer = asked(kfgen, log, model, tmp_path / "improved.toml")
    assert (answer["verdict"], answer["steps"]) == ("no_gap", [])
    assert read_model(str(tmp_path / "improved.toml")).parameters == read_model(str(model)).parameters


@pytest.mark.parametrize("term", in_part(["omega**3", "sqrt(-1 - theta**2)", "u/0"]))
def test_a_simulation_that_is_no_number_is_named(plant: Any, kfgen: Cli, term: str) -> None:
    """A blow-up within a swing, a root of what is negative, a division by zero: never an effect instead."""
    log, model = plant(0.0)
    model.write_text(PENDULUM.replace("+ u", f"+ u + 50*{term}"), encoding="utf-8")
    done = kfgen("gap", log, "--model", model)
    said = str(done.exception)
    assert ("the simulation of pendulum" in said and " at t = " in said) or "a division by zero" in said


@pytest.fixture
def table(tmp_path: Path) -> Callable[[float], tuple[Path, Path]]:
    def make(error: float) -> tuple[Path, Path]:
        t, rng = np.arange(3000) * 0.01, np.random.default_rng(2)
        columns, names = [t], ["t [s]"]
        for k, a in enumerate("xyz"):
            w = 60.0 * np.sin((1.0 + 0.3 * k) * t + k) + 20.0 * np.cos((4.0 + 1.1 * k) * t)
            read = w * (1.0 + error * (a == "y")) + 0.3 + 0.01 / np.sqrt(0.01) * rng.standard_normal(t.size)
            columns += [w, read]
            names += [f"ref_gyro_{a} [deg/s]", f"gyro_{a} [deg/s]"]
        path = tmp_path / "log.csv"
        np.savetxt(
            path, np.column_stack(columns), delimiter=",", header=",".join(names), comments="", fmt="%.12g"
        )
        lines = ['format = "kfgen-noise-1"']
        for a in "xyz":
            lines += [f"[gyro_{a}]", 'unit = "deg/s"']
            lines += ['effects = [{effect = "white_noise", N = "0.01 deg/s/sqrt(Hz)"}]']
        (tmp_path / "noise.toml").write_text("\n".join(lines) + "\n", encoding="utf-8")
        return path, tmp_path / "noise.toml"

    return make


def test_a_gyro_on_a_rate_table_that_reads_too_much(table: Any, kfgen: Cli, tmp_path: Path) -> None:
    log, model = table(0.002)
    answer = asked(kfgen, log, model, tmp_path / "improved.toml")
    assert answer["verdict"] == "effects_found"
    (step,) = answer["steps"]
    assert (step["effect"], step["channel"]) == ("scale_factor", "gyro_y")
    lo, hi = step["parameters"]["coefficient"]["ci95"]
    assert abs(0.002 - 0.5 * (lo + hi)) < 2.5 * 0.5 * (hi - lo)
    found = read_noise(tmp_path / "improved.toml").channel("gyro_y").effects
    assert [e.name for e in found] == ["white_noise", "scale_factor"]
    again = asked(kfgen, log, tmp_path / "improved.toml")
    assert (again["verdict"], again["steps"]) == ("no_gap", [])


def test_a_gyro_on_a_rate_table_that_is_right(table: Any, kfgen: Cli) -> None:
    """Its bias is no effect that is missing; what would not have been seen is said once."""
    answer = asked(kfgen, *table(0.0))
    said = [(m["effect"], m["channel"], m["parameter"]) for m in answer["limits"]]
    assert len(said) == len(set(said)) > 10
    assert (answer["verdict"], answer["steps"]) == ("no_gap", [])
