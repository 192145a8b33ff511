"""Laws of every library model, with every option, convention and sensor: a new one is under them by being declared.

Truth and estimate are composed without linearising, by formulas written here; both move by the model's nonlinear
equations, differentiated in time by a complex step. What grows between them, by fourth-order differences over the
error, is what F and G must say; what differs between their measurements is what H must say.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cache
from typing import Any

import numpy as np
import pytest
import sympy as sp
from in_part import in_part
from scipy.linalg import expm

from kfgen.effects import make
from kfgen.model.discretise import DiscreteModel
from kfgen.model.filter import FilterModel
from kfgen.model.library import LIBRARY, Resting, build
from kfgen.model.option import STATE, Choice, Names, OrState, YesNo
from kfgen.model.parts.sensors import AtRest, sensors
from kfgen.model.symbols.blocks import Attitude
from kfgen.model.symbols.convention import conventions

Values = dict[str, Any]
STEP = 1e-3
TIME = 1e-30
PLACE = 0.7
"""Latitude of the origin [rad], far from any symmetry."""
FULL = {"earth_rate": "true", "transport_rate": "true", "gravity_model": "normal", "latitude": f"{PLACE} rad"}


def variants(name: str) -> list[dict[str, str]]:
    """Every value of every option, one at a time, in every frame."""
    out: list[dict[str, str]] = []
    for base in LIBRARY[name].variants():
        for o in LIBRARY[name].options(base):
            if o.name == "frame" or isinstance(o.kind, Names):
                continue
            kind = o.kind.known if isinstance(o.kind, OrState) else o.kind
            values = {YesNo: ["true", "false"], Choice: list(getattr(kind, "names", ()))}.get(type(kind), [])
            values += [STATE] if isinstance(o.kind, OrState) else []
            out += [base | {o.name: v} for v in values if v != o.default]
        out.append(dict(base))
    return out


FAMILIES = [n for n, e in LIBRARY.items() if not isinstance(e, Resting)]
CASES = [(n, o) for n in FAMILIES for o in variants(n)]
CASES += [
    ("ins15", frame | {"attitude_error": c})
    for c in conventions()
    for frame in (FULL, {"earth_rate": "true"}, {"frame": "ecef", "latitude": f"{PLACE} rad"})
]
CASES += [
    ("ins33", FULL | {"attitude_error": "right-invariant"}),
    ("ins21", FULL | {"attitude_error": "psi"}),
]
AIDED = [
    ("ahrs6" if s in ("accel",) else "ins15", o | {"sensors": s})
    for s in sensors()
    if s != AtRest.name
    for o in (
        {},
        *(() if s == "accel" else ({"frame": "ecef"}, FULL)),
        *(
            {p.name: v}
            for p in sensors()[s].options
            for v in ("true", STATE, "vector", "0.4 -0.2 0.7 m", "0.3 s")
        ),
    )
]


CONVENTIONS = [c for c in CASES if "attitude_error" in c[1]]


def brief(case: tuple[str, dict[str, str]]) -> bool:
    """Every model as it is, every option of two of them in their first frame, every convention on a turning Earth."""
    name, options = case
    mine = {k: v for k, v in options.items() if (k, v) != ("frame", "ned")}
    if mine.get("transport_rate") and mine.get("attitude_error") in ("right-invariant", "modified-phi"):
        return False
    return not mine or (name in ("ahrs6", "ins15") and ("frame" not in mine or len(mine) == 1))


def marked(cases: list[tuple[str, dict[str, str]]]) -> list[Any]:
    return [pytest.param(c, id=labels(c), marks=() if brief(c) else pytest.mark.long) for c in cases]


def accepted(name: str, options: Mapping[str, str]) -> bool:
    """Whether the value is one of the option's: the product above is generous."""
    from kfgen.core.errors import InputError

    try:
        build(name, None, options)
    except InputError:
        return False
    return True


