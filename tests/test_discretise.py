"""Proves one step: effects exactly, the motion's coupling to the order that is asked for, noise positive.

The blocks of the effects are compared with mpmath (50 digits) in both precisions; the whole with Van
Loan's matrix exponential of the same numbers; the stored state with scipy's rotations.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache
from typing import Any

import mpmath as mp
import numpy as np
import pytest
import sympy as sp
from in_part import in_part
from scipy.spatial.transform import Rotation

from kfgen.core import linear
from kfgen.core.errors import InputError
from kfgen.effects import make
from kfgen.model.discretise import DiscreteModel
from kfgen.model.filter import FilterModel
from kfgen.model.library import build
from kfgen.model.parts.motion import AtRestMotion
from kfgen.model.parts.sensors import AtRest
from kfgen.model.register import DT

LIMIT = 2.2
"""beta*dt up to here is allowed: (2 x)^24 / 24! falls below 2^-27 at x = 2.26."""


def at_rest(*effects: object) -> FilterModel:
    return FilterModel("one", "one axis", AtRestMotion(), (AtRest(),), {"gyro_x": effects})  # type: ignore[dict-item]


def in_precision(expression: sp.Expr, dt: float, real: type) -> float:
    """A nested polynomial in dt, every operation in one precision."""
    if expression.is_Number:
        return real(float(expression))
    if expression.is_Symbol:
        assert expression == DT
        return real(dt)
    parts = [in_precision(a, dt, real) for a in expression.args]
    if expression.is_Pow:
        return real(parts[0] ** int(expression.exp))
    total = parts[0]
    for p in parts[1:]:
        total = real(total + p) if expression.is_Add else real(total * p)
    return total


@pytest.mark.parametrize(("real", "near"), [(np.float64, 2.0**-26), (np.float32, 3e-6)])
@pytest.mark.parametrize("x", [1e-8, 1e-6, 1e-4, 1e-3, 1e-2, 0.1, 0.5, 1.0, LIMIT])
@pytest.mark.parametrize("tau", [0.01, 0.5, 3.0])
def test_gauss_markov_block_is_exact(x: float, tau: float, real: type, near: float) -> None:
    sigma = 2e-5
    dt = x * tau
    d = DiscreteModel(at_rest(make("gauss_markov", sigma=sigma, tau=tau)), max_step=dt)
    mp.mp.dps = 50
    step = mp.mpf(float(real(dt))) / mp.mpf(tau)
    assert in_precision(d.Phi[0, 0], dt, real) == pytest.approx(float(mp.exp(-step)), rel=near)
    Q = float(mp.mpf(sigma) ** 2 * -mp.expm1(-2 * step))
    assert in_precision(d.Qd[0, 0], dt, real) == pytest.approx(Q, rel=near)


@pytest.mark.parametrize("x", [1e-8, 1e-5, 1e-3, 0.1, 1.0, LIMIT])
def test_a_short_step_of_a_filter_made_for_long_ones_is_exact(x: float) -> None:
    tau, sigma = 5.0, 2e-3
    d = DiscreteModel(at_rest(make("gauss_markov", sigma=sigma, tau=tau)), max_step=LIMIT * tau)
    got = [in_precision(e, x * tau, np.float32) for e in (d.Phi[0, 0], d.Qd[0, 0])]
    assert got == pytest.approx([math.exp(-x), -(sigma**2) * math.expm1(-2 * x)], rel=5e-6)


@pytest.mark.parametrize("dt", [1e-4, 0.01, 0.5, 2.0])
def test_walk_and_ramp_blocks_are_exact(dt: float) -> None:
    K, R = 3e-5, 1e-6
    d = DiscreteModel(at_rest(make("rate_random_walk", K=K), make("rate_ramp", R=R)), max_step=dt)
    Phi, Qd = (np.array(M.subs(DT, dt), float) for M in (d.Phi, d.Qd))
    np.testing.assert_allclose(Phi, [[1.0, dt], [0.0, 1.0]], rtol=1e-15)
    np.testing.assert_allclose(Qd, [[K**2 * dt, 0.0], [0.0, 0.0]], rtol=1e-14)


def test_a_ramp_has_no_time_constant_that_limits_the_step() -> None:
    d = DiscreteModel(at_rest(make("rate_ramp", R=1e-6)), max_step=60.0)
    assert d.Phi.subs(DT, 60) == sp.Matrix([[1, 60], [0, 1]])


@cache
def loaded(name: str, order: int, max_step: float = 0.1) -> DiscreteModel:
    model = build(name)
    for channel in {"ahrs6": ("gyro_x", "gyro_z"), "ins15": ("gyro_x", "accel_z")}[name]:
        for e in (make("gauss_markov", sigma=3e-3, tau=0.8), make("rate_random_walk", K=2e-3)):
            model = model.augment(channel, e)
    return DiscreteModel(model, order=order, max_step=max_step)


def filled(d: DiscreteModel, seed: int, dt: float) -> tuple[np.ndarray, ...]:
    """F, G W G', Phi and Qd at a random attitude and input."""
    model, rng = d.model, np.random.default_rng(seed)
    R = Rotation.random(random_state=rng).as_matrix()
    values = {f"R_nb_{i}{j}": R[i, j] for i in range(3) for j in range(3)} | {"g": 9.80665, "dt": dt}
    values |= {s.name: 0.01 * rng.normal() for s in model.states}
    values |= {c: rng.normal() * (10.0 if c.startswith("acc") else 1.0) for c in model.channel_units}
    symbols, function = compiled(d.model.name, d.order)
    return tuple(np.array(M, float) for M in function(*(values[s] for s in symbols)))


