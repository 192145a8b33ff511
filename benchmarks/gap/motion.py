"""Records on a rate table, with references: gyroscope, accelerometer, magnetometer.

A hidden effect changes the noise-free signals by d(t). Its gain is ``1/2 sum |d|^2 / sigma^2`` over all
channels, after the part that the assumed model explains anyway has been removed from d by least squares:
a constant on every channel of gyroscope and accelerometer, the three components of the unknown field on
the magnetometer. Size is found by bisection, for effects that are not linear in it; at the strength `OBVIOUS` it is that of `SIZES`.

* ``misalignment`` and ``g_sensitivity``, entry xy: ``y_x += xy * w_y`` and ``y_x += xy * f_y``
* ``nonlinearity``: ``w + k2 w^2`` or ``w + k3 w^3``; ``scale_asymmetry``: ``w + coefficient |w|``
* ``scale_temperature``: ``y_x += coefficient * (T - mean T) * w_x``; ``g_squared``, entry yy: ``y_x += yy * f_y^2``
* ``vibration_rectification``: ``y_x += coefficient * v(t)``, v the variance of the vibration, its axes together
* ``bandwidth``: one pole at `corner`; ``time_delay``: the sensor shows the motion `delay` seconds late. To first
  order both are the same; where the best of one comes within a nat of the other (`TWIN`), no record of this motion
  can distinguish them: the case counts as poorly excited, and either name is right; so with the square of a force
  whose tilts are so small that one of the forces does the same
* ``soft_iron``, entry xy: ``B_x += xy * B_y``, both ways; ``magnetic_disturbance``: a constant in the
  navigation frame, in a span of time
* ``lever_arm``: the accelerometer sits at r from the point of the reference: ``f + w' x r + w x (w x r)``
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import strength as nats
from case import OBVIOUS, SI, Array, Case, Hidden, Request, noise_file
from scipy.optimize import minimize_scalar
from scipy.spatial.transform import Rotation
from table import Table, poor, rich

AXES = "xyz"
NOISE = {"gyro": 0.1, "accel": 0.05, "mag": 0.4}
"""Standard deviation of a sample in the unit of the log."""
UNIT = {"gyro": "deg/s", "accel": "m/s^2", "mag": "uT"}
FIELD = np.array([21.0, 1.2, 43.0])
"""The local field [uT], north, east, down; the tool is not told."""

POWERS = (2, 3)
"""Of a nonlinear scale."""
BEGINS, LASTS = (0.15, 0.55), (0.1, 0.3)
"""Of a source in the room: from when and how long, over the duration."""

Change = Callable[[float], Array]
"""Size to the noise-free signal (n, 3) of the kind of sensor, SI."""


@dataclass
class Run:
    """A motion, and its noise-free signals.

    Parameters
    ----------
    shaken : array
        Standard deviation of the vibration at every sample [m/s^2].
    temperature : array
        Of the sensor [degC].
    """

    table: Table
    rng: np.random.Generator
    attitude: Rotation
    rates: Array
    force: Array
    field: Array
    shaken: Array
    temperature: Array

    @property
    def axes(self) -> tuple[int, ...]:
        """Of the gyroscope: those that turn."""
        return (0,) if self.table.name == "poor" else (0, 1, 2)


@dataclass(frozen=True)
class Plan:
    """How one effect changes the signals of one kind of sensor.

    Parameters
    ----------
    values : callable
        Size to the true parameters [SI].
    """

    kind: str
    channel: str
    change: Change
    values: Callable[[float], dict[str, float]]
    ordinary: int = 1
    located: int = 0

    def penalty(self, run: Run) -> float:
        """Nats that its parameters cost."""
        return nats.penalty(run.table.t.size, self.ordinary, self.located)


def _into(run: Run, axis: int, part: Array) -> Array:
    """Zeros, with `part` on one axis."""
    out = np.zeros((run.table.t.size, 3))
    out[:, axis] = part
    return out


def _regressor(run: Run, effect: str) -> Plan:
    """Of axes, power and sign drawn at random."""
    i = run.axes[int(run.rng.integers(len(run.axes)))] if len(run.axes) > 1 else run.axes[0]
    j = int(run.rng.choice([k for k in range(3) if k != i]))
    power = int(run.rng.choice(POWERS))
    return regressor(run, effect, i, j, power, float(run.rng.choice([-1.0, 1.0])))


def regressor(run: Run, effect: str, i: int, j: int, power: int, sign: float) -> Plan:
    """Effects that add a size times a known signal to one axis of the gyroscope."""
    w = run.rates
    entry, own = f"{AXES[i]}{AXES[j]}", "coefficient"
    rows = {
        "scale_factor": (w[:, i], own),
        "scale_asymmetry": (np.abs(w[:, i]), own),
        "nonlinearity": (w[:, i] ** power, f"k{power}"),
        "misalignment": (w[:, j], entry),
        "g_sensitivity": (run.force[:, j], entry),
        "vibration_rectification": (3.0 * run.shaken**2, own),
        "scale_temperature": (w[:, i] * (run.temperature - run.temperature.mean()), own),
        "g_squared": (run.force[:, j] ** 2, AXES[j] * 2),
    }
    signal, name = rows[effect]
    if effect == "misalignment" and run.table.name == "poor":  # only x turns
        signal, name = w[:, 0], "yx"
        i = 1
    return Plan(
        "gyro", f"gyro_{AXES[i]}", lambda a: w + _into(run, i, sign * a * signal), lambda a: {name: sign * a}
    )


def late(run: Run, effect: str) -> Plan:
    """A delay or a pole on all axes of the gyroscope."""
    t, rates = run.table.t, run.table.rates
    if effect == "time_delay":
        return Plan("gyro", "gyro", lambda a: rates.at(t - a), lambda a: {"delay": a})
    return Plan("gyro", "gyro", lambda a: rates.lagged(t, a), lambda a: {"corner": 1.0 / (2.0 * np.pi * a)})


def _forced(run: Run, plan: Plan, size: float) -> tuple[str, ...]:
    """The linear sensitivity to one axis of the force, where it leaves less than `TWIN` nats of a square's change."""
    d = plan.change(size) - plan.change(0.0)
    d = d - d.mean(axis=0)
    left = []
    for f in (run.force - run.force.mean(axis=0)).T:
        slopes = f @ d / max(float(f @ f), 1e-300)
        left.append(_nats("gyro", run, d - f[:, None] * slopes))
    return ("g_sensitivity",) if min(left) < TWIN else ()


