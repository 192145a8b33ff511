"""Proves that a plant is simulated as its equations say, with every effect, and that its scene finds them.

Expected motions come from scipy's integrators of equations that the test writes itself, at tolerances of 1e-10;
what an effect does is written anew for each (an actuator's lag as a state, a delay by breakpoints, a backlash by its
definition). Recovered numbers are held to 4.5 of their own standard deviations (7e-6 of the seeds for each of about
20 checks); seeds are fixed.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from in_part import in_part
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from kfgen.core.errors import InputError
from kfgen.effects import Effect, catalogue, make
from kfgen.effects.plant.terms import CoulombFriction, PlantEffect, StateTerm
from kfgen.gap.plant.candidates import moving
from kfgen.gap.plant.scene import PlantScene
from kfgen.gap.plant.updated_model import updated_model
from kfgen.gap.scene.scene import Placed, ScenePoint
from kfgen.log.log import Channel, Log
from kfgen.model.plant.file import model_text, parse_model
from kfgen.model.plant.plant import Batch, Plant, Run, simulate
from kfgen.model.plant.user import UserModel

Array = NDArray[np.float64]
G, B = 19.6, 25.0

PENDULUM = """
format = "kfgen-model-1"
name = "pendulum"
[parameters]
g_over_l = "19.6 1/s^2"
gain = "25"
[states]
omega = "rad/s"
theta = "rad"
[inputs]
u = "N m"
[dynamics]
theta = "omega"
omega = "-g_over_l*sin(theta) + gain*u"
[measurements.angle]
unit = "deg"
expression = "theta"
effects = [ { effect = "white_noise", N = "0.02 deg/sqrt(Hz)" } ]
"""
SMOOTH = PENDULUM.replace('u = "N m"', 'ref_u = "N m"').replace("gain*u", "gain*ref_u")
START = {"omega": -0.4, "theta": 0.3}


def push(t: Array) -> Array:
    """A torque in both directions that changes its size."""
    return np.asarray(0.25 * np.sign(np.sin(2.1 * t)) * np.cos(0.37 * t))


def wave(t: Array | float) -> Any:
    return 0.2 * np.sin(1.3 * np.asarray(t)) + 0.1 * np.cos(3.1 * np.asarray(t))


def pendulum(u: float, extra: Callable[[float, float], float] = lambda w, p: 0.0) -> Any:
    return lambda _, x: [-G * np.sin(x[1]) + B * u + extra(x[0], x[1]), x[0]]


def motion(t: Array, u: Array, extra: Callable[[float, float], float], breaks: float = 0.0) -> Array:
    """States at the samples, (n, 2), the input held and late by `breaks` [s], by scipy."""
    edges = np.unique(np.concatenate([t, t + breaks]))
    edges = edges[edges <= t[-1]]
    x, out = np.array([START["omega"], START["theta"]]), {0.0: np.array([START["omega"], START["theta"]])}
    for a, b in itertools.pairwise(edges):
        k = max(int(np.searchsorted(t + breaks, 0.5 * (a + b))) - 1, 0)
        x = solve_ivp(pendulum(u[k], extra), (a, b), x, method="DOP853", rtol=1e-10, atol=1e-12).y[:, -1]
        out[b] = x
    return np.array([out[s] for s in t])


def none(w: float, p: float) -> float:
    return 0.0


TIMES = np.arange(400) * 0.02
TERMS: dict[str, tuple[dict[str, float], Callable[[float, float], float]]] = {
    "viscous_friction": ({"coefficient": 0.5}, lambda w, p: -0.5 * w),
    "coulomb_friction": ({"level": 0.7, "v0": 0.2}, lambda w, p: -0.7 * np.tanh(w / 0.2)),
    "quadratic_drag": ({"coefficient": 0.4}, lambda w, p: -0.4 * w * abs(w)),
    "constant_input": ({"value": 0.9}, lambda w, p: 0.9),
    "spring": ({"coefficient": 3.0}, lambda w, p: -3.0 * p),
    "cubic_spring": ({"coefficient": 5.0}, lambda w, p: -5.0 * p**3),
}


def run(
    placed: list[tuple[str, Effect]], t: Array, u: Array, text: str = PENDULUM, name: str = "u"
) -> tuple[Array, Array]:
    """States (n, 2) and the angle (n,) by the code under test."""
    model = parse_model(text, "pendulum.toml")
    parameters = {n: np.array([p.value]) for n, p in model.parameters.items()}
    effects = tuple((w, e) for w, e in placed if isinstance(e, PlantEffect))
    X0 = np.array([START[n] for n in model.states]).reshape(1, 2, 1)
    found = Plant(model, [(w, type(e)) for w, e in effects]).simulate(
        t, {name: u}, Batch(parameters, effects, X0)
    )
    return found.states[:, :, 0], found.channels["angle"][:, 0]


def test_every_term_has_its_law_here() -> None:
    assert {n for n, c in catalogue().items() if issubclass(c, StateTerm)} == set(TERMS)


@pytest.mark.parametrize("name", list(TERMS))
def test_a_term_moves_the_plant_as_its_law_says(name: str) -> None:
    values, law = TERMS[name]
    X = motion(TIMES, push(TIMES), law)
    states, angle = run([("omega", make(name, **values))], TIMES, push(TIMES))
    np.testing.assert_allclose(states, X, atol=2e-4 if name == "coulomb_friction" else 5e-5)
    np.testing.assert_array_equal(angle, states[:, 1])
    without, _ = run([], TIMES, push(TIMES))
    assert np.abs(without - X).max() > 0.05


def test_uneven_times() -> None:
    t = np.cumsum(np.random.default_rng(3).uniform(0.003, 0.05, 300))
    t -= t[0]
    states, _ = run([], t, push(t))
    np.testing.assert_allclose(states, motion(t, push(t), none), atol=5e-5)


def test_a_smooth_input_is_interpolated() -> None:
    x0 = [START["omega"], START["theta"]]
    exact = solve_ivp(
        lambda s, x: pendulum(wave(s))(s, x), (0, TIMES[-1]), x0, "DOP853", TIMES, rtol=1e-10, atol=1e-12
    ).y.T
    states, _ = run([], TIMES, wave(TIMES), SMOOTH, "ref_u")
    np.testing.assert_allclose(states, exact, atol=5e-5)
    held, _ = run([], TIMES, wave(TIMES))
    assert np.abs(held - exact).max() > 1e-2


@pytest.mark.parametrize("delay", [0.011, 0.02, 0.0737])
def test_a_held_input_that_is_late(delay: float) -> None:
    X = motion(TIMES, push(TIMES), none, breaks=delay)
    states, _ = run([("u", make("input_delay", delay=delay))], TIMES, push(TIMES))
    np.testing.assert_allclose(states[:, 1], X[:, 1], atol=3e-4)  # half a step's mean for a jump inside it
    assert np.abs(run([], TIMES, push(TIMES))[0] - X).max() > 0.02


def test_a_smooth_input_that_is_late() -> None:
    x0 = [START["omega"], START["theta"]]

    def late(s: float, x: Array) -> Any:
        return pendulum(wave(max(s - 0.0737, 0.0)))(s, x)

    exact = solve_ivp(late, (0, TIMES[-1]), x0, "DOP853", TIMES, rtol=1e-10, atol=1e-12, max_step=0.01).y.T
    placed = [("ref_u", make("input_delay", delay=0.0737))]
    states, _ = run(placed, TIMES, wave(TIMES), SMOOTH, "ref_u")
    np.testing.assert_allclose(states, exact, atol=3e-4)


@pytest.mark.parametrize("tau", [0.004, 0.05, 0.4])
def test_an_actuator_with_a_lag(tau: float) -> None:
    u = push(TIMES)
    x = np.array([START["omega"], START["theta"], u[0]])
    X = [x]
    for k in range(TIMES.size - 1):
        x = solve_ivp(
            lambda s, x, v=u[k]: [-G * np.sin(x[1]) + B * x[2], x[0], (v - x[2]) / tau],
            (TIMES[k], TIMES[k + 1]), x, method="DOP853", rtol=1e-10, atol=1e-12,
        ).y[:, -1]  # fmt: skip
        X.append(x)
    states, _ = run([("u", make("input_lag", tau=tau))], TIMES, u)
    np.testing.assert_allclose(states, np.array(X)[:, :2], atol=1e-3 if tau < 0.01 else 1e-4)


@pytest.mark.parametrize("tau", [1e-5, 4e-4, 3e-3, 0.02, 0.3])
@pytest.mark.parametrize("delay", [0.0, 0.013])
def test_a_lag_however_short_passes_the_whole_input(tau: float, delay: float) -> None:
    """An integrator behind it, in closed form: what has passed is what came in less ``tau`` times what is behind."""
    u, t = push(TIMES), TIMES
    edges = np.concatenate([[0.0], t + delay])
    lagged, total, out = u[0], 0.0, []
    moments = np.unique(np.concatenate([edges, t]))
    for a, b in itertools.pairwise(moments[moments <= t[-1] + 1e-12]):
        v = u[max(int(np.searchsorted(t + delay, 0.5 * (a + b))) - 1, 0)]
        if np.any(np.abs(t - a) < 1e-12):
            out.append(total)
        total += v * (b - a) + tau * (lagged - v) * -np.expm1(-(b - a) / tau)
        lagged = v + (lagged - v) * np.exp(-(b - a) / tau)
    out.append(total)
    text = PENDULUM.replace("-g_over_l*sin(theta) + gain*u", "u")
    placed = [("u", make("input_lag", tau=tau)), ("u", make("input_delay", delay=delay))]
    states, _ = run(placed if delay else placed[:1], t, u, text)
    np.testing.assert_allclose(states[:, 0] - START["omega"], out, atol=1e-12)


def test_a_smooth_input_behind_a_lag() -> None:
    tau, x0 = 0.15, [START["omega"], START["theta"], float(wave(0.0))]

    def law(s: float, x: Array) -> Any:
        return [-G * np.sin(x[1]) + B * x[2], x[0], (wave(s) - x[2]) / tau]

    exact = solve_ivp(law, (0, TIMES[-1]), x0, "DOP853", TIMES, rtol=1e-10, atol=1e-12).y.T
    states, _ = run([("ref_u", make("input_lag", tau=tau))], TIMES, wave(TIMES), SMOOTH, "ref_u")
    np.testing.assert_allclose(states, exact[:, :2], atol=1e-3)


def test_a_nonlinear_and_a_saturated_actuator() -> None:
    u = push(TIMES)
    bent, _ = run([("u", make("input_nonlinearity", k2=0.8, k3=-1.5))], TIMES, u)
    np.testing.assert_allclose(bent, motion(TIMES, u + 0.8 * u**2 - 1.5 * u**3, none), atol=5e-5)
    square, _ = run([("u", make("square_law", share=0.6, full=0.3))], TIMES, u)
    np.testing.assert_allclose(square, motion(TIMES, 0.4 * u + 2.0 * u * np.abs(u), none), atol=5e-5)
    cut, _ = run([("u", make("saturation", limit=0.1))], TIMES, u)
    np.testing.assert_allclose(cut, motion(TIMES, np.clip(u, -0.1, 0.1), none), atol=5e-5)
    dead, _ = run([("u", make("input_dead_zone", width=0.1))], TIMES, u)
    beyond = np.where(np.abs(u) > 0.1, u - 0.1 * np.sign(u), 0.0)
    np.testing.assert_allclose(dead, motion(TIMES, beyond, none), atol=5e-5)


def test_lag_and_delay_together() -> None:
    tau, delay, u = 0.05, 0.04, push(TIMES)  # two samples: the input acts from a later sample on
    x, X = np.array([START["omega"], START["theta"], u[0]]), []
    for k in range(TIMES.size):
        X.append(x)
        v = u[max(k - 2, 0)]
        x = solve_ivp(
            lambda s, x, v=v: [-G * np.sin(x[1]) + B * x[2], x[0], (v - x[2]) / tau],
            (0.0, 0.02), x, method="DOP853", rtol=1e-10, atol=1e-12,
        ).y[:, -1]  # fmt: skip
    placed = [("u", make("input_lag", tau=tau)), ("u", make("input_delay", delay=delay))]
    states, _ = run(placed, TIMES, u)
    np.testing.assert_allclose(states, np.array(X)[:, :2], atol=1e-4)


def test_a_slow_sensor() -> None:
    tau = 0.06

    def law(s: float, x: Array) -> Any:
        return [*pendulum(wave(s))(s, x[:2]), (x[1] - x[2]) / tau]

    x0 = [START["omega"], START["theta"], START["theta"] - tau * START["omega"]]
    exact = solve_ivp(law, (0, TIMES[-1]), x0, "DOP853", TIMES, rtol=1e-10, atol=1e-12).y[2]
    _, angle = run([("angle", make("sensor_lag", tau=tau))], TIMES, wave(TIMES), SMOOTH, "ref_u")
    settled = 8 * tau < TIMES
    np.testing.assert_allclose(
        angle[settled], exact[settled], atol=4e-4
    )  # linear between samples: dt^2 theta'' / 12
    assert np.abs(angle - exact).max() < 5e-3


def test_a_backlash() -> None:
    states, angle = run([("angle", make("backlash", width=0.1))], TIMES, push(TIMES))
    now, wanted = states[0, 1], []
    for h in states[:, 1]:
        if h - now > 0.05:
            now = h - 0.05
        elif now - h > 0.05:
            now = h + 0.05
        wanted.append(now)
    np.testing.assert_allclose(angle, wanted, atol=1e-14)


@pytest.mark.long
def test_a_stiff_plant_takes_more_parts_and_a_batch_is_its_columns() -> None:
    text = PENDULUM.replace('"25"', '"25"\nR_over_L = "400 1/s"').replace(
        'theta = "rad"\n', 'theta = "rad"\ni = "A"\n'
    ).replace('theta = "omega"', 'theta = "omega"\ni = "R_over_L*(u - i)"').replace("gain*u", "gain*i")  # fmt: skip
    model = parse_model(text, "m")
    t, u = TIMES[:200], push(TIMES[:200])
    rates = np.array([300.0, 400.0, 500.0])
    parameters = {"g_over_l": np.full(3, G), "gain": np.full(3, B), "R_over_L": rates}
    X0 = np.zeros((1, 3, 3))
    X0[0, :2] = [[-0.4], [0.3]]
    plant = Plant(model, [])
    found = plant.simulate(t, {"u": u}, Batch(parameters, (), X0))
    assert found.substeps > 4
    for j, rate in enumerate(rates):
        x, X = np.array([-0.4, 0.3, 0.0]), []
        for k in range(t.size):
            X.append(x)
            x = solve_ivp(
                lambda s, x, v=u[k], r=rate: [-G * np.sin(x[1]) + B * x[2], x[0], r * (v - x[2])],
                (0.0, 0.02), x, method="Radau", rtol=1e-9, atol=1e-11,
            ).y[:, -1]  # fmt: skip
        np.testing.assert_allclose(found.states[:, :2, j], np.array(X)[:, :2], atol=1e-4)


def test_a_column_that_is_far_stiffer_than_the_others_is_not_followed_and_does_not_hold_them_up() -> None:
    """A search tries what leads astray beside what does not: that decides how finely all are simulated."""
    model = parse_model(PENDULUM, "m")
    plant = Plant(model, [("omega", CoulombFriction)])
    levels = np.array([0.5, 0.6, 1e4, 1e5, 1e6])
    X0 = np.repeat(np.array([[[START[n]] for n in model.states]]), levels.size, axis=2)
    parameters = {n: np.full(levels.size, p.value) for n, p in model.parameters.items()}

    def of(columns: slice) -> Run:
        friction = CoulombFriction(level=levels[columns], v0=np.full(levels[columns].size, 0.2))
        batch = Batch(
            {n: v[columns] for n, v in parameters.items()}, (("omega", friction),), X0[:, :, columns]
        )
        return plant.simulate(TIMES, {"u": push(TIMES)}, batch, most=32)

    every, calm, stiff = of(slice(None)), of(slice(2)), of(slice(4, 5))
    assert every.substeps <= 4 * calm.substeps < 32 == stiff.substeps
    np.testing.assert_allclose(every.states[:, :, :2], calm.states, atol=1e-3)
    assert np.isnan(every.states[:, :, 3:]).all()
    assert np.isfinite(stiff.states).all()  # alone it is what there is


def test_without_numba_the_numbers_are_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    placed = [
        ("omega", make("coulomb_friction", level=0.7, v0=0.2)),
        ("u", make("input_lag", tau=0.05)),
        ("angle", make("sensor_lag", tau=0.02)),
    ]
    fast = run(placed, TIMES, push(TIMES))[0]
    monkeypatch.setitem(__import__("sys").modules, "kfgen.model.plant.compiled", None)
    np.testing.assert_allclose(run(placed, TIMES, push(TIMES))[0], fast, rtol=1e-9, atol=1e-12)


def test_every_function_is_the_same_compiled_and_by_numpy(monkeypatch: pytest.MonkeyPatch) -> None:
    rate = (
        "0.1*(sin(x) + cos(x) + tan(x/3) + asin(x/9) + acos(x/9) + atan(x) + atan2(x, 2) + exp(-x) + log(2+x**2)"
        " + sqrt(1+x**4) - abs(x) - sign(x) - min(x, 1, u) - max(x, u) - 2*tanh(x) + x**-2/(1+u**2) - (1+x**2)**0.3)"
    )
    text = f"""
