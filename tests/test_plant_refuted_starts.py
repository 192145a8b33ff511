"""Proves that a plant whose log begins in the middle of a motion is said to start elsewhere, and nothing else is invented.

The pendulum is integrated by scipy under an input that changes continuously between the rows of a finer grid. Seeds are
fixed; a start that holds is refuted at 4 standard deviations, by chance at 6e-5 for each state.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

import kfgen as kf
from kfgen.gap.plant.refuted_starts import refuted_starts
from kfgen.gap.plant.scene import PlantScene
from kfgen.log.log import Channel, Log
from kfgen.model.plant.file import parse_model

Array = NDArray[np.float64]
PENDULUM = """format = "kfgen-model-1"
name = "pendulum"
[parameters]
g_over_l = "19.6 1/s^2"
gain = "25 1/kg/m^2"
[states]
theta = { unit = "rad", initial = "0 rad", sd = "0.01 rad" }
omega = { unit = "rad/s", initial = "0 rad/s", sd = "0.01 rad/s" }
[inputs]
u = "N m"
[dynamics]
theta = "omega"
omega = "-g_over_l*sin(theta) + gain*u"
[measurements.seen]
unit = "rad"
expression = "theta"
effects = [ { effect = "white_noise", N = "3.5e-4 rad/sqrt(Hz)" } ]
"""
RATE, N = 100.0, 1500
SIGMA = 3.5e-3


def swung(rng: np.random.Generator, late: float = 0.0) -> tuple[Array, Array, Array]:
    """Held torque, and angle and rate at every sample."""
    ends = np.cumsum(rng.exponential(60.0, N).astype(int) + 5)
    u = 0.1 * rng.uniform(-1.0, 1.0, N)[np.searchsorted(ends, np.arange(N), side="right")]
    t = np.arange(N) / RATE

    def slope(at: float, x: Array) -> list[float]:
        k = min(max(int((at - late) * RATE + 1e-9), 0), N - 1)
        return [x[1], -19.6 * np.sin(x[0]) + 25.0 * u[k]]

    run = solve_ivp(slope, (0.0, t[-1]), [0.0, 0.0], t_eval=t, max_step=0.5 / RATE, rtol=1e-8, atol=1e-10)
    return u, run.y[0], run.y[1]


def written(folder: Path, u: Array, theta: Array) -> tuple[Path, Path]:
    path, model = folder / "log.csv", folder / "pendulum.toml"
    table = np.column_stack([np.arange(u.size) / RATE, u, theta])
    np.savetxt(path, table, delimiter=",", header="t [s],u [N m],seen [rad]", comments="", fmt="%.10g")
    model.write_text(PENDULUM, encoding="utf-8")
    return path, model


@pytest.mark.long
@pytest.mark.parametrize("seed", [1, *(pytest.param(s, marks=pytest.mark.long) for s in (2, 3))])
def test_a_log_that_begins_in_the_middle(tmp_path: Path, seed: int) -> None:
    rng = np.random.default_rng([176121, seed])
    u, theta, omega = swung(rng)
    k = int(np.argmax(np.abs(omega[300:700]) * (np.abs(theta[300:700]) > 0.1))) + 300
    path, model = written(tmp_path, u[k:], theta[k:] + SIGMA * rng.standard_normal(N - k))
    found = kf.find_gap(path, model)
    assert found.verdict == "effects_found"
    assert {f.where for f in found.findings} == {"theta", "omega"}
    for f, true in ((f, {"theta": theta[k], "omega": omega[k]}[f.where]) for f in found.findings):
        lo, hi = f.ci95["value"]
        assert abs(true - 0.5 * (lo + hi)) < 2.5 * 0.5 * (hi - lo)
        assert f.once
    assert found.comparisons[0].rms[0][2] == pytest.approx(1.0, abs=0.1)


def scene(u: Array, theta: Array) -> PlantScene:
    log = Log(np.arange(N) / RATE, {"seen": Channel.of(theta, "rad"), "u": Channel.of(u, "N m")})
    return PlantScene.of(parse_model(PENDULUM, "pendulum.toml"), log)


def test_a_start_that_holds_is_not_refuted() -> None:
    rng = np.random.default_rng(176122)
    u, theta, _ = swung(rng)
    assert refuted_starts(scene(u, theta + SIGMA * rng.standard_normal(N)).shooting) == ()


def test_an_input_that_acts_late_is_no_other_start() -> None:
    rng = np.random.default_rng(176123)
    u, theta, _ = swung(rng, late=0.06)
    assert refuted_starts(scene(u, theta + SIGMA * rng.standard_normal(N)).shooting) == ()