def labels(case: tuple[str, dict[str, str]]) -> str:
    return " ".join([case[0], *(f"{k}={v}" for k, v in case[1].items())])


@cache
def numeric_of(name: str, options: tuple[tuple[str, str], ...]) -> Numeric:
    return Numeric(build(name, None, dict(options)))


class Numeric:
    """A model's equations in numbers."""

    def __init__(self, model: FilterModel) -> None:
        self.model = model
        self.rates = {n: self.compiled(list(r)) for n, r in model.rates(False).items()}
        self.effects = np.array(model.effect_dynamics[0], float).reshape([model.effect_dynamics[0].rows] * 2)
        self.first = len(model.states) - len(self.effects)

    def compiled(self, expressions: list[sp.Expr]) -> Callable[[Values], np.ndarray]:
        symbols = sorted(set().union(*(e.free_symbols for e in expressions)), key=str)
        function = sp.lambdify(symbols, expressions, "numpy", cse=True)

        def value(x: Values) -> np.ndarray:
            R = {f"R_nb_{i}{j}": x["R"][i, j] for i in range(3) for j in range(3)} if "R" in x else {}
            known = x | R
            return np.array(function(*(known[s.name] for s in symbols)))

        return value

    def random(self, rng: np.random.Generator) -> Values:
        m = self.model
        x: Values = {c.name: c.value for c in m.constants}
        x |= {s.name: 0.3 * rng.normal() for s in m.states}
        x |= {c: rng.normal() for c in m.channel_units}
        sizes = {"p": 2e3, "v": 30.0, "mag": 3e-5}
        for b in m.blocks:
            if not isinstance(b, Attitude):
                x |= {n: sizes.get(b.name, 0.1) * rng.normal() for n in b.nominal_names}
        return x | {"R": expm(skew(rng.normal(size=3)))}

    def moved(self, x: Values, w: Mapping[str, float], dt: complex) -> Values:
        """One Euler step of any length, complex too: exact to first order."""
        m = self.model
        channels = [c for i in m.motion.inputs for c in i.channels]
        known = x | {c: x[c] - w.get(f"n_{c}", 0.0) for c in channels}
        new = dict(x)
        for b in m.blocks:
            rate = self.rates[b.name](known)
            if isinstance(b, Attitude):
                new["R"] = x["R"] + dt * x["R"] @ skew(rate)
            else:
                drive = [w.get(f"w_{n}", 0.0) for n in b.nominal_names]
                new |= {n: x[n] + dt * (r + d) for n, r, d in zip(b.nominal_names, rate, drive, strict=True)}
        names = [s.name for s in m.states[self.first :]]
        drive = np.array([w.get(f"w_{n}", 0.0) for n in names])
        rate = self.effects @ np.array([x[n] for n in names]) + drive if names else []
        return new | {n: x[n] + dt * r for n, r in zip(names, rate, strict=True)}


def skew(a: Any) -> np.ndarray:
    return np.array([[0, -a[2], a[1]], [a[2], 0, -a[0]], [-a[1], a[0], 0]])


def vee(M: np.ndarray) -> np.ndarray:
    return np.array([M[2, 1] - M[1, 2], M[0, 2] - M[2, 0], M[1, 0] - M[0, 1]]) / 2


def log(M: np.ndarray) -> np.ndarray:
    """Of a rotation by a small angle, analytic: the inverse sine of the sine by its series."""
    s = vee(M)
    q = s @ s
    return s * (1 + q / 6 + 3 * q**2 / 40 + 15 * q**3 / 336)


def gibbs(theta: np.ndarray) -> np.ndarray:
    """The rotation of a doubled Gibbs vector: Cayley's form."""
    A = skew(theta / 2)
    return np.asarray(np.linalg.solve(np.eye(3) - A, np.eye(3) + A))


def ungibbs(M: np.ndarray) -> np.ndarray:
    return 4 * vee(M) / (1 + np.trace(M))