format = "kfgen-model-1"
name = "all"
[states]
x = "1"
[inputs]
u = "1"
[dynamics]
x = "{rate}"
[measurements.y]
unit = "1"
expression = "x**3"
"""
    model, t = parse_model(text, "all"), np.arange(50) * 0.02
    u = np.sin(3 * t)
    fast = simulate(model, t, {"u": u}, {"x": 1.3})
    monkeypatch.setitem(__import__("sys").modules, "kfgen.model.plant.compiled", None)
    slow = simulate(model, t, {"u": u}, {"x": 1.3})
    np.testing.assert_allclose(fast.states, slow.states, rtol=1e-12)
    np.testing.assert_allclose(fast.channels["y"][:, 0], slow.states[:, 0, 0] ** 3, rtol=1e-12)
    names = {"x": 1.3, "u": 0.0}
    f = {n: getattr(np, n) for n in ("sin", "cos", "tan", "exp", "log", "sqrt", "abs", "sign", "tanh")}
    f |= {
        "asin": np.arcsin,
        "acos": np.arccos,
        "atan": np.arctan,
        "atan2": np.arctan2,
        "min": min,
        "max": max,
    }
    slope = eval(rate, {"__builtins__": {}}, f | names)  # the test's own text
    assert (fast.states[1, 0, 0] - 1.3) / 0.02 == pytest.approx(slope, rel=0.05)


def test_a_plant_that_runs_away_is_said_with_its_time() -> None:
    text = PENDULUM.replace("-g_over_l*sin(theta)", "g_over_l*theta**3")
    with pytest.raises(InputError, match=r"diverges at t = \d"):
        simulate(parse_model(text, "m.toml"), TIMES, {"u": push(TIMES)}, START)
    with pytest.raises(InputError, match="input 'u' of pendulum is missing"):
        simulate(parse_model(PENDULUM, "m.toml"), TIMES, {})


# The scene.

NOISE = np.deg2rad(0.02)  # [rad/sqrt(Hz)]


def recorded(angle: Array, t: Array, u: Array, seed: int, name: str = "u") -> Log:
    """A log of the angle in degrees with white noise of the declared density."""
    noise = NOISE / np.sqrt(t[1] - t[0]) * np.random.default_rng(seed).standard_normal(t.size)
    return Log(t, {"angle": Channel.of(np.rad2deg(angle + noise), "deg"), name: Channel.of(u, "N m")})


def moved(point: ScenePoint, values: Array) -> ScenePoint:
    """A point with its effects' estimated numbers and unknowns set."""
    placed, at = [], 0
    for p in point.placed:
        names = [q.name for q in p.effect.estimated()]
        effect = type(p.effect)(**{q.name: getattr(p.effect, q.name) for q in p.effect.parameters()} | dict(zip(names, values[at:].tolist())))  # fmt: skip
        placed.append(Placed(effect, p.where))
        at += len(names)
    return ScenePoint(tuple(placed), values[at:])


