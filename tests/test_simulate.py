"""Proves the simulated truth against independent oracles: a solver of differential equations, and motions in closed form.

The truth is continuous: what the sensors are given must be its means, whatever the grid on which it is computed.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from kfgen.emit.routines import Program
from kfgen.emit.targets.filterpy import class_name
from kfgen.manoeuvre.file import manoeuvre, parse_manoeuvre
from kfgen.manoeuvre.flight import ManoeuvreMotion
from kfgen.manoeuvre.manoeuvre import Manoeuvre
from kfgen.manoeuvre.motion import MotionProfile
from kfgen.manoeuvre.rotations import cumulative, exponential, logarithm, product, rotated
from kfgen.manoeuvre.truth import Path, along, fine_times
from kfgen.model.discretise import DiscreteModel
from kfgen.model.library import build
from kfgen.run.run import load
from kfgen.simulate.interval import interval_samples

HEAD = 'format = "kfgen-manoeuvre-1"\n'
G = 9.80665
FREE = (
    'velocity = [3, -2, 1]\nattitude = ["20 deg", "-30 deg", "80 deg"]\n[[segment]]\nduration = "4 s"\n'
    'rate = ["1.5*sin(3*t)", "0.7*cos(5*t)", "0.9 - t/8"]\n'
    'acceleration = ["sin(2*t)", "0.5*t", "1"]\nbody_acceleration = ["2*cos(4*t)", "1 - t", "sin(t)"]\n'
)


def parsed(text: str) -> Manoeuvre:
    return parse_manoeuvre(HEAD + text, "m.toml")


def path_of(m: Manoeuvre, T: float, rate: float, parts: int = 4, **options: str) -> tuple[Path, np.ndarray]:
    """The truth on a grid of so many parts of each sample, and the edges of the samples."""
    n = round(T * rate)
    motion = ManoeuvreMotion(m, np.arange(n) / rate, T)
    edges = np.arange(n + 1) / rate
    return Path(build("ins15", None, options), motion, {}, np.linspace(0.0, T, n * parts + 1)), edges


def at(path: Path, times: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    k = path.places(times)
    return path.q[k], path.v[k], path.p[k]


def test_truth_is_what_a_solver_of_the_equations_says() -> None:
    m = parsed(FREE)
    path, edges = path_of(m, 4.0, 50.0)

    def rate(t: float, x: np.ndarray) -> np.ndarray:
        q, v = x[:4], x[4:7]
        w = np.array([1.5 * np.sin(3 * t), 0.7 * np.cos(5 * t), 0.9 - t / 8])
        a = np.array([np.sin(2 * t), 0.5 * t, 1.0])
        b = np.array([2 * np.cos(4 * t), 1 - t, np.sin(t)])
        r = Rotation.from_quat(q, scalar_first=True)
        turn = 0.5 * np.array(
            [
                -q[1:] @ w,
                q[0] * w[0] + q[2] * w[2] - q[3] * w[1],
                q[0] * w[1] + q[3] * w[0] - q[1] * w[2],
                q[0] * w[2] + q[1] * w[1] - q[2] * w[0],
            ]
        )
        return np.concatenate([turn, a + r.apply(b), v])

    start = Rotation.from_euler("ZYX", [80, -30, 20], degrees=True).as_quat(scalar_first=True)
    x0 = np.concatenate([start, [3.0, -2.0, 1.0], np.zeros(3)])
    found = solve_ivp(rate, (0.0, 4.0), x0, t_eval=edges, rtol=1e-12, atol=1e-13, method="DOP853").y.T
    q, v, p = at(path, edges)
    away = (
        Rotation.from_quat(q, scalar_first=True).inv() * Rotation.from_quat(found[:, :4], scalar_first=True)
    ).magnitude()
    assert away.max() < 1e-9
    assert np.abs(v - found[:, 4:7]).max() < 1e-9
    assert np.abs(p - found[:, 7:]).max() < 1e-9


def test_earth_fixed_truth_obeys_its_own_equations() -> None:
    """Specific force and rate that the sensors show, put through the equations of motion by a solver."""
    m = parsed(FREE)
    path, edges = path_of(m, 4.0, 50.0, frame="ecef")
    model = path.model
    origin = np.array([path.known[f"o_{a}"] for a in "xyz"])
    import sympy as sp

    from kfgen.model.parts.earth import EARTH_RATE, gravity_e

    symbols = sp.symbols("x y z", real=True)
    gravity = sp.lambdify(symbols, list(gravity_e(sp.Matrix(symbols))))
    fine = along(model, ManoeuvreMotion(m, np.linspace(0.0, 4.0, 4001), 4.0), {})
    times = np.linspace(0.0, 4.0, 4001)
    from scipy.interpolate import CubicSpline

    shown = CubicSpline(
        times, np.column_stack([fine[c] for c in model.channel_units if not c.startswith("gnss")])
    )
    omega = np.array([0.0, 0.0, EARTH_RATE])

    def rate(t: float, x: np.ndarray) -> np.ndarray:
        f, w_ib = shown(t)[:3], shown(t)[3:6]
        r = Rotation.from_quat(x[:4], scalar_first=True)
        w = w_ib - r.inv().apply(omega)
        q = x[:4]
        turn = 0.5 * product(q, np.concatenate([[0.0], w]))
        a = r.apply(f) + np.array(gravity(*(origin + x[7:]))) - 2 * np.cross(omega, x[4:7])
        return np.concatenate([turn, a, x[4:7]])

    q, v, p = at(path, edges)
    x0 = np.concatenate([q[0], v[0], p[0]])
    found = solve_ivp(rate, (0.0, 4.0), x0, rtol=1e-10, atol=1e-9, method="DOP853", max_step=0.05).y.T[-1]
    assert np.abs(v[-1] - found[4:7]).max() < 1e-6
    assert np.abs(p[-1] - found[7:]).max() < 1e-6


@pytest.mark.parametrize("name", ["generic", "s-turn", "coordinated-turn", "six-position"])
def test_half_the_step_changes_nothing_against_the_noise(name: str) -> None:
    """Position, velocity and attitude move by less than a millionth of the sensors' noise (Richardson)."""
    m = manoeuvre(name)
    coarse, edges = path_of(m, 20.0, 50.0, 4)
    fine, _ = path_of(m, 20.0, 50.0, 8)
    (q, v, p), (q2, v2, p2) = at(coarse, edges), at(fine, edges)
    away = (
        Rotation.from_quat(q, scalar_first=True).inv() * Rotation.from_quat(q2, scalar_first=True)
    ).magnitude()
    assert away.max() < 1e-6 * 1.5e-4 * np.sqrt(0.02)  # of the angle that one gyro sample walks
    assert np.abs(v - v2).max() < 1e-6 * 0.1
    assert np.abs(p - p2).max() < 1e-6 * 1.5