class Error:
    """Composition and difference of states in a convention, by the equations that it states."""

    def __init__(self, model: FilterModel) -> None:
        self.model = model
        self.name = model.convention.name
        self.body = self.name == "local-quaternion"
        self.exp, self.log = (
            (gibbs, ungibbs) if "quaternion" in self.name else ((lambda a: expm(skew(a))), log)
        )
        self.names = [s.name for s in model.states]
        self.attitude = model.attitude.error_names if model.attitude else ()

    def turn(self, x: Values, dp: np.ndarray) -> np.ndarray:
        """By how much a change of position turns the frame, at the estimate."""
        if "r_N" not in x or self.name != "psi":
            return np.zeros(3)
        latitude = x["latitude"] + x["p_N"] / x["r_N"]
        dL, dl = dp[0] / x["r_N"], dp[1] / x["r_E"]
        return np.array([dl * np.cos(latitude), -dL, -dl * np.sin(latitude)])

    def carriers(self, theta: np.ndarray, turn: np.ndarray) -> dict[str, np.ndarray]:
        if self.name == "psi":
            return {"v": expm(skew(-turn))}
        E = expm(skew(theta)) if self.name in ("modified-phi", "right-invariant") else np.eye(3)
        return {"v": E} | dict.fromkeys(("p", "vl", "al"), E if self.name == "right-invariant" else np.eye(3))

    def plus(self, x: Values, e: np.ndarray) -> Values:
        error = dict(zip(self.names, e, strict=True))
        out = x | {n: x[n] + v for n, v in error.items() if n in x}
        if not self.attitude:
            return out
        theta = np.array([error[n] for n in self.attitude])
        blocks = {b.name: b.error_names for b in self.model.blocks}
        dp = np.array([error[n] for n in blocks["p"]]) if "p" in blocks else np.zeros(3)
        turn = self.turn(x, dp)
        E = self.exp(theta) if self.name != "psi" else expm(skew(theta - turn))
        out["R"] = x["R"] @ E if self.body else E @ x["R"]
        for b, C in self.carriers(theta, turn).items():
            if b in blocks:
                moved = C @ np.array([x[n] for n in blocks[b]])
                out |= {n: moved[k] + error[n] for k, n in enumerate(blocks[b])}
        return out

    def minus(self, true: Values, x: Values) -> np.ndarray:
        e = {n: true[n] - x[n] for n in self.names if n in true and n not in self.attitude}
        if self.attitude:
            blocks = {b.name: b.error_names for b in self.model.blocks}
            M = x["R"].T @ true["R"] if self.body else true["R"] @ x["R"].T
            dp = np.array([e[n] for n in blocks["p"]]) if "p" in blocks else np.zeros(3)
            turn = self.turn(x, dp)
            theta = self.log(M) + (turn if self.name == "psi" else 0)
            e |= dict(zip(self.attitude, theta, strict=True))
            for b, C in self.carriers_of(theta, turn).items():
                if b in blocks:
                    moved = C @ np.array([x[n] for n in blocks[b]])
                    e |= {n: true[n] - moved[k] for k, n in enumerate(blocks[b])}
        return np.array([e[n] for n in self.names])

    def carriers_of(self, theta: np.ndarray, turn: np.ndarray) -> dict[str, np.ndarray]:
        """As `carriers` for complex angles: their exponential by its series, which is entire."""

        def series(a: np.ndarray) -> np.ndarray:
            A, out, term = skew(a), np.eye(3, dtype=complex), np.eye(3, dtype=complex)
            for k in range(1, 12):
                term = term @ A / k
                out = out + term
            return out

        if self.name == "psi":
            return {"v": series(-turn)}
        E = series(theta) if self.name in ("modified-phi", "right-invariant") else np.eye(3)
        return {"v": E} | dict.fromkeys(("p", "vl", "al"), E if self.name == "right-invariant" else np.eye(3))


def slope(f: Callable[[float], np.ndarray], h: float) -> np.ndarray:
    """Fourth-order central difference."""
    return np.asarray((8 * (f(h) - f(-h)) - (f(2 * h) - f(-2 * h))) / (12 * h))