def gauss_newton(scene: PlantScene, start: ScenePoint) -> tuple[Array, Array, Array]:
    """Numbers, their standard deviations, residuals: differences of residuals, steps halved while they do not help."""
    x = np.array(
        [float(getattr(p.effect, q.name)) for p in start.placed for q in p.effect.estimated()]
        + start.unknowns.tolist()
    )
    h = 1e-5 * np.maximum(np.abs(x), 0.1)
    for _ in range(25):
        R = scene.residuals([moved(start, x), *(moved(start, x + d) for d in np.diag(h))])
        r, J = R[:, 0], (R[:, 1:] - R[:, :1]) / h
        d = np.linalg.lstsq(J, -r, rcond=None)[0]
        shares = 0.5 ** np.arange(8)
        tried = scene.residuals([moved(start, x + s * d) for s in shares])
        best = int(np.argmin((tried**2).sum(axis=0)))
        gain = float(r @ r - tried[:, best] @ tried[:, best])
        if gain <= 0.0:
            break
        x = x + shares[best] * d
        r = tried[:, best]
        if gain < 1e-4:
            break
    return x, np.sqrt(np.diag(np.linalg.pinv(J.T @ J, hermitian=True))), r


LONG = np.arange(2000) * 0.02


def scene_of(angle: Array, seed: int, text: str = PENDULUM) -> PlantScene:
    return PlantScene.of(parse_model(text, "pendulum.toml"), recorded(angle, LONG, push(LONG), seed))