@cache
def compiled(name: str, order: int) -> tuple[list[str], Callable[..., tuple[Any, ...]]]:
    d = loaded(name, order)
    m = d.model
    matrices = (m.F, m.G * m.W * m.G.T, d.Phi, d.Qd)
    symbols = sorted(set().union(*(M.free_symbols for M in matrices)), key=str)
    return [s.name for s in symbols], sp.lambdify(symbols, matrices)


def errors(d: DiscreteModel, seed: int, dt: float, scale: np.ndarray) -> tuple[float, float]:
    """Largest difference of Phi and Qd from the exact ones where motion is involved."""
    F, W, *found = filled(d, seed, dt)
    exact = linear.van_loan(F, W, dt)
    effects = slice(F.shape[0] - d.model.effect_dynamics[0].rows, None)
    off = [np.abs(a - b) for a, b in zip(found, exact, strict=True)]
    for o in off:
        o[effects, effects] = 0.0
    return float((off[0] / scale[:, None] * scale).max()), float((off[1] / np.outer(scale, scale)).max())


@pytest.mark.parametrize("name", in_part(["ahrs6", "ins15"]))
@pytest.mark.parametrize("order", in_part([1, 2, 3]))
@pytest.mark.parametrize("seed", in_part(range(2)))
def test_coupling_converges_with_its_order(name: str, order: int, seed: int) -> None:
    d, dt = loaded(name, order), 0.01
    F, W, *_ = filled(d, seed, dt)
    scale = np.maximum(np.sqrt(np.diag(linear.van_loan(F, W, dt)[1])), 1e-4)
    long, short = errors(d, seed, dt, scale), errors(d, seed, dt / 2, scale)
    for a, b in zip(long, short, strict=True):
        assert b > 0.0
        assert math.log2(a / b) == pytest.approx(order + 1, abs=0.2)


@pytest.mark.parametrize("name", ["ahrs6", "ins15"])
@pytest.mark.parametrize("order", [1, 2, 3])
def test_effect_block_of_a_moving_model_is_exact_at_any_order(name: str, order: int) -> None:
    d, dt = loaded(name, order), 0.1
    A, W = (np.array(M, float) for M in d.model.effect_dynamics)
    exact = linear.van_loan(A, W, dt)
    first = len(d.model.states) - A.shape[0]
    for M, wanted in zip((d.Phi, d.Qd), exact, strict=True):
        block = np.array(M[first:, first:].subs(DT, dt), float)
        np.testing.assert_allclose(block, wanted, rtol=2.0**-26, atol=1e-18)


