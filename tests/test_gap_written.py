"""Proves that numbers of a model file which the data contradict are said, and those that chance explains are not.

A mass on a spring is simulated exactly (its step response in closed form, piece by piece); half-widths are those of 95 %.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import Result
from numpy.typing import NDArray
from scipy.linalg import expm

from kfgen.model.plant.user import read_model

Array = NDArray[np.float64]
Cli = Callable[..., Result]
Asked = Callable[..., dict[str, Any]]

MODEL = """format = "kfgen-model-1"
name = "cart"
[parameters]
m = "2 kg"
k = {{ value = "150 N/m", sd = "{sd:g} N/m" }}
c = "1.5 N s/m"
[states]
x = {{ unit = "m", initial = "0 m", sd = "2 mm" }}
v = "m/s"
[inputs]
force = "N"
[dynamics]
x = "v"
v = "(force - k*x - c*v)/m"
[measurements.pos]
unit = "mm"
expression = "x"
effects = [ {{ effect = "white_noise", N = "0.08 mm/sqrt(Hz)" }} ]
"""


def position(k: float, x0: float, force: Array, more: float) -> Array:
    """Of 2 kg on a spring of k [N/m] with 1.5 N s/m and more, the force held for 0.01 s each."""
    A = np.array([[0.0, 1.0, 0.0], [-k / 2.0, -0.75 - more / 2.0, 0.5], [0.0, 0.0, 0.0]])
    Phi = expm(0.01 * A)
    x, out = np.array([x0, 0.0]), np.empty(force.size)
    for i, u in enumerate(force):
        out[i] = x[0]
        x = (Phi @ [*x, u])[:2]
    return out


@pytest.fixture
def asked(kfgen: Cli, tmp_path: Path) -> Asked:
    def ask(k: float, x0: float = 0.0, sd: float = 1.0, more: float = 0.0) -> dict[str, Any]:
        t, rng = np.arange(2500) * 0.01, np.random.default_rng(4)
        force = np.repeat(rng.uniform(-15.0, 15.0, 20), 125)
        y = 1e3 * position(k, x0, force, more) + 0.8 * rng.standard_normal(t.size)
        header = "t [s],force [N],pos [mm]"
        path, model, out = tmp_path / "log.csv", tmp_path / "model.toml", tmp_path / "out.json"
        np.savetxt(
            path, np.column_stack([t, force, y]), delimiter=",", header=header, comments="", fmt="%.12g"
        )
        model.write_text(MODEL.format(sd=sd), encoding="utf-8")
        done = kfgen("gap", path, "--model", model, "--json", out, "-o", tmp_path / "improved.toml")
        assert done.exit_code == 0, done.output
        found: dict[str, Any] = json.loads(out.read_text(encoding="utf-8"))
        return found

    return ask


@pytest.mark.long
def test_an_assumed_number_that_is_wrong(asked: Asked, tmp_path: Path) -> None:
    """Four standard deviations and a half away: the gap is that of the file as it is written."""
    answer = asked(154.5)
    assert answer["verdict"] == "effects_found"
    (step,) = answer["steps"]
    assert (step["effect"], step["channel"]) == ("parameter_error", "k")
    assert step["indistinguishable"] == ["spring"]
    found = step["parameters"]["k"]
    half = 0.5 * (found["ci95"][1] - found["ci95"][0])
    assert abs(found["value"] - 154.5) < 2.5 * half < 0.2
    assert found["off_by"] == pytest.approx(found["value"] - 150.0)
    assert (found["believed"], found["unit"]) == (150.0, "N/m")
    assert "k is 154.5 N/m instead of 150 N/m, off by 4.5" in step["sentence"]
    assert answer["gap"]["before"] > 1.0
    assert answer["gap"]["after"] < 0.02
    assert answer["rms_in_deviations"]["pos"]["before"] > 3.0
    assert read_model(tmp_path / "improved.toml").parameters["k"].value == pytest.approx(found["value"])


def test_a_number_within_its_deviation_is_no_gap(asked: Asked) -> None:
    answer = asked(150.8)
    assert (answer["verdict"], answer["steps"]) == ("no_gap", [])
    assert answer["unknowns"]["k"]["value"] == pytest.approx(150.8, abs=0.1)


@pytest.mark.long
def test_a_state_that_starts_elsewhere(asked: Asked, tmp_path: Path) -> None:
    """Fifty millimetres from where it is assumed to start within two."""
    answer = asked(150.0, x0=0.05)
    (step,) = answer["steps"]
    assert (step["effect"], step["channel"]) == ("parameter_error", "x")
    assert step["sentence"].startswith("x starts at 0.0")
    found = step["parameters"]["x"]
    assert abs(found["value"] - 0.05) < 2.5 * 0.5 * (found["ci95"][1] - found["ci95"][0])
    assert read_model(tmp_path / "improved.toml").states["x"].initial == pytest.approx(found["value"])


def test_a_state_that_starts_within_its_deviation_is_no_gap(asked: Asked) -> None:
    answer = asked(150.0, x0=0.005)  # two and a half standard deviations
    assert (answer["verdict"], answer["steps"]) == ("no_gap", [])


@pytest.mark.long
def test_an_effect_is_not_laid_to_where_the_motion_starts(asked: Asked) -> None:
    """Twice the damping: without it even the start does not fit, and with it there is nothing wrong with that."""
    answer = asked(150.0, more=1.5)
    assert answer["verdict"] == "effects_found"
    (step,) = answer["steps"]
    assert (step["effect"], step["channel"]) in (("viscous_friction", "v"), ("parameter_error", "c"))
    assert answer["unknowns"]["k"]["value"] == pytest.approx(150.0, abs=0.1)