def white(r: Array) -> None:
    """Mean square one and no correlation of neighbours, within 4.5 standard deviations."""
    assert abs(np.mean(r**2) - 1.0) < 4.5 * np.sqrt(2.0 / r.size)
    assert abs(np.mean(r[1:] * r[:-1])) < 4.5 / np.sqrt(r.size)


def test_a_right_model_leaves_white_residuals_over_the_whole_record() -> None:
    scene = scene_of(motion(LONG, push(LONG), none)[:, 1], 1)
    assert scene.starts == (0,)
    assert scene.channels == ("angle",)
    assert scene.lengths == (2000,)
    assert scene.dt == pytest.approx(0.02)
    assert scene.span == (0.0, pytest.approx(39.98))
    assert [u.name for u in scene.unknowns] == ["omega at 0 s", "theta at 0 s"]
    x, sd, r = gauss_newton(scene, scene.assumed())
    white(r)
    assert np.all(np.abs(x - [-0.4, 0.3]) < 4.5 * sd)


@pytest.mark.parametrize(
    ("name", "values"),
    in_part(
        [
            ("viscous_friction", {"coefficient": 0.3}),
            pytest.param("quadratic_drag", {"coefficient": 0.1}, marks=pytest.mark.long),
            pytest.param("constant_input", {"value": 0.2}, marks=pytest.mark.long),
            pytest.param("spring", {"coefficient": 0.5}, marks=pytest.mark.long),
            ("cubic_spring", {"coefficient": 0.5}),
            ("coulomb_friction", {"level": 0.3}),
        ]
    ),
)
def test_a_missing_term_is_recovered(name: str, values: dict[str, float]) -> None:
    laws: dict[str, Callable[[float, float], float]] = {
        "viscous_friction": lambda w, p: -0.3 * w,
        "quadratic_drag": lambda w, p: -0.1 * w * abs(w),
        "constant_input": lambda w, p: 0.2,
        "spring": lambda w, p: -0.5 * p,
        "cubic_spring": lambda w, p: -0.5 * p**3,
        "coulomb_friction": lambda w, p: -0.3 * np.tanh(w / 0.01),
    }
    scene = scene_of(motion(LONG, push(LONG), laws[name])[:, 1], 2)
    before = scene.residuals([scene.assumed()])
    assert np.mean(before**2) > 2.0
    (start,) = next(c for c in scene.candidates([]) if c[0].effect.name == name)
    assert start.where == "omega"
    x, sd, r = gauss_newton(scene, scene.assumed([start]))
    (wanted,) = values.values()
    slack = 0.02 * abs(wanted) if name == "coulomb_friction" else 0.0  # smooth over another speed
    assert abs(x[0] - wanted) < 4.5 * sd[0] + slack
    assert sd[0] < 0.1 * abs(wanted)
    white(r)
    found = updated_model(scene.model, moved(scene.assumed([start]), x).placed)
    again = parse_model(model_text(found), "again.toml")
    assert again.dynamics_effects[0].where == "omega"
    white(gauss_newton(PlantScene.of(again, scene.log), PlantScene.of(again, scene.log).assumed())[2])