@pytest.mark.parametrize("name", ["ahrs6", "ins15"])
@pytest.mark.parametrize("order", [1, 2, 3])
@pytest.mark.parametrize("dt", [1e-3, 0.01, 0.1])
def test_process_noise_is_positive_semidefinite(name: str, order: int, dt: float) -> None:
    d = loaded(name, order)
    F, W, _, Qd = filled(d, 3, dt)
    np.testing.assert_allclose(Qd, Qd.T, rtol=1e-14)
    sd = np.sqrt(np.diag(linear.van_loan(F, W, dt)[1]))
    scale = np.where(sd > 0.0, sd, 1.0)
    scaled = Qd / np.outer(scale, scale)
    assert np.linalg.eigvalsh(scaled).min() > -1e-12


@pytest.mark.parametrize("dt", in_part([1e-6, pytest.param(1e-3, marks=pytest.mark.long), 0.05]))
def test_noise_of_turned_states_that_noise_drives_is_positive_semidefinite(dt: float) -> None:
    d, rng = DiscreteModel(build("ahrs25")), np.random.default_rng(3)
    speed = {s.name: 10.0 * rng.normal() for s in d.model.states if s.name.startswith(("vl_", "al_"))}
    R = Rotation.random(random_state=rng).as_matrix()
    values = speed | {f"R_nb_{i}{j}": R[i, j] for i in range(3) for j in range(3)} | {DT.name: dt}
    Qd = np.array(d.Qd.xreplace({s: sp.Float(values.get(s.name, 0.0)) for s in d.Qd.free_symbols}), float)
    sd = np.sqrt(np.diag(Qd))
    scale = np.where(sd > 0.0, sd, 1.0)
    assert np.linalg.eigvalsh(Qd / np.outer(scale, scale)).min() > -1e-12


def stepped(d: DiscreteModel, x: dict[str, float], dt: float) -> np.ndarray:
    q = np.array([x[f"q_{a}"] for a in "wxyz"])
    R = Rotation.from_quat(q, scalar_first=True).as_matrix()
    known = x | {f"R_nb_{i}{j}": R[i, j] for i in range(3) for j in range(3)} | {"dt": dt}
    symbols = sorted(set().union(*(e.free_symbols for e in d.step)), key=str)
    return np.array(sp.lambdify(symbols, list(d.step))(*(known[s.name] for s in symbols)))


@pytest.mark.parametrize("turn", [0.01, 0.05, 0.2])
@pytest.mark.parametrize("seed", range(3))
def test_attitude_step_is_the_rotation(turn: float, seed: int) -> None:
    rng, dt = np.random.default_rng(seed), 0.02
    axis = rng.normal(size=3)
    omega = axis / np.linalg.norm(axis) * turn / dt
    start = Rotation.random(random_state=rng)
    q = start.as_quat(scalar_first=True)
    bias = rng.normal(size=3)
    x = {f"gyro_{a}": omega[k] + bias[k] for k, a in enumerate("xyz")}
    x |= {f"bg_{a}": bias[k] for k, a in enumerate("xyz")} | {f"q_{a}": q[k] for k, a in enumerate("wxyz")}
    new = stepped(DiscreteModel(build("ahrs6")), x, dt)
    got = Rotation.from_quat(new[:4], scalar_first=True)
    off = (got * (start * Rotation.from_rotvec(omega * dt)).inv()).magnitude()
    assert off < turn**5 / 1000 + 1e-15
    np.testing.assert_allclose(new[4:], bias, rtol=1e-15)