def test_constant_rate_makes_a_circle() -> None:
    """Radius, position and velocity of a level turn in closed form, at any time."""
    speed, omega = 20.0, 0.5
    m = parsed(
        f'velocity = [{speed}, 0, 0]\n[[segment]]\nduration = "T"\nrate = [0, 0, {omega}]\nbody_acceleration = [0, {speed * omega}, 0]\n'
    )
    path, edges = path_of(m, 30.0, 20.0)
    _, v, p = at(path, edges)
    angle = omega * edges
    zero = np.zeros_like(angle)
    circle = speed / omega * np.column_stack([np.sin(angle), 1 - np.cos(angle), zero])
    assert p == pytest.approx(circle, abs=1e-9)
    assert v == pytest.approx(speed * np.column_stack([np.cos(angle), np.sin(angle), zero]), abs=1e-10)
    samples = interval_samples(path, edges)
    assert samples["gyro_z"] == pytest.approx(np.full(600, omega), abs=1e-12)
    # The mean of a force that turns with the body, in the axes of the middle: sinc of half the angle.
    mean = speed * omega * np.sinc(omega / 20.0 / 2 / np.pi)
    assert samples["accel_y"] == pytest.approx(np.full(600, mean), abs=1e-10)
    assert samples["accel_z"] == pytest.approx(np.full(600, -G), abs=1e-10)