def changed(name: str) -> Array:
    """The angle with a change of the input or the sensor, by scipy."""
    u = push(LONG)
    if name == "input_delay":
        return np.asarray(motion(LONG, u, none, breaks=0.05)[:, 1])
    if name == "input_nonlinearity":
        return np.asarray(motion(LONG, u + 0.3 * u**2 - 0.6 * u**3, none)[:, 1])
    if name == "square_law":
        return np.asarray(motion(LONG, 0.3 * u + 0.7 * u * np.abs(u) / np.abs(u).max(), none)[:, 1])
    if name == "saturation":
        return np.asarray(motion(LONG, np.clip(u, -0.18, 0.18), none)[:, 1])
    if name == "input_dead_zone":
        beyond = np.where(np.abs(u) > 0.02, u - 0.02 * np.sign(u), 0.0)
        return np.asarray(motion(LONG, beyond, none)[:, 1])
    x, X = np.array([START["omega"], START["theta"], u[0]]), []
    for k in range(LONG.size):
        X.append(x)
        x = solve_ivp(
            lambda s, x, v=u[k]: [-G * np.sin(x[1]) + B * x[2], x[0], (v - x[2]) / 0.06],
            (0.0, 0.02), x, method="DOP853", rtol=1e-9, atol=1e-11,
        ).y[:, -1]  # fmt: skip
    return np.array(X)[:, 1]


