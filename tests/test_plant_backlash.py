"""Proves that a backlash as wide as the noise is found in a servo that turns many times, and its width.

The servo is linear with a held input, integrated by its matrix exponential; the backlash is its definition. The width is
held to 2.5 half-widths of its 95 % interval (1e-6); the seed is fixed. A sound log is falsely alarmed at 0.2 % by the
battery.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from click.testing import Result
from scipy.linalg import expm

Cli = Callable[..., Result]

SERVO = """format = "kfgen-model-1"
name = "servo"
[parameters]
a = "5 1/s"
b = "30 rad/s^2/V"
[states]
theta = "rad"
omega = "rad/s"
[inputs]
u = "V"
[dynamics]
theta = "omega"
omega = "b*u - a*omega"
[measurements.angle]
unit = "rad"
expression = "theta"
effects = [ { effect = "white_noise", N = "0.0005 rad/sqrt(Hz)" } ]
"""
NOISE = 0.005


@pytest.mark.parametrize(
    "width", [pytest.param(0.01, marks=pytest.mark.long), pytest.param(0.005, marks=pytest.mark.long), 0.0]
)
def test_a_backlash_that_is_small_against_the_travel(width: float, kfgen: Cli, tmp_path: Path) -> None:
    Phi = expm(0.01 * np.array([[0.0, 1.0, 0.0], [0.0, -5.0, 30.0], [0.0, 0.0, 0.0]]))
    rng, x, rows, stands = np.random.default_rng(22), np.zeros(2), [], 0.0
    for k, u in enumerate(np.repeat(rng.uniform(-6.0, 6.0, 75), 40)):
        stands = min(max(stands, x[0] - 0.5 * width), x[0] + 0.5 * width)
        rows.append([0.01 * k, u, stands])
        x = (Phi @ [*x, u])[:2]
    table = np.array(rows)
    assert np.ptp(table[:, 2]) > 1000.0 * NOISE
    table[:, 2] += NOISE * rng.standard_normal(len(table))
    path, model, out = tmp_path / "log.csv", tmp_path / "model.toml", tmp_path / "out.json"
    np.savetxt(path, table, delimiter=",", header="t [s],u [V],angle [rad]", comments="", fmt="%.12g")
    model.write_text(SERVO, encoding="utf-8")
    done = kfgen("gap", path, "--model", model, "--json", out)
    assert done.exit_code == 0, done.output
    steps = json.loads(out.read_text(encoding="utf-8"))["steps"]
    if not width:
        assert not steps
        return
    (step,) = steps
    assert step["effect"] == "backlash"
    lo, hi = step["parameters"]["width"]["ci95"]
    assert abs(width - 0.5 * (lo + hi)) < 2.5 * 0.5 * (hi - lo) < 0.5 * width