def scales(model: FilterModel) -> np.ndarray:
    """Sizes of the errors over which differences are taken."""
    sizes = {"m": 10.0, "m/s": 1.0, "T": 1e-6}
    return np.array([STEP * sizes.get(s.unit, 1.0) for s in model.states])


def filled(M: sp.Matrix, n: Numeric, x: Values) -> np.ndarray:
    return n.compiled(list(M))(x).astype(float).reshape(M.shape)


@pytest.mark.parametrize("case", marked(CASES))
class TestModel:
    def test_dynamics(self, case: tuple[str, dict[str, str]]) -> None:
        """F and G against the growth between a truth and an estimate."""
        n = numeric_of(case[0], tuple(case[1].items()))
        m, error, rng = n.model, Error(n.model), np.random.default_rng(11)
        x = n.random(rng)

        def growth(e: np.ndarray, w: Mapping[str, float]) -> np.ndarray:
            true, estimate = n.moved(error.plus(x, e), w, 1j * TIME), n.moved(x, {}, 1j * TIME)
            return np.asarray(error.minus(true, estimate).imag / TIME)

        sizes = scales(m)
        unit = np.eye(len(sizes))
        F = [slope(lambda h, j=j: growth(h * unit[j], {}), sizes[j]) for j in range(len(sizes))]  # type: ignore[misc]
        w = m.noise_symbols
        none = np.zeros(len(sizes))
        G = [slope(lambda h, s=s: growth(none, {s.name: h}), STEP) for s in w]  # type: ignore[misc]
        for M, columns in ((m.F, F), (m.G, G)):
            wanted = np.column_stack(columns)
            by = (sizes if M.cols == len(sizes) else np.ones(M.cols)) / sizes[:, None]
            size, off = np.abs(wanted * by).max(), np.abs(filled(M, n, x) - wanted) * by
            assert off.max() < 1e-7 * max(size, 1.0), (np.unravel_index(off.argmax(), off.shape), off.max())

    def test_names(self, case: tuple[str, dict[str, str]]) -> None:
        m = numeric_of(case[0], tuple(case[1].items())).model
        names = [s.name for s in m.states]
        assert len(set(names)) == len(names)
        assert m.F.shape == (len(names), len(names))
        assert all(s.prior > 0.0 for s in m.states)
        assert len(DiscreteModel(m).nominal_names) == len(names) + (1 if m.attitude else 0)


@pytest.mark.parametrize("case", marked([*CONVENTIONS, *(c for c in AIDED if accepted(*c))]))
def test_measurements(case: tuple[str, dict[str, str]]) -> None:
    """H of every sensor against differences of its nonlinear equation on composed truths."""
    n = numeric_of(case[0], tuple(case[1].items()))
    m, error = n.model, Error(n.model)
    x = n.random(np.random.default_rng(5))
    sizes = scales(m)
    unit = np.eye(len(sizes))
    for sensor in m.sensors:
        h = n.compiled(list(m.expected(sensor)))
        columns = [
            slope(lambda s, h=h, j=j: h(error.plus(x, s * unit[j])), sizes[j])  # type: ignore[misc]
            for j in range(len(sizes))
        ]
        got, wanted = filled(m.H(sensor), n, x), np.column_stack(columns)
        scale = max(np.abs(wanted * sizes).max(), STEP * sensor.sd)
        np.testing.assert_allclose(got * sizes, wanted * sizes, rtol=0, atol=1e-6 * scale)


