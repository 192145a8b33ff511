"""The acceleration of a body whose velocity is bounded, and a magnetometer that is late, against theory.

The process is that of Gelb 1974, table 2.2-1: its transition and its stationary covariance are written here in closed form.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import sympy as sp
from in_part import in_part
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from kfgen.audit.audit import unobservable_directions
from kfgen.emit.routines import Program
from kfgen.log.log import Channel, Log
from kfgen.log.readers import read_log
from kfgen.manoeuvre.random_truth import noise_driven
from kfgen.manoeuvre.truth import numeric
from kfgen.model.discretise import DiscreteModel
from kfgen.model.library import build
from kfgen.model.register import DT
from kfgen.run.run import attitude_error, run

ALARM = 1e-3
SIGMA, TAU = 0.4, 0.2
CHOSEN = {"speed": f"{SIGMA} m/s", "speed_time": f"{TAU} s"}
STATIONARY = np.diag([SIGMA**2] * 3 + [(SIGMA / TAU) ** 2] * 3)


def transition(dt: float) -> np.ndarray:
    b, one = 1.0 / TAU, np.eye(3)
    block = np.array([[1 + b * dt, dt], [-(b**2) * dt, 1 - b * dt]])
    return np.asarray(np.exp(-b * dt) * np.kron(block, one))


def of_motion(M: sp.Matrix, dt: float) -> np.ndarray:
    """Its part of the velocity and the acceleration, where both are zero: noise of the gyro turns neither then."""
    block = M[3:9, 3:9].subs(DT, dt)
    return np.array(block.subs(dict.fromkeys(block.free_symbols, 0)), dtype=np.float64)


@pytest.mark.long
@pytest.mark.parametrize("dt", in_part([0.1, 0.01, 1e-3]))
def test_a_step_of_any_length_is_the_exact_one(dt: float) -> None:
    """Up to the longest step, a half of the time constant, to single precision."""
    discrete = DiscreteModel(build("ahrs25", None, CHOSEN), max_step=0.1)
    Phi = transition(dt)
    np.testing.assert_allclose(of_motion(discrete.Phi, dt), Phi, rtol=0, atol=1e-6)
    Qd = STATIONARY - Phi @ STATIONARY @ Phi.T
    np.testing.assert_allclose(of_motion(discrete.Qd, dt), Qd, rtol=1e-5, atol=1e-7 * np.abs(Qd).max())


def test_it_starts_stationary_and_is_simulated_so() -> None:
    """The sizes of 20 000 steps of a simulated course about its own transition: chi-square, false alarm 0.1 %."""
    model, dt, n = build("ahrs25", None, CHOSEN), 0.05, 20_001
    assert [s.prior for s in model.states[3:9]] == pytest.approx([SIGMA] * 3 + [SIGMA / TAU] * 3)
    found = noise_driven(model, dt * np.arange(n), np.random.default_rng(3))
    x = np.column_stack([found[f"{b}_{a}"] for b in ("vl", "al") for a in "NED"])
    Phi = transition(dt)
    w = x[1:] - x[:-1] @ Phi.T
    size = np.einsum("ki,ij,kj->", w, np.linalg.inv(STATIONARY - Phi @ STATIONARY @ Phi.T), w)
    low, high = chi2.ppf([ALARM / 2, 1 - ALARM / 2], w.size)
    assert low < size < high


def test_no_heading_is_read_into_an_unknown_acceleration() -> None:
    """Turned about the vertical, a body with an unknown acceleration shows the same; only what turns with it says so."""
    column = {}
    for convention in ("right-invariant", "phi"):
        model = build("ahrs25", None, {"attitude_error": convention})
        column[convention] = model.H(model.sensor("accel"))[:, 2]
    assert column["right-invariant"].is_zero_matrix
    assert not column["phi"].is_zero_matrix


def test_at_rest_acceleration_is_distinguished_from_tilt() -> None:
    """One stays and the other decays: hidden are what gyros show in turns only, the delay, and heading behind east iron."""
    model = build("ahrs25")
    found = {tuple(d.vector): d.vector for d in unobservable_directions(model)}
    unturned = [(s.name,) for s in model.states if s.name[:2] in ("sg", "mg", "tm")]
    assert set(found) == {*unturned, ("phi_D", "b_mag_y")}
    heading = found["phi_D", "b_mag_y"]
    assert abs(heading["b_mag_y"] / heading["phi_D"]) == pytest.approx(20e-6)


def test_a_late_field_is_that_of_the_attitude_before() -> None:
    """Against the exact rotation: what is left is of second order, a quarter at half the delay."""
    model = build("ahrs6", None, {"mag_delay": "0.01 s", "sensors": "mag"})
    (sensor,) = model.sensors
    omega, R = np.array([1.0, -2.0, 1.5]), Rotation.from_rotvec([0.3, -0.8, 1.1])
    m_n = np.array([20e-6, 0.0, 44e-6])
    x = {f"R_nb_{i}{j}": R.as_matrix()[i, j] for i in range(3) for j in range(3)}
    x |= {f"gyro_{a}": w for a, w in zip("xyz", omega)} | {f"bg_{a}": 0.0 for a in "xyz"}
    x |= {"mag_N": m_n[0], "mag_D": m_n[2]}

    def off(delay: float) -> float:
        expected = np.array([float(v) for v in numeric(list(model.expected(sensor)), x | {"tm": delay})])
        true = (R * Rotation.from_rotvec(-delay * omega)).inv().apply(m_n)
        return float(np.linalg.norm(expected - true))

    assert off(0.01) < 0.01 * off(0.0) + 0.5 * (0.01 * np.linalg.norm(omega)) ** 2 * np.linalg.norm(m_n)
    assert off(0.01) / off(0.005) == pytest.approx(4.0, rel=0.05)


@pytest.mark.parametrize(("sd", "is_given"), [("0.5 uT", True), ("20 uT", False)])
def test_the_first_sample_tells_the_field_where_little_iron_can_be_in_it(sd: str, is_given: bool) -> None:
    model = build("ahrs6", None, {"hard_iron": "true", "hard_iron_sd": sd})
    found = model.sensor("mag").calibrated((15e-6, 0.0, 41e-6), (0.0, 0.0, -1.0))
    assert found == (pytest.approx({"mag_N": 15e-6, "mag_D": 41e-6}) if is_given else {})


@pytest.mark.long
def test_a_hand_turns_a_sensor(recording: Callable[[str], Path]) -> None:
    """BROAD trial 6 until 25 s after its rest, fast turns: the delay is found, tilt within a degree, better than the small model's."""
    log = read_log(recording("dynamic/broad_06_undisturbed_fast_rotation_A.npz"))
    part = (log.t - log.t[0] > 30.0) & (log.t - log.t[0] < 60.0)
    cut = Log(
        log.t[part], {n: Channel(c.values[part], c.unit) for n, c in log.channels.items()}, source=log.source
    )
    errors, delay = {}, 0.0
    for name in ("ahrs6", "ahrs25"):
        result = run(Program(DiscreteModel.at_rate(build(name), 1.0 / cut.dt)), cut)
        error = attitude_error(result, cut)
        assert error is not None
        errors[name] = np.degrees(error.inclination)
        if name == "ahrs25":
            delay = result.estimate[-1, result.names.index("tm")]
    assert 0.008 < delay < 0.018  # `kfgen gap` finds 15 ms against the optical reference
    assert errors["ahrs25"] < min(1.0, 0.6 * errors["ahrs6"])