@pytest.mark.parametrize(
    ("name", "wanted"),
    in_part(
        [
            ("input_delay", [0.05]),
            pytest.param("input_lag", [0.06], marks=pytest.mark.long),
            ("input_nonlinearity", [0.3, -0.6]),
            ("square_law", [0.7]),
            ("saturation", [0.18]),
            ("input_dead_zone", [0.02]),
        ]
    ),
)
def test_a_change_of_the_input_is_recovered(name: str, wanted: list[float]) -> None:
    scene = scene_of(changed(name), 3)
    starts = next(c for c in scene.candidates([]) if c[0].effect.name == name)
    fits = [gauss_newton(scene, scene.assumed([s])) for s in starts]
    x, sd, r = min(fits, key=lambda f: float(f[2] @ f[2]))
    assert np.all(np.abs(x[: len(wanted)] - wanted) < 4.5 * sd[: len(wanted)])
    white(r)


def test_a_wrong_parameter_is_recovered_and_corrected_in_its_place() -> None:
    text = PENDULUM.replace("19.6", "18.5")
    scene = scene_of(motion(LONG, push(LONG), none)[:, 1], 4, text)
    (start,) = next(c for c in scene.candidates([]) if c[0].where == "g_over_l")
    assert scene.unit(start) == "1/s^2"
    x, sd, r = gauss_newton(scene, scene.assumed([start]))
    assert abs(x[0] - 1.1) < 4.5 * sd[0]
    white(r)
    found = updated_model(scene.model, moved(scene.assumed([start]), x).placed)
    assert found.parameters["g_over_l"].value == pytest.approx(18.5 + x[0])
    assert not found.dynamics_effects


def test_a_parameter_that_is_not_trusted_is_an_unknown() -> None:
    text = PENDULUM.replace('"25"', '{ value = "24", sd = "2" }')
    scene = scene_of(motion(LONG, push(LONG), none)[:, 1], 5, text)
    last = scene.unknowns[-1]
    assert (last.name, last.value, last.sd) == ("gain", 24.0, 2.0)
    assert not [c for c in scene.candidates([]) if c[0].where == "gain"]
    x, sd, r = gauss_newton(scene, scene.assumed())
    assert abs(x[-1] - 25.0) < 4.5 * sd[-1]
    white(r)
    assert updated_model(scene.model, [], {"gain": 25.1}).parameters["gain"].value == 25.1


