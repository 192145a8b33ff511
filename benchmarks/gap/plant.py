"""Records of a plant with an input: pendulum, motor, cart.

The gain of a hidden effect is ``1/2 d' (I + J J')^-1 d``: ``d`` is ``(h_true - h_assumed) / sigma`` between the two
noise-free simulations from the same start, and a column of ``J`` is what one standard deviation of a state's start
adds to it. A start is known no better than the model file says (`START`); what another start explains is no gap.
Coefficients of friction, drag and springs act on the acceleration: ``v' = … - coefficient v``, ``- level tanh(v /
v0)`` with v0 = 0.02 in SI, ``- coefficient v |v|``, ``- coefficient q``, ``- coefficient q^3``. The others act on
the input: ``clip(u, ±limit)``, ``u + k2 u^2``, ``u + value``, ``u(t - delay)``, one pole `tau`; ``sensor_lag`` is a
pole on the measurement. At the strength `OBVIOUS` the sizes are those of `SIZES`, whatever they are worth.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import sin

import numpy as np
import strength as nats
from case import OBVIOUS, Array, Case, Hidden, Request
from machine import Change, Machine, excite, respond

DEGREE = np.pi / 180.0
START = 0.01
"""Standard deviation of where states start [SI]."""
FARTHEST = 1.6
"""Angle of the assumed pendulum [rad]."""


def _pendulum(x: Sequence[float], u: float, p: Mapping[str, float]) -> list[float]:
    return [x[1], -p["g_over_l"] * sin(x[0]) + p["gain"] * u]


def _motor(x: Sequence[float], u: float, p: Mapping[str, float]) -> list[float]:
    return [-p["a"] * x[0] + p["b"] * u]


def _coil(x: Sequence[float], u: float, p: Mapping[str, float]) -> list[float]:
    turn = (p["k"] * x[1] - p["d"] * x[0]) / p["J"]
    return [turn, (u - p["R"] * x[1] - p["k"] * x[0]) / p["L"]]


def _cart(x: Sequence[float], u: float, p: Mapping[str, float]) -> list[float]:
    return [x[1], (u - p["k"] * x[0] - p["c"] * x[1]) / p["m"]]


PENDULUM = Machine(
    "pendulum",
    {"g_over_l": (19.6, "1/s^2"), "gain": (25.0, "1/kg/m^2")},
    {"theta": "rad", "omega": "rad/s"},
    "N m",
    {"theta": "omega", "omega": "-g_over_l*sin(theta) + gain*u"},
    _pendulum,
    output=0,
    unit="deg",
    factor=DEGREE,
    noise=0.2,
    drive=0.12,
    rate=100.0,
    speed=1,
    position=0,
)
MOTOR = Machine(
    "motor",
    {"a": (4.0, "1/s"), "b": (60.0, "rad/s^2/V")},
    {"omega": "rad/s"},
    "V",
    {"omega": "-a*omega + b*u"},
    _motor,
    output=0,
    unit="rad/s",
    factor=1.0,
    noise=0.5,
    drive=6.0,
    rate=100.0,
    speed=0,
    same={"viscous_friction": "a"},
)
COIL = Machine(
    "motor with coil",
    {
        "J": (2e-4, "kg m^2"),
        "k": (0.05, "N m/A"),
        "d": (1e-4, "N m s"),
        "R": (1.2, "V/A"),
        "L": (6e-3, "V s/A"),
    },
    {"omega": "rad/s", "i": "A"},
    "V",
    {"omega": "(k*i - d*omega)/J", "i": "(u - R*i - k*omega)/L"},
    _coil,
    output=0,
    unit="rad/s",
    factor=1.0,
    noise=0.5,
    drive=6.0,
    rate=100.0,
    speed=0,
    same={"viscous_friction": "d"},
)
CART = Machine(
    "cart",
    {"m": (1.5, "kg"), "k": (20.0, "N/m"), "c": (1.0, "N s/m")},
    {"q": "m", "v": "m/s"},
    "N",
    {"q": "v", "v": "(u - k*q - c*v)/m"},
    _cart,
    output=0,
    unit="m",
    factor=1.0,
    noise=0.005,
    drive=6.0,
    rate=50.0,
    speed=1,
    position=0,
    same={"viscous_friction": "c", "spring": "k"},
)
MACHINES = (PENDULUM, MOTOR, CART, COIL)

PARAMETER = {
    "coulomb_friction": "level",
    "constant_input": "value",
    "input_nonlinearity": "k2",
    "saturation": "limit",
    "input_delay": "delay",
    "input_lag": "tau",
    "sensor_lag": "tau",
}
"""Name of the size; ``coefficient`` elsewhere."""
SIZES = {
    "viscous_friction": (0.3, 1.5, 0.3, 1.5),
    "coulomb_friction": (0.3, 15.0, 0.3, 15.0),
    "quadratic_drag": (0.2, 0.03, 0.3, 0.03),
    "input_delay": (0.03, 0.03, 0.05, 0.03),
    "input_lag": (0.05, 0.05, 0.08, 0.05),
    "input_nonlinearity": (1.5, 0.03, 0.03, 0.03),
    "constant_input": (0.02, 0.6, 0.8, 0.6),
    "spring": (1.5, 0.0, 2.0, 0.0),
    "cubic_spring": (4.0, 0.0, 20.0, 0.0),
    "sensor_lag": (0.05, 0.05, 0.08, 0.05),
    "saturation": (0.3, 0.3, 0.3, 0.3),
    "parameter_error": (0.1, 0.1, 0.1, 0.1),
}
"""By the order of `MACHINES`, in SI; saturation: the share of the range that is cut off."""
ON_POSITION = ("spring", "cubic_spring")
SIGNED = ("constant_input", "parameter_error")


def requests(count: int, strengths: Sequence[float], nulls: int, seeds: np.random.Generator) -> list[Request]:
    """Every effect at every strength and at its obvious size, on all machines in turn."""
    out = [
        Request("plant", "single", (name,), X, i, int(seeds.integers(2**47)))
        for X in (OBVIOUS, *strengths)
        for name in SIZES
        for i in range(count)
    ]
    return out + [Request("plant", "null", (), 0.0, i, int(seeds.integers(2**47))) for i in range(nulls)]


@dataclass(frozen=True, eq=False)
class Run:
    """A plant under its input, with nothing hidden.

    Parameters
    ----------
    rng : Generator
        Of the case, after input and start were drawn.
    which : int
        Of `MACHINES`.
    u : array, (n,)
        The input.
    start : list of float
        States at the first sample [SI].
    plain : array, (n,)
        The noise-free measured state of the assumed plant [SI].
    """

    rng: np.random.Generator
    which: int
    u: Array
    start: list[float]
    plain: Array

    @property
    def m(self) -> Machine:
        """The assumed plant."""
        return MACHINES[self.which]

    @cached_property
    def J(self) -> Array:
        """What one standard deviation of each state's start adds, in standard deviations of a sample, (n, states)."""
        m, start = self.m, self.start
        starts = [[x + START * (i == k) for i, x in enumerate(start)] for k in range(len(start))]
        return np.column_stack([respond(m, self.u, s, Change()) - self.plain for s in starts]) / (
            m.factor * m.noise
        )

    def weighed(self, away: Array) -> float:
        """``d' (I + J J')^-1 d`` of a departure d [SI]."""
        d = away / (self.m.factor * self.m.noise)
        J, p = self.J, self.J.T @ d
        return float(d @ d - p @ np.linalg.solve(np.eye(p.size) + J.T @ J, p))

    def measured(self, change: Change) -> Array:
        """The noise-free measured state [SI]."""
        return respond(self.m, self.u, self.start, change)

    def gain(self, change: Change) -> float:
        """Nats of a change."""
        return max(0.5 * self.weighed(self.measured(change) - self.plain), 1e-12)

    def change(self, name: str, size: float, sign: float, number: str) -> Change:
        """An effect of a size; the sign is that of what has one, the number that of a wrong number."""
        if name == "parameter_error":
            return Change(numbers={number: self.m.parameters[number][0] * (1.0 + sign * size)})
        if name == "saturation":
            return Change(saturation=float(np.abs(self.u).max()) * (1.0 - min(size, 0.95)))
        return Change(**{name: sign * size})  # type: ignore[arg-type]

    def size(self, strength: float, name: str, sign: float, number: str) -> float:
        """The size of an effect that has this strength; the obvious one is worth 100 nats at least."""
        p, size = nats.penalty(self.u.size, 1), SIZES[name][self.which]

        def gain(size: float) -> float:
            return self.gain(self.change(name, size, sign, number))

        if strength < OBVIOUS:
            return nats.approached(gain, strength + p, size)
        return nats.approached(gain, 300.0 + p, size) if gain(size) < 100.0 + p else size

    def also(self, name: str, number: str) -> tuple[str, ...]:
        """Other names of the same change."""
        if name == "parameter_error":
            return tuple(e for e, k in self.m.same.items() if k == number)
        return ("parameter_error",) if name in self.m.same else ()