@pytest.mark.parametrize("dt", [0.002, 0.1])
def test_velocity_and_position_step_under_constant_acceleration(dt: float) -> None:
    rng = np.random.default_rng(7)
    start = Rotation.random(random_state=rng)
    p, v, f, ba = rng.normal(size=(4, 3))
    q = start.as_quat(scalar_first=True)
    x = {f"p_{a}": p[k] for k, a in enumerate("NED")} | {f"v_{a}": v[k] for k, a in enumerate("NED")}
    x |= {f"accel_{a}": f[k] for k, a in enumerate("xyz")} | {f"ba_{a}": ba[k] for k, a in enumerate("xyz")}
    x |= {f"gyro_{a}": 0.0 for a in "xyz"} | {f"bg_{a}": 0.0 for a in "xyz"} | {"g": 9.80665}
    d = DiscreteModel(build("ins15"))
    new = stepped(d, x | {f"q_{a}": q[k] for k, a in enumerate("wxyz")}, dt)
    a = start.apply(f - ba) + np.array([0.0, 0.0, 9.80665])
    np.testing.assert_allclose(new[:3], p + v * dt + a * dt**2 / 2, rtol=1e-13)
    np.testing.assert_allclose(new[3:6], v + a * dt, rtol=1e-13)
    assert d.nominal_names[:6] == ("p_N", "p_E", "p_D", "v_N", "v_E", "v_D")


def test_effects_step_by_their_own_transition() -> None:
    tau, dt = 4.0, 0.1
    d = DiscreteModel(at_rest(make("gauss_markov", sigma=1.0, tau=tau), make("rate_ramp", R=0.1)))
    names = [s.name for s in d.model.states]
    x = dict(zip(names, (0.7, 0.3, 0.2), strict=True))
    new = [float(e.subs({sp.Symbol(n, real=True): v for n, v in x.items()}).subs(DT, dt)) for e in d.step]
    assert new == pytest.approx([0.7 * math.exp(-dt / tau), 0.3 + 0.2 * dt, 0.2], rel=1e-9)


def test_variance_of_a_sample() -> None:
    N, Q, rate = 2e-4, 3e-6, 50.0
    model = (
        build("ahrs6").augment("mag_x", make("white_noise", N=N)).augment("mag_x", make("quantisation", Q=Q))
    )
    d, mag = DiscreteModel(model, rate=rate), model.sensor("mag")
    assert d.sample_variance(mag, "mag_x") == pytest.approx(N**2 * rate + 2 * Q**2 * rate**2, rel=1e-12)
    assert d.sample_variance(mag, "mag_y") == pytest.approx(mag.sd**2, rel=1e-12)
    assert d.measurement_variance(mag, "mag_y") == pytest.approx(
        mag.sd**2 + mag.left_out**2 * rate, rel=1e-12
    )


def test_too_long_a_step_is_refused_in_words() -> None:
    d = DiscreteModel(at_rest(make("gauss_markov", sigma=1.0, tau=0.01)), max_step=0.1)
    with pytest.raises(InputError, match=r"0\.1 s is too long for a time constant of 0\.01 s.*--max-step"):
        _ = d.Phi


@pytest.mark.parametrize("max_step", [0.0, -0.1, math.nan, math.inf])
@pytest.mark.parametrize("name", ["gyro-static", "ins15"])
def test_a_longest_step_that_is_none_is_refused(name: str, max_step: float) -> None:
    with pytest.raises(InputError):
        _ = DiscreteModel(build(name), max_step=max_step).Phi


@pytest.mark.parametrize("rate", [0.0, -1.0, math.nan, math.inf])
def test_bad_rate_is_refused(rate: float) -> None:
    with pytest.raises(InputError, match="--rate"):
        DiscreteModel(build("ahrs6"), rate=rate)


@pytest.mark.parametrize("order", [0, 4, -1])
def test_bad_order_is_refused(order: int) -> None:
    with pytest.raises(InputError, match="1, 2 or 3"):
        DiscreteModel(build("ahrs6"), order=order)