def _twin(run: Run, effect: str, size: float) -> tuple[str, ...]:
    """The other of delay and pole, where the best size of it leaves less than `TWIN` nats of this one's change."""
    other = {"time_delay": "bandwidth", "bandwidth": "time_delay"}.get(effect)
    if other is None:
        return ()
    truth, plan = late(run, effect).change(size), late(run, other)
    left = minimize_scalar(
        lambda a: _nats("gyro", run, plan.change(a) - truth),
        bounds=(0.2 * size, 2.0 * size),
        method="bounded",
        options={"xatol": 1e-6 * size},
    )
    return (other,) if float(left.fun) < TWIN else ()


def _direction(run: Run) -> Array:
    v = run.rng.standard_normal(3)
    return np.asarray(v / np.linalg.norm(v))


def _lever(run: Run, effect: str) -> Plan:
    return lever(run, _direction(run))


def lever(run: Run, r: Array) -> Plan:
    """An arm in a direction."""
    turn = run.table.rates.at(run.table.t, 1)
    arm = np.cross(turn, r) + np.cross(run.rates, np.cross(run.rates, r))
    return Plan(
        "accel", "accel", lambda a: run.force + a * arm, lambda a: dict(zip(AXES, (a * r).tolist())), 3
    )


def _magnetic(run: Run, effect: str) -> Plan:
    """Iron in the body, or a source in the room for a while."""
    v = _direction(run)
    if effect == "hard_iron":
        return hard_iron(run, v)
    if effect == "soft_iron":
        i, j = (int(k) for k in run.rng.choice(3, 2, replace=False))
        return soft_iron(run, i, j)
    T = float(run.table.t[-1])
    t0 = T * run.rng.uniform(*BEGINS)
    return disturbance(run, v, t0, T * run.rng.uniform(*LASTS))


def hard_iron(run: Run, v: Array) -> Plan:
    """In a direction of the body."""
    return Plan("mag", "mag", lambda a: run.field + a * v, lambda a: dict(zip(AXES, (a * v).tolist())), 3)


