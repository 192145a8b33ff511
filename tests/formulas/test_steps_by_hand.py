"""Proves the step of a filter entry by entry, for models so small that every entry is a line of algebra."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import sympy as sp
from test_memory import INTEGRATOR, SIZES, text_of

from kfgen.core.errors import InputError
from kfgen.effects import make
from kfgen.model.discretise import (
    EXHAUSTED,
    LONGEST_STEP,
    ROUNDED,
    DiscreteModel,
    _nested,
    _slope,
    series,
    series_order,
)
from kfgen.model.filter import FilterModel
from kfgen.model.library import build
from kfgen.model.plant.equations import filter_model
from kfgen.model.plant.file import parse_model
from kfgen.model.register import DT

STATIC = build("gyro-static")
MOVING = build("ahrs6")
INS = build("ins15")


def at_rest(*effects: object) -> FilterModel:
    model = STATIC
    for e in effects:
        model = model.augment("gyro_x", e)  # type: ignore[arg-type]
    return model


def test_series_of_a_chain_end_by_themselves() -> None:
    """``x'' = w`` of density q: [[1, dt], [0, 1]] and q [[dt^3 / 3, dt^2 / 2], [dt^2 / 2, dt]]."""
    F, q = sp.Matrix([[0, 1], [0, 0]]), sp.Symbol("q")
    Phi, Qd = series(F, sp.diag(0, q), 3)
    assert sp.Matrix([[1, DT], [0, 1]]) == Phi
    assert sp.Matrix([[DT**3 / 3, DT**2 / 2], [DT**2 / 2, DT]]) * q == Qd.expand()


@pytest.mark.parametrize(("x", "order"), [(1e-9, 2), (0.02, 4), (1.0, 12), (4.0, 23)])
def test_terms_until_nothing_is_left(x: float, order: int) -> None:
    """``x^k / k!`` is below ``2^-27`` from there on: 0.02^4 / 4! = 6.7e-9, 0.02^3 / 3! = 1.3e-6 is not."""
    assert series_order(x / 2.0, 1.0) == order
    assert x**order / math.factorial(order) < EXHAUSTED
    assert order == 2 or x ** (order - 1) / math.factorial(order - 1) >= EXHAUSTED
    assert series_order(x, 0.5) == order


def test_a_step_that_no_series_reaches_is_refused() -> None:
    with pytest.raises(InputError, match=r"a step of 1 s is too long for a time constant of 0.1 s"):
        series_order(10.0, 1.0)
    assert series_order(2.24, 1.0) == 24
    with pytest.raises(InputError):  # 4.55^24 / 24! is 1.0e-8: it would take a 25th term
        series_order(2.275, 1.0)


@pytest.mark.parametrize(
    "wrong",
    [
        {"rate": 0.0},
        {"rate": -1.0},
        {"rate": math.inf},
        {"max_step": 0.0},
        {"max_step": math.inf},
        {"order": 0},
        {"order": 4},
    ],
)
def test_steps_rates_and_orders_that_are_none_are_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(InputError):
        DiscreteModel(STATIC, **wrong)  # type: ignore[arg-type]


def test_the_longest_step_and_the_rates() -> None:
    bare = DiscreteModel(STATIC)
    assert (bare.order, bare.max_step, bare.rate, bare.rates) == (1, 0.1, 100.0, {})
    assert DiscreteModel.at_rate(STATIC, 100.0).order == 1
    given = DiscreteModel.at_rate(STATIC, 100.0, max_step=0.7, rates={"gyro": 3.0})
    assert (given.max_step, given.rates) == (0.7, {"gyro": 3.0})
    slow = at_rest(make("gauss_markov", sigma=1e-3, tau=0.05), make("gauss_markov", sigma=1e-3, tau=9.0))
    assert DiscreteModel.at_rate(slow, 100.0).max_step == pytest.approx(0.05)
    assert DiscreteModel.at_rate(slow, 8.0).max_step == pytest.approx(LONGEST_STEP)
    assert DiscreteModel.at_rate(slow, 15.0).max_step == pytest.approx(1.05 / 15.0)
    for none in (-1.0, 0.0):
        with pytest.raises(InputError):
            DiscreteModel.at_rate(slow, none)


def test_a_bias_that_decays_and_one_that_walks() -> None:
    sigma, tau, K, dt = 0.3, 2.0, 0.05, 0.1
    model = at_rest(make("gauss_markov", sigma=sigma, tau=tau), make("rate_random_walk", K=K))
    d = DiscreteModel(model, max_step=dt)
    names = [s.name for s in model.states]
    gm = [k for k, n in enumerate(names) if "gm" in n][-1]  # the model has one of its own
    walk = next(k for k, n in enumerate(names) if k != gm and n.startswith("b_"))
    Phi, Qd = (np.array(M.subs(DT, dt), float) for M in (d.Phi, d.Qd))
    assert Phi[gm, gm] == pytest.approx(math.exp(-dt / tau), rel=2.0**-24)
    assert Qd[gm, gm] == pytest.approx(-(sigma**2) * math.expm1(-2.0 * dt / tau), rel=2.0**-24)
    assert Phi[walk, walk] == 1.0
    assert Qd[walk, walk] == pytest.approx(K**2 * dt)
    stepped = [e.subs({DT: dt, **{s.symbol: 2.0 for s in model.states}}) for e in d.step]
    assert float(stepped[gm]) == pytest.approx(2.0 * math.exp(-dt / tau), rel=2.0**-24)
    assert float(stepped[walk]) == 2.0
    assert d.nominal_names == tuple(names)
    assert d.start == pytest.approx([s.start for s in model.states])


def test_a_motion_without_noise_keeps_the_rounding_of_its_state() -> None:
    """Where nothing drives a state that moves, ``(2^-24 sd)^2`` does; a state that rests needs none."""
    model = INS.augment("gyro_x", make("rate_random_walk", K=1e-5))
    assert DiscreteModel(model).Qd != sp.zeros(*DiscreteModel(model).Qd.shape)
    d = DiscreteModel(MOVING)
    expected = sp.diag(*(sp.Float((ROUNDED * s.prior) ** 2) for s in MOVING.states))
    assert d._rounding() == expected
    silent = replace(MOVING, W=sp.zeros(*MOVING.W.shape)) if "W" in MOVING.__dataclass_fields__ else None
    if silent is not None:
        assert DiscreteModel(silent).Qd == expected


def test_the_second_order_is_the_trapezoid() -> None:
    """``(D + E D E') dt / 2`` with ``E = 1 + F dt``, at every entry of the motion."""
    d = DiscreteModel(MOVING, order=2, max_step=0.01)
    D = MOVING.G * MOVING.W * MOVING.G.T
    E = sp.eye(MOVING.F.rows) + MOVING.F * DT
    values = {
        s: 0.1 + 0.01 * k
        for k, s in enumerate(sorted(d.Qd.free_symbols | D.free_symbols | E.free_symbols, key=str))
    }
    n = MOVING.F.rows - MOVING.effect_dynamics[0].rows
    found = np.array(d.Qd.subs(values), float)[:n, :n]
    wanted = np.array(((D + E * D * E.T) * DT / 2).subs(values), float)[:n, :n]
    assert found == pytest.approx(wanted, rel=1e-12)


def test_densities_of_inputs_have_symbols() -> None:
    """One where the three axes are alike, one each where they are not; put back they are the process noise."""
    Qd, named = DiscreteModel(MOVING).named_noise
    walks = DiscreteModel(MOVING).named_walks
    assert {k: (str(s), float(q)) for k, (s, q) in walks.items()} == {
        "gyro": ("K2__gyro", pytest.approx(4e-10))
    }
    assert {k: str(s) for k, (s, _) in named.items()} == {k: f"Q__{k}" for k in named}
    assert set(named) == {i.name for i in MOVING.motion.inputs}
    back = Qd.subs(dict([*named.values(), *walks.values()]))
    values = dict.fromkeys(back.free_symbols, 0.3)
    assert np.array(back.subs(values), float) == pytest.approx(
        np.array(DiscreteModel(MOVING).Qd.subs(values), float), rel=1e-12
    )
    before = float(named[MOVING.motion.inputs[0].name][1])
    uneven = MOVING.augment("gyro_x", make("white_noise", N=0.5))
    _, named = DiscreteModel(uneven).named_noise
    first = MOVING.motion.inputs[0]
    assert set(first.channels) <= set(named)
    assert float(named["gyro_x"][1]) == pytest.approx(0.25 + before)


def test_variances_of_samples() -> None:
    """A density over the period, quantisation by twice its rate squared, else the sensor's own; and what is left out."""
    accel = next(s for s in MOVING.sensors if s.name == "accel")
    d = DiscreteModel(MOVING, rate=50.0)
    assert d.sample_variance(accel, "accel_x") == pytest.approx(accel.sd**2)
    assert d.measurement_variance(accel, "accel_x") == pytest.approx(accel.sd**2 + accel.left_out**2 * 50.0)
    noisy = MOVING.augment("accel_x", make("white_noise", N=0.3))
    d = DiscreteModel(noisy, rate=50.0, rates={"accel": 20.0})
    assert d.sample_variance(accel, "accel_x") == pytest.approx(0.09 * 20.0)
    assert d.sample_variance(accel, "accel_y") == pytest.approx(accel.sd**2)
    stepped = noisy.augment("accel_x", make("quantisation", Q=0.01))
    d = DiscreteModel(stepped, rate=50.0)
    assert d.rate_of(accel) == 50.0
    assert d.sample_variance(accel, "accel_x") == pytest.approx(0.09 * 50.0 + 2.0 * 1e-4 * 2500.0)
    sampled = MOVING.augment("accel_x", make("sample_noise", sd=0.7))
    assert DiscreteModel(sampled).sample_variance(accel, "accel_x") == pytest.approx(0.49)


def test_the_hash_knows_every_option() -> None:
    plain = DiscreteModel(STATIC)
    others = [
        DiscreteModel(STATIC, order=2),
        DiscreteModel(STATIC, max_step=0.2),
        DiscreteModel(STATIC, rate=50.0),
        DiscreteModel(STATIC, rates={"gyro": 5.0}),
        DiscreteModel(MOVING),
    ]
    hashes = {d.hash for d in (plain, *others)}
    assert len(hashes) == 6
    assert DiscreteModel(STATIC, rates={"gyro": 100.0}).hash == plain.hash


def test_slopes_and_nesting() -> None:
    x = sp.Symbol("x", real=True)
    assert _slope(sp.sign(x) * x**2, x).subs(x, 3) == 6
    nested = _nested(1 + DT + DT**2)
    assert nested == DT * (DT + 1) + 1
    assert _nested(x) == x


def test_terms_that_say_nothing_are_left_out() -> None:
    """Of ``1 + dt + 1e-15 dt^2`` at a tenth of a second the last is below ``2^-40`` of the first."""
    d = DiscreteModel(STATIC)
    short = d._series(1 + DT + sp.Float(1e-15) * DT**2)
    assert sp.Poly(short, DT).all_coeffs() == [1.0, 1.0]
    kept = d._series(1 + DT + sp.Float(1e-9) * DT**2)
    assert kept.coeff(DT, 2) == pytest.approx(1e-9) or sp.Poly(kept, DT).coeff_monomial(
        DT**2
    ) == pytest.approx(1e-9)
    x = sp.Symbol("x")
    assert d._series(x * DT + DT) == _nested(x * DT + DT)


def test_a_velocity_is_stepped_in_the_axes_of_the_middle() -> None:
    """``v + dt (R (f + dt / 2 omega x f) + g)``: at no attitude, f = (1, 2, 3), omega = (0.3, -0.2, 0.5)."""
    d, dt = DiscreteModel(INS), 0.01
    f, w = np.array([1.0, 2.0, 3.0]), np.array([0.3, -0.2, 0.5])
    values: dict[str, float] = {"dt": dt, "g": 0.0}
    values |= {f"R_nb_{i}{j}": float(i == j) for i in range(3) for j in range(3)}
    values |= {f"accel_{a}": v for a, v in zip("xyz", f, strict=True)}
    values |= {f"gyro_{a}": v for a, v in zip("xyz", w, strict=True)}
    names = list(d.nominal_names)
    quaternion = {"w": 1.0, "x": 0.0, "y": 0.0, "z": 0.0}
    out = {}
    for name, e in zip(names, d.step, strict=True):
        known = {s: values.get(s.name, 0.0) for s in e.free_symbols}
        for s in known:
            if s.name.startswith("q_"):
                known[s] = quaternion[s.name[-1]]
        out[name] = float(e.subs(known))
    v = [out[n] for n in names if n.startswith("v_")]
    p = [out[n] for n in names if n.startswith("p_")]
    assert v == pytest.approx(dt * (f + 0.5 * dt * np.cross(w, f)), rel=1e-9)
    assert p == pytest.approx(0.5 * dt**2 * f, rel=1e-2)
    q = np.array([out[n] for n in names if n.startswith("q_")])
    assert q / np.linalg.norm(q) == pytest.approx([1.0, *(0.5 * dt * w)], abs=1e-5)


def test_a_force_acts_on_the_velocity_error_in_the_axes_of_the_middle() -> None:
    """First order: the entry of velocity by attitude is ``-dt [R (f + dt / 2 omega x f)]x``, in either sign."""
    d, dt = DiscreteModel(INS), 0.01
    f, w = np.array([1.0, 2.0, 3.0]), np.array([0.3, -0.2, 0.5])
    names = [s.name for s in INS.states]
    v, phi = (
        [k for k, n in enumerate(names) if n.startswith(f"d{c}_") or n.startswith(f"{c}_")]
        for c in ("v", "phi")
    )
    assert (len(v), len(phi)) == (3, 3), names
    values: dict[str, float] = {"dt": dt, "g": 0.0}
    values |= {f"R_nb_{i}{j}": float(i == j) for i in range(3) for j in range(3)}
    values |= {f"accel_{a}": x for a, x in zip("xyz", f, strict=True)}
    values |= {f"gyro_{a}": x for a, x in zip("xyz", w, strict=True)}
    block = d.Phi[v, phi]
    found = np.array(
        [
            [float(e.subs({s: values.get(s.name, 0.0) for s in e.free_symbols})) for e in row]
            for row in block.tolist()
        ]
    )
    u = f + 0.5 * dt * np.cross(w, f)
    skew = np.array([[0.0, -u[2], u[1]], [u[2], 0.0, -u[0]], [-u[1], u[0], 0.0]])
    assert np.abs(found) == pytest.approx(np.abs(dt * skew), rel=1e-9)
    assert found == pytest.approx(-dt * skew) or found == pytest.approx(dt * skew)


def test_within_a_backlash_nothing_follows() -> None:
    """A cart at q, seen through a width of 0.2 that stood at 0: at 0.05 it shows 0, at 0.3 it shows 0.2 and follows."""
    d = DiscreteModel(filter_model(parse_model(text_of(SIZES["backlash"]), "cart.toml")), rate=50.0)
    (sensor,) = d.model.sensors
    (q,) = d.model.clean(sensor)[0].free_symbols
    known = {str(s): s for s in d.expected(sensor).free_symbols}
    for at, shown, slope in ((0.05, 0.0, 0.0), (0.3, 0.2, 1.0), (-0.3, -0.2, 1.0)):
        values = {q: at, known["place_stood"]: 0.0, known["place_backlash_width"]: 0.2}
        assert float(d.expected(sensor)[0].subs(values)) == pytest.approx(shown, abs=1e-12)
        row = [float(e) for e in d.H(sensor).subs(values)]
        assert row == pytest.approx([slope, *([0.0] * (len(row) - 1))])


def test_an_input_acts_late_by_the_samples_that_are_kept() -> None:
    """A tank with an inlet 0.13 s late at 50 Hz: 6.5 periods, the mean of the samples six and seven periods ago."""
    d = DiscreteModel(filter_model(parse_model(INTEGRATOR % 0.13, "tank.toml")), rate=50.0)
    names = d.nominal_names
    assert len(names) == len(d.step) == len(d.start) == 1 + 7
    assert d.start[1:] == (0.0,) * 7
    ago = {"h": 2.0, "q": 0.0, "dt": 0.02, **{n: float(k) for k, n in enumerate(names[1:], 1)}}
    moved = [float(e.subs({s: ago[s.name] for s in e.free_symbols})) for e in d.step]
    assert moved[0] == pytest.approx(2.0 + 0.02 * 6.5)
    assert moved[1:] == [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0]
    at_once = DiscreteModel(filter_model(parse_model(text_of(), "cart.toml")), rate=50.0)
    assert len(at_once.nominal_names) == len(at_once.model.states)


def test_a_transition_has_the_late_samples_too() -> None:
    """``v' = u v``, u late by two periods: the transition of v is ``1 + dt u`` of the sample of then."""
    text = text_of('u = [ { effect = "input_delay", delay = 0.04 } ]').replace("u - 0.4*v", "u*v")
    d = DiscreteModel(filter_model(parse_model(text, "cart.toml")), rate=50.0)
    young, old = (m.name for m in d.memories)
    v = [s.name for s in d.model.states].index("v")
    known = {"u": 9.0, young: 7.0, old: 3.0, "dt": 0.02, "v": 0.0, "q": 0.0}
    moved = d.Phi[v, v]
    assert float(moved.subs({s: known[s.name] for s in moved.free_symbols})) == pytest.approx(
        1.0 + 0.02 * 3.0
    )


def test_only_noise_of_its_own_has_a_symbol() -> None:
    """Two axes whose noise is shared keep their densities, an axis without noise has none, the third has a symbol."""
    W = MOVING.W.copy()
    W[0, 1] = W[1, 0] = W[0, 0] / 2
    d = DiscreteModel(MOVING)
    shared = DiscreteModel(_with_density(W))
    assert set(d.named_noise[1]) == {"gyro"}
    assert set(shared.named_noise[1]) <= {"gyro", "gyro_z"}
    assert len(shared.named_noise[1]) == 1
    quiet = MOVING.W.copy()
    quiet[0, 0] = sp.Integer(0)
    assert set(DiscreteModel(_with_density(quiet)).named_noise[1]) == {"gyro_y", "gyro_z"}


def _with_density(W: sp.Matrix) -> FilterModel:
    """`MOVING` with other densities of its noises."""
    model = replace(MOVING)
    model.__dict__["W"] = W
    return model