def test_candidates_are_at_sensible_places_once() -> None:
    scene = scene_of(motion(LONG, push(LONG), none)[:, 1], 6)
    found = {(c[0].where, c[0].effect.name) for c in scene.candidates([])}
    assert found == {
        *(("omega", n) for n in TERMS),
        *(
            ("u", n)
            for n in (
                "input_delay",
                "input_lag",
                "input_nonlinearity",
                "square_law",
                "saturation",
                "input_dead_zone",
            )
        ),
        *(("angle", n) for n in ("sensor_lag", "backlash")),
        ("g_over_l", "parameter_error"),
        ("gain", "parameter_error"),
    }
    there = [Placed(make("viscous_friction", coefficient=0.1), "omega")]
    less = {(c[0].where, c[0].effect.name) for c in scene.candidates(there)}
    assert found - less == {("omega", "viscous_friction")}
    for starts in scene.candidates([]):
        for s in starts:
            for p in s.effect.estimated():
                value = float(getattr(s.effect, p.name))
                assert value > 0.0 if p.kind != "signed" else value == 0.0
            assert np.isfinite(scene.residuals([scene.assumed([s])])).all()


def test_residuals_of_different_points_are_those_of_each() -> None:
    scene = scene_of(motion(LONG, push(LONG), none)[:, 1], 7)
    points = [scene.assumed([c[0]]) for c in scene.candidates([])] + [scene.assumed()]
    together = scene.residuals(points)
    for j, p in enumerate(points):
        np.testing.assert_allclose(together[:, j], scene.residuals([p])[:, 0], rtol=1e-9, atol=1e-9)


def test_a_chaotic_plant_is_followed_in_segments() -> None:
    t = np.arange(3000) * 0.02
    u = 0.9 * np.cos(2.9 * t)
    X = motion(t, u, lambda w, p: -0.4 * w)
    text = PENDULUM.replace("gain*u", "gain*u - 0.4*omega").replace('unit = "deg"', 'unit = "rad"').replace("0.02 deg", "0.002 rad")  # fmt: skip
    rng = np.random.default_rng(9)
    y = X[:, 1] + 0.002 * np.sqrt(50.0) * rng.standard_normal(t.size)
    log = Log(t, {"angle": Channel.of(y, "rad"), "u": Channel.of(u, "N m")})
    scene = PlantScene.of(parse_model(text, "chaos.toml"), log)
    assert np.isfinite(scene.residuals([scene.assumed()])).all()
    x, _, r = gauss_newton(scene, scene.assumed())
    assert len(x) == 2 * len(scene.starts)
    white(r)


def test_an_unstable_plant_has_finite_residuals() -> None:
    text = PENDULUM.replace("-g_over_l*sin(theta)", "g_over_l*sin(theta) - 20*theta - omega")
    model = parse_model(text, "m.toml")
    angle = simulate(model, LONG, {"u": push(LONG)}, START).channels["angle"][:, 0]
    scene = PlantScene.of(model, recorded(angle, LONG, push(LONG), 10))
    wild = ScenePoint(
        (Placed(make("viscous_friction", coefficient=-50.0), "omega"),), scene.assumed().unknowns
    )
    assert np.isfinite(scene.residuals([wild])).all()


def test_a_channel_with_gaps_and_one_that_is_slow() -> None:
    X = motion(LONG, push(LONG), none)
    angle, speed = X[:, 1].copy(), X[:, 0].copy()
    rng = np.random.default_rng(11)
    angle += NOISE * np.sqrt(50.0) * rng.standard_normal(LONG.size)
    speed[np.arange(LONG.size) % 5 != 0] = np.nan
    speed += 0.01 * np.sqrt(10.0) * rng.standard_normal(LONG.size)
    text = PENDULUM + '[measurements.gyro]\nunit = "rad/s"\nexpression = "omega"\neffects = [ { effect = "white_noise", N = 0.01 } ]\n'  # fmt: skip
    channels = {"angle": Channel.of(angle, "rad"), "gyro": Channel.of(speed, "rad/s"), "u": Channel.of(push(LONG), "N m")}  # fmt: skip
    scene = PlantScene.of(parse_model(text, "m.toml"), Log(LONG, channels))
    assert scene.lengths == (2000, 400)
    r = gauss_newton(scene, scene.assumed())[2]
    white(r[:2000])
    white(r[2000:])


def good_log() -> Log:
    return recorded(motion(LONG[:100], push(LONG[:100]), none)[:, 1], LONG[:100], push(LONG[:100]), 12)