def soft_iron(run: Run, i: int, j: int) -> Plan:
    """Of two axes, both ways."""
    both = _into(run, i, run.field[:, j]) + _into(run, j, run.field[:, i])
    names = f"{AXES[i]}{AXES[j]}", f"{AXES[j]}{AXES[i]}"
    return Plan("mag", "mag", lambda a: run.field + a * both, lambda a: dict.fromkeys(names, a), 6)


def disturbance(run: Run, v: Array, t0: float, lasting: float) -> Plan:
    """In a direction of the navigation frame, from a time on [s]."""
    t = run.table.t
    extra = run.attitude.inv().apply(v) * ((t >= t0) & (t < t0 + lasting))[:, None]
    return Plan(
        "mag",
        "mag",
        lambda a: run.field + a * extra,
        lambda a: {"x": a * v[0], "y": a * v[1], "z": a * v[2], "from": t0},
        3,
        2,
    )


REGRESSORS = (
    "scale_factor",
    "scale_asymmetry",
    "nonlinearity",
    "misalignment",
    "g_sensitivity",
    "vibration_rectification",
    "scale_temperature",
    "g_squared",
)
LATE = ("time_delay", "bandwidth")
EFFECTS: dict[str, Callable[[Run, str], Plan]] = {
    **dict.fromkeys(REGRESSORS, _regressor),
    **dict.fromkeys(LATE, late),
    "lever_arm": _lever,
    "hard_iron": _magnetic,
    "soft_iron": _magnetic,
    "magnetic_disturbance": _magnetic,
}
SIZES = {
    "scale_factor": 0.005,
    "scale_asymmetry": 0.003,
    "nonlinearity": 0.003,
    "misalignment": 0.005,
    "g_sensitivity": 2e-4,
    "vibration_rectification": 1e-3,
    "scale_temperature": 1e-3,
    "g_squared": 2e-5,
    "time_delay": 0.012,
    "bandwidth": 0.008,
    "lever_arm": 0.08,
    "hard_iron": 8e-6,
    "soft_iron": 0.04,
    "magnetic_disturbance": 6e-6,
}
"""In SI; of the bandwidth, the time constant (a corner of 20 Hz)."""
TWIN = 1.0
"""Nats: who guesses the likelier of two laws that are so far apart is wrong in a quarter of the cases."""
KINDS = ("gyro", "accel", "mag")
RICH_ONLY = (
    "lever_arm",
    "hard_iron",
    "soft_iron",
    "magnetic_disturbance",
    "vibration_rectification",
    "g_squared",
)
"""Effects that little motion hides or that need more than one axis: measured in motion with much excitation alone."""


def requests(count: int, strengths: Sequence[float], nulls: int, seeds: np.random.Generator) -> list[Request]:
    """Every effect at every strength and at its obvious size; odd numbers with little excitation. Null records of each kind of sensor."""
    out = [
        Request("motion", "single", (name,), X, i, int(seeds.integers(2**47)))
        for X in (OBVIOUS, *strengths)
        for name in EFFECTS
        for i in range(count)
    ]
    return out + [Request("motion", "null", (), 0.0, i, int(seeds.integers(2**47))) for i in range(nulls)]


def run_of(request: Request) -> Run:
    """The motion of a case."""
    rng = request.rng()
    name = request.effects[0] if request.effects else ""
    lean = request.index % 2 == 1 and name not in RICH_ONLY
    lean = lean and (bool(name) or KINDS[request.index % 3] == "gyro")
    duration = float(rng.uniform(60.0, 120.0))
    return _run((poor if lean else rich)(rng, duration, 100.0), rng)


def make(request: Request) -> Case:
    """Build one record."""
    run = run_of(request)
    name = request.effects[0] if request.effects else ""
    kind = KINDS[request.index % 3]
    hidden: tuple[Hidden, ...] = ()
    signals = {"gyro": run.rates, "accel": run.force, "mag": run.field}
    variant = run.table.name
    if name:
        plan = EFFECTS[name](run, name)
        kind = plan.kind
        p, size = plan.penalty(run), size_of(run, plan, name, request.strength)
        signals[kind] = plan.change(size)
        twin = alike(run, plan, name, size)
        hidden = (Hidden(name, plan.channel, plan.values(size), gain(run, plan, size), p, twin),)
        if twin and run.table.name == "rich":
            variant = "alike"
    return _case(request, run, kind, variant, signals, hidden)


