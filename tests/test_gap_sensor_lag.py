"""Proves that a slow sensor is named whether it rested before the record or moved, for nobody knows what it began with.

Motor and sensor are one linear system, integrated by its matrix exponential. Half-widths are those of 95 %.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from click.testing import Result
from in_part import in_part
from scipy.linalg import expm
from scipy.stats import multivariate_normal

from kfgen.gap.plant.initial_history import independent, integrated

Cli = Callable[..., Result]

MODEL = """format = "kfgen-model-1"
name = "motor"
[parameters]
tau = "0.12 s"
gain = "15 rad/s/V"
[states]
omega = "rad/s"
[inputs]
u = "V"
[dynamics]
omega = "(gain*u - omega)/tau"
[measurements.speed]
unit = "rad/s"
expression = "omega"
effects = [ { effect = "white_noise", N = "0.04 rad/s/sqrt(Hz)" } ]
"""


@pytest.mark.long
@pytest.mark.parametrize("before", in_part([0, 40, 77]))
def test_a_slow_sensor(before: int, kfgen: Cli, tmp_path: Path) -> None:
    """It moves at the first sample, from rest; or has moved for a while, the input switched every 80 samples."""
    A = np.array([[-1.0 / 0.12, 0.0, 15.0 / 0.12], [1.0 / 0.03, -1.0 / 0.03, 0.0], [0.0, 0.0, 0.0]])
    Phi, rng = expm(0.01 * A), np.random.default_rng(3)
    x, rows = np.zeros(2), []
    for k, u in enumerate(np.repeat(rng.uniform(-6.0, 6.0, 26), 80)[: 2000 + before]):
        rows.append([0.01 * k, u, x[1]])
        x = (Phi @ [*x, u])[:2]
    table = np.array(rows)[before:]
    table[:, 2] += 0.4 * rng.standard_normal(2000)
    path, model, out = tmp_path / "log.csv", tmp_path / "model.toml", tmp_path / "out.json"
    np.savetxt(path, table, delimiter=",", header="t [s],u [V],speed [rad/s]", comments="", fmt="%.12g")
    model.write_text(MODEL, encoding="utf-8")
    done = kfgen("gap", path, "--model", model, "--json", out)
    assert done.exit_code == 0, done.output
    answer = json.loads(out.read_text(encoding="utf-8"))
    assert answer["verdict"] == "effects_found"
    (step,) = answer["steps"]
    assert step["effect"] == "sensor_lag" or (
        step["effect"] == "input_lag" and step["indistinguishable"] == ["sensor_lag"]
    )
    lo, hi = step["parameters"]["tau"]["ci95"]
    assert abs(0.03 - 0.5 * (lo + hi)) < 2.5 * 0.5 * (hi - lo) < 1e-3


def test_what_a_sensor_began_with_is_integrated_out() -> None:
    """The density of unit white noise plus a unit normal deviate times a known shape."""
    rng = np.random.default_rng(5)
    r, E = rng.standard_normal((30, 2)), rng.standard_normal((30, 2)) * [3.0, 0.0]
    left = integrated(r, E)
    for j in range(2):
        exact = multivariate_normal(np.zeros(30), np.eye(30) + np.outer(E[:, j], E[:, j])).logpdf(r[:, j])
        power = float(E[:, j] @ E[:, j])
        found = -0.5 * left[:, j] @ left[:, j] - 0.5 * np.log1p(power) - 15.0 * np.log(2.0 * np.pi)
        assert found == pytest.approx(exact, rel=1e-12)
    np.testing.assert_array_equal(left[:, 1], r[:, 1])


def test_two_of_them_are_integrated_out_one_after_the_other() -> None:
    """Columns that are made independent give the density of both together."""
    rng = np.random.default_rng(8)
    r = rng.standard_normal((30, 1))
    E = [2.0 * rng.standard_normal((30, 1)), np.ones((30, 1))]
    exact = multivariate_normal(np.zeros(30), np.eye(30) + sum(e @ e.T for e in E)).logpdf(r[:, 0])
    found = -15.0 * np.log(2.0 * np.pi)
    for e in independent(E):
        r = integrated(r, e)
        found -= 0.5 * np.log1p(float(np.sum(e**2)))
    assert found - 0.5 * float(np.sum(r**2)) == pytest.approx(exact, rel=1e-12)