@pytest.mark.parametrize(
    ("text", "channels", "what"),
    [
        (PENDULUM, {"angle": "rad"}, "channel 'u' is missing"),
        (PENDULUM, {"u": "N m"}, "no measurement of pendulum is in the log"),
        (PENDULUM, {"u": "N m", "angle": "m"}, "angle is in m in the log, pendulum needs deg"),
        (PENDULUM, {"u": "V", "angle": "deg"}, "u is in V in the log, pendulum needs N m"),
        (PENDULUM.replace("effects = [", "#"), {"u": "N m", "angle": "deg"}, "no white noise"),
    ],
)
def test_a_log_that_does_not_fit_is_refused(text: str, channels: dict[str, str], what: str) -> None:
    log = good_log()
    chosen = {n: Channel.of(log.channels[n].values, unit) for n, unit in channels.items()}
    with pytest.raises(InputError, match=what):
        PlantScene.of(parse_model(text, "m.toml"), Log(log.t, chosen))


def test_moving_states_are_those_with_a_force() -> None:
    text = PENDULUM.replace('theta = "rad"\n', 'theta = "rad"\nbias = "rad"\n').replace('theta = "omega"', 'theta = "omega"\nbias = "0"')  # fmt: skip
    model: UserModel = parse_model(text, "m")
    assert moving(model) == ["omega"]


def test_a_state_that_nothing_shows_has_a_finite_prior() -> None:
    text = PENDULUM.replace("-g_over_l*sin(theta)", "-g_over_l*omega").replace('"theta"', '"omega"').replace(
        'unit = "deg"', 'unit = "rad/s"'
    ).replace("0.02 deg", "0.02 rad/s")  # fmt: skip
    t, u = LONG[:500], push(LONG[:500])
    model = parse_model(text.replace('[dynamics]\ntheta = "theta"', '[dynamics]\ntheta = "omega"'), "m")
    speed = simulate(model, t, {"u": u}, START).channels["angle"][:, 0]
    speed = speed + 0.02 * np.sqrt(50.0) * np.random.default_rng(13).standard_normal(t.size)
    scene = PlantScene.of(model, Log(t, {"angle": Channel.of(speed, "rad/s"), "u": Channel.of(u, "N m")}))
    sds = {v.name: v.sd for v in scene.unknowns}
    assert sds == {"omega at 0 s": np.inf, "theta at 0 s": 3.0}


FREE = """
format = "kfgen-model-1"
name = "free"
[parameters]
k = "30 1/s^2"
[states]
x = "m"
v = "m/s"
[dynamics]
x = "v"
v = "-k*x"
[measurements.x]
unit = "mm"
expression = "x"
effects = [ { effect = "white_noise", N = "0.1 mm/sqrt(Hz)" } ]
"""


def test_a_free_motion_that_dies_away_at_uneven_times() -> None:
    rng = np.random.default_rng(14)
    t = np.cumsum(rng.uniform(0.008, 0.012, 3000))
    c, w = 0.2, np.sqrt(30.0 - 0.01)
    x = 0.05 * np.exp(-0.5 * c * t) * np.cos(w * t)  # x'' + c x' + 30 x = 0
    noise = 1e-4 * np.sqrt(100.0) * rng.standard_normal(t.size)
    scene = PlantScene.of(parse_model(FREE, "free.toml"), Log(t, {"x": Channel.of(x + noise, "m")}))
    (start,) = next(s for s in scene.candidates([]) if s[0].effect.name == "viscous_friction")
    assert {s[0].where for s in scene.candidates([])} == {"v", "x", "k"}
    values, sd, r = gauss_newton(scene, scene.assumed([start]))
    assert abs(values[0] - c) < 4.5 * sd[0]
    white(r)


def test_a_model_without_states() -> None:
    text = FREE.replace('k = "30 1/s^2"', 'R = "2 V/A"').replace(
        '[states]\nx = "m"\nv = "m/s"\n[dynamics]\nx = "v"\nv = "-k*x"', '[inputs]\ni = "A"'
    ).replace('"x"', '"R*i"').replace("mm", "mV").replace("measurements.x", "measurements.U")  # fmt: skip
    model, t = parse_model(text, "m.toml"), LONG[:500]
    rng = np.random.default_rng(15)
    u = 2.1 * push(t) + 1e-4 * np.sqrt(50.0) * rng.standard_normal(t.size)
    np.testing.assert_allclose(
        simulate(model, t, {"i": push(t)}).channels["U"][:, 0], 2.0 * push(t), rtol=1e-14
    )
    scene = PlantScene.of(model, Log(t, {"U": Channel.of(u, "V"), "i": Channel.of(push(t), "A")}))
    assert scene.unknowns == ()
    (start,) = next(s for s in scene.candidates([]) if s[0].where == "R")
    values, sd, r = gauss_newton(scene, scene.assumed([start]))
    assert abs(values[0] - 0.1) < 4.5 * sd[0]
    white(r)