def run_of(request: Request) -> Run:
    """The plant and the input of a case."""
    rng = request.rng()
    which = request.index % len(MACHINES)
    if request.effects and request.effects[0] in ON_POSITION and MACHINES[which].position < 0:
        which = (which + 1) % len(MACHINES)
    m = MACHINES[which]
    n = int(rng.integers(2000, 4001))
    u, start = excite(rng, m, n), (START * rng.standard_normal(len(m.states))).tolist()
    plain = respond(m, u, start, Change())
    while m is PENDULUM and np.abs(plain).max() > FARTHEST:  # over the top nothing can be predicted
        u = 0.7 * u
        plain = respond(m, u, start, Change())
    return Run(rng, which, u, start, plain)


def make(request: Request) -> Case:
    """Build one record."""
    run = run_of(request)
    m, n, rng, y = run.m, run.u.size, run.rng, run.plain
    hidden: tuple[Hidden, ...] = ()
    if request.effects:
        y, hidden = _hide(request, run)
    noisy = y / m.factor + m.noise * rng.standard_normal(n)
    channels = {
        "u": (run.u, m.input_unit),
        m.channel: (noisy, m.unit),
        "temperature": (25.0 + 0.01 * np.arange(n) / m.rate + 0.05 * rng.standard_normal(n), "degC"),
    }
    assumed = {k: v for k, (v, _) in m.parameters.items()}
    return Case(request, m.name, hidden, np.arange(n) / m.rate, channels, m.text(assumed))


def _driven(m: Machine) -> float:
    """Rate of the state on which the input acts, for an input of one: kfgen adds constant inputs to that rate."""
    numbers = {k: v for k, (v, _) in m.parameters.items()}
    rest = [0.0] * len(m.states)
    return float(np.subtract(m.slope(rest, 1.0, numbers), m.slope(rest, 0.0, numbers)).sum())


def _hide(request: Request, run: Run) -> tuple[Array, tuple[Hidden, ...]]:
    """The measured state with the effect in it, and the truth."""
    m, name = run.m, request.effects[0]
    number = str(run.rng.choice(list(m.parameters)))
    sign = float(run.rng.choice([-1.0, 1.0])) if name in SIGNED else 1.0
    true = run.change(name, run.size(request.strength, name, sign, number), sign, number)
    values: dict[str, float]
    if name == "parameter_error":
        values = dict(true.numbers)
    else:
        driven = _driven(m) if name == "constant_input" else 1.0
        values = {PARAMETER.get(name, "coefficient"): driven * float(getattr(true, name))}
    p = nats.penalty(run.u.size, 1)
    return run.measured(true), (Hidden(name, m.channel, values, run.gain(true), p, run.also(name, number)),)