def test_coning_is_in_the_samples() -> None:
    """A cone in closed form: samples are the logarithms of the true rotations, not means of the rate."""
    lean, cone, T, rate = 0.05, 2 * np.pi * 8.0, 3.0, 100.0
    sin, cos = np.sin(lean), np.cos(lean)
    m = parsed(
        f'attitude = ["{lean} rad", 0, 0]\n[[segment]]\nduration = "T"\n'
        f'rate = ["{-cone * sin}*sin({cone}*t)", "{cone * sin}*cos({cone}*t)", "{cone * (cos - 1)}"]\n'
    )
    path, edges = path_of(m, T, rate)
    q, _, _ = at(path, edges)
    # Leaning by a fixed angle about an axis that goes round: Rz(wt) Rx(lean) Rz(-wt).
    z, x = np.outer(cone * edges, [0, 0, 1.0]), np.array([lean, 0, 0])
    true = Rotation.from_rotvec(z) * Rotation.from_rotvec(x) * Rotation.from_rotvec(-z)
    assert (true.inv() * Rotation.from_quat(q, scalar_first=True)).magnitude().max() < 1e-9
    wanted = (true[:-1].inv() * true[1:]).as_rotvec() * rate
    samples = interval_samples(path, edges)
    gyro = np.column_stack([samples[f"gyro_{a}"] for a in "xyz"])
    assert gyro == pytest.approx(wanted, abs=1e-5)
    # The mean rate about z lacks the coning of a sample.
    assert abs(gyro[:, 2].mean() - cone * (cos - 1)) > 1e-3


@cache
def rolling(text: str, rate: float, T: float) -> tuple[Path, dict[str, np.ndarray], np.ndarray]:
    path, edges = path_of(parsed(text), T, rate)
    return path, interval_samples(path, edges), edges


SHAKEN = (
    '[[segment]]\nduration = "10 s"\nrate = ["sin(12*t)", "cos(12*t)", "0.3"]\n'
    'body_acceleration = ["sin(9*t)", "2*cos(12*t)", "sin(12*t)"]\n'
)


def test_an_integrator_of_the_samples_gives_the_truth_back() -> None:
    """``R <- R Exp(w dt)``, ``v <- v + (R_k Exp(w dt/2) f + g) dt``: sculling and coning included."""
    path, samples, edges = rolling(SHAKEN, 50.0, 10.0)
    gyro, accel = (np.column_stack([samples[f"{t}_{a}"] for a in "xyz"]) for t in ("gyro", "accel"))
    turns = exponential(gyro / 50.0)
    q = product(path.q[0], cumulative(turns))
    middle = product(q[:-1], exponential(gyro / 100.0))
    v = path.v[0] + np.cumsum((rotated(middle, accel) + np.array([0, 0, G])) / 50.0, axis=0)
    true_q, true_v, _ = at(path, edges)
    assert np.abs(q - true_q).max() < 1e-11
    assert np.abs(v - true_v[1:]).max() < 1e-10


def predicted(path: Path, samples: dict[str, np.ndarray], rate: float) -> np.ndarray:
    """The stored state of the emitted filter after its predictions alone."""
    program = Program(DiscreteModel(path.model, rate=rate))
    kf: Any = getattr(load(program), class_name(program))()
    kf.nominal[:] = [*path.p[0], *path.v[0], *path.q[0], *[0.0] * 6]
    gyro, accel = (np.column_stack([samples[f"{t}_{a}"] for a in "xyz"]) for t in ("gyro", "accel"))
    for w, f in zip(gyro, accel, strict=True):
        kf.predict(gyro=w, accel=f, dt=1.0 / rate)
    return np.array(kf.nominal)


def test_a_rolling_filter_keeps_its_velocity() -> None:
    """115 deg/s at 100 Hz for a minute without an update: gravity turns with the body, half a step late it would add up."""
    path, samples, _ = rolling('[[segment]]\nduration = "T"\nrate = ["115 deg/s", 0, 0]\n', 100.0, 60.0)
    end = predicted(path, samples, 100.0)
    assert np.linalg.norm(end[3:6] - path.v[-1]) < 0.05
    away = Rotation.from_quat(end[6:10], scalar_first=True).inv() * Rotation.from_quat(
        path.q[-1], scalar_first=True
    )
    assert away.magnitude() < 1e-6


def test_samples_of_a_motion_are_straight_between_them() -> None:
    """A motion by samples: a rate that grows evenly turns by half its square."""
    t = np.arange(101) * 0.02
    rate = np.outer(t, [0.0, 0.0, 0.4])
    profile = MotionProfile(t, rate, np.zeros((101, 3)), np.eye(3), np.zeros(3))
    path = Path(build("ins15"), profile, {}, fine_times(t, float(t[-1])))
    assert logarithm(path.q[-1])[2] == pytest.approx(0.2 * t[-1] ** 2, abs=1e-12)