def propagated(n: Numeric, x: Values, dt: float, steps: int) -> Values:
    """The nonlinear equations by Runge and Kutta's fourth order; the rotation stays one by projection."""
    names = [b for b in n.model.blocks if not isinstance(b, Attitude)]
    keys = [k for b in names for k in b.nominal_names] + [s.name for s in n.model.states[n.first :]]

    def rate(x: Values) -> Values:
        later = n.moved(x, {}, 1j * TIME)
        return {k: np.imag(later[k]) / TIME for k in [*keys, "R"]}

    def ahead(x: Values, k: Values, h: float) -> Values:
        return x | {key: x[key] + h * k[key] for key in k}

    for _ in range(steps):
        k1 = rate(x)
        k2 = rate(ahead(x, k1, dt / 2))
        k3 = rate(ahead(x, k2, dt / 2))
        k4 = rate(ahead(x, k3, dt))
        x = x | {k: x[k] + dt / 6 * (k1[k] + 2 * k2[k] + 2 * k3[k] + k4[k]) for k in k1}
        U, _, V = np.linalg.svd(x["R"])
        x["R"] = U @ V
    return x


FLIGHTS = [("ahrs6", {}), ("ins15", {}), ("ins33", {})]
FLIGHTS += [("ins15", {"attitude_error": c, "earth_rate": "true"}) for c in conventions()]
FLIGHTS += [("ins15", FULL | {"attitude_error": "psi"}), ("ins15", {"frame": "ecef"})]


@pytest.mark.parametrize("case", FLIGHTS, ids=labels)
def test_a_second_of_the_linear_error_differs_by_second_order(case: tuple[str, dict[str, str]]) -> None:
    """Halving the error at the start quarters the difference between linear and nonlinear propagation."""
    n = numeric_of(case[0], tuple(case[1].items()))
    error, rng = Error(n.model), np.random.default_rng(4)
    x = n.random(rng)
    names = [s.name for s in n.model.states]
    direction = scales(n.model) * rng.normal(size=len(names))
    dt, steps = 0.02, 50
    Phi, at = np.eye(len(names)), x
    F = n.compiled(list(n.model.F))
    for _ in range(steps):  # Magnus by the midpoint
        middle = propagated(n, at, dt / 2, 1)
        Phi = expm(F(middle).astype(float).reshape(n.model.F.shape) * dt) @ Phi
        at = propagated(n, at, dt, 1)
    ends = []
    for size in (8.0, 4.0):
        true = propagated(n, error.plus(x, size * direction), dt, steps)
        ends.append(error.minus(true, at).real - Phi @ (size * direction))
    moved = scales(n.model)
    long, short = (np.linalg.norm(e / moved) for e in ends)
    linear = np.linalg.norm(Phi @ (8.0 * direction) / moved)
    assert long < 0.1 * linear
    assert 3.9 < long / short < 4.1, (long, short, linear)


@pytest.mark.parametrize("name", FAMILIES)
@pytest.mark.parametrize("real", in_part([np.float32, np.float64]))
def test_process_noise_of_a_step_is_positive(name: str, real: type) -> None:
    """Qd with Gauss-Markov terms fast and slow on the first input too, in both precisions."""
    model = build(name)
    channel = model.motion.inputs[0].channels[0]
    for tau in (1e7, 0.1):  # steps over time constants from 1e-9 to 1
        model = model.augment(channel, make("gauss_markov", sigma=1e-2, tau=tau))
    d = DiscreteModel(model, order=1, max_step=0.1)
    n = Numeric(model)
    x = n.random(np.random.default_rng(2))
    for dt in (1e-2, 0.1):
        Qd = n.compiled(list(d.Qd))(x | {"dt": real(dt)}).reshape(d.Qd.shape).astype(float)
        np.testing.assert_allclose(Qd, Qd.T, rtol=1e-6)
        sd = np.sqrt(np.where(np.diag(Qd) > 0.0, np.diag(Qd), 1.0))
        assert np.linalg.eigvalsh(Qd / np.outer(sd, sd)).min() > -1e-6
        for tau, name_ in ((1e7, f"{channel}_gm"), (0.1, f"{channel}_gm2")):
            at = [s.name for s in model.states].index(name_)
            assert Qd[at, at] == pytest.approx(-1e-4 * np.expm1(-2 * dt / tau), rel=2e-6)