def size_of(run: Run, plan: Plan, name: str, strength: float) -> float:
    """The size of an effect that has this strength."""
    if strength >= OBVIOUS:
        return SIZES[name]
    return nats.scaled(lambda a: gain(run, plan, a), strength + plan.penalty(run), 1e-9, 1e6)


def alike(run: Run, plan: Plan, name: str, size: float) -> tuple[str, ...]:
    """Another effect that nobody distinguishes from one of this size in this motion."""
    return _forced(run, plan, size) if name == "g_squared" else _twin(run, name, size)


def _run(table: Table, rng: np.random.Generator) -> Run:
    attitude, t = table.attitude(), table.t
    shaken = 0.2 + 1.5 * np.square(np.sin(np.pi * (t / t[-1] * rng.uniform(2.0, 5.0) + rng.random())))
    field = attitude.inv().apply(FIELD * SI["uT"])
    T = float(t[-1])
    warm = 26.0 + rng.uniform(1.0, 6.0) * np.sin(
        2.0 * np.pi * (t / (T * rng.uniform(0.5, 1.5)) + rng.random())
    )
    force = table.force(attitude)
    return Run(table, rng, attitude, table.rates.at(t), force, np.asarray(field), shaken, warm)


def gain(run: Run, plan: Plan, size: float) -> float:
    """Nats of a size, less what the assumed model explains."""
    return _nats(plan.kind, run, plan.change(size) - plan.change(0.0))


def _nats(kind: str, run: Run, d: Array) -> float:
    """Of a change of the signals, shape (n, 3)."""
    left = unexplained(kind, run, d).ravel()
    return float(0.5 * left @ left)


def unexplained(kind: str, run: Run, d: Array) -> Array:
    """What constants, or the unknown field, leave of a change of the signals, (n, 3), in standard deviations."""
    if kind == "mag":
        known = np.concatenate([run.attitude.inv().apply(e) for e in np.eye(3)]).reshape(3, -1).T
        left = d.ravel() - known @ np.linalg.lstsq(known, d.ravel(), rcond=None)[0]
    else:
        left = (d - d.mean(axis=0)).ravel()
    return np.asarray(left.reshape(d.shape) / (NOISE[kind] * SI[UNIT[kind]]))


def _case(
    request: Request,
    run: Run,
    kind: str,
    variant: str,
    signals: dict[str, Array],
    hidden: tuple[Hidden, ...],
) -> Case:
    rng, n = run.rng, run.table.t.size
    shaking = kind == "gyro"  # the accelerometer beside a gyroscope feels the vibration
    out: dict[str, tuple[Array, str]] = {}
    for sensor in ("gyro", "accel") if kind != "mag" else ("mag",):
        out |= _measured(rng, sensor, signals[sensor], run.shaken if shaking and sensor == "accel" else None)
    out |= _reference("gyro", run.rates) if kind != "mag" else {}
    if kind == "accel":
        out |= _reference("accel", run.force)
    if kind == "mag":
        q = run.attitude.as_quat(scalar_first=True)
        out |= {f"ref_q_{a}": (q[:, k], "") for k, a in enumerate("wxyz")}
    out["temperature"] = (run.temperature + 0.05 * rng.standard_normal(n), "degC")
    assumed = {f"{kind}_{a}": (UNIT[kind], {"N": NOISE[kind] * run.table.dt**0.5}) for a in AXES}
    return Case(request, f"{variant}-{kind}", hidden, run.table.t, out, noise_file(assumed))


def _measured(
    rng: np.random.Generator, kind: str, signal: Array, shaken: Array | None
) -> dict[str, tuple[Array, str]]:
    unit, n = UNIT[kind], signal.shape[0]
    bias = rng.normal(0.0, 3.0, 3) * NOISE[kind] if kind != "mag" else np.zeros(3)
    y = signal / SI[unit] + bias + NOISE[kind] * rng.standard_normal((n, 3))
    if shaken is not None:
        y = y + shaken[:, None] * rng.standard_normal((n, 3))
    return {f"{kind}_{a}": (y[:, k], unit) for k, a in enumerate(AXES)}


def _reference(kind: str, signal: Array) -> dict[str, tuple[Array, str]]:
    return {f"ref_{kind}_{a}": (signal[:, k] / SI[UNIT[kind]], UNIT[kind]) for k, a in enumerate(AXES)}
