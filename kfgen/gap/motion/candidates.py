"""What could be missing in a world that moves: the candidates that a log allows, with typical sizes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kfgen.core.channel_names import AXES, acts_on
from kfgen.core.units import STANDARD_GRAVITY
from kfgen.core.wgs84 import EARTH_RATE
from kfgen.effects import Effect, Look, catalogue, effect_named
from kfgen.effects.driven.proportional import DRIVERS, DriverProportional, coupled, driver_named
from kfgen.effects.inertial.barometer import StaticPressureError
from kfgen.effects.inertial.errors import (
    EarthRate,
    GravityError,
    GSensitivity,
    GSquared,
    LeverArm,
    Misalignment,
    Mounting,
    Nonlinearity,
    ScaleAsymmetry,
    ScaleDrift,
    ScaleFactor,
    VibrationRectification,
    products,
)
from kfgen.effects.inertial.inertial_error import free
from kfgen.effects.inertial.lag import Bandwidth, ClockDrift, TimeDelay
from kfgen.effects.inertial.magnetic import Declination, HardIron, MagneticDisturbance, SoftIron
from kfgen.gap.motion.on_off_times import best_span
from kfgen.gap.motion.truth import Truth
from kfgen.gap.scene.scene import Placed
from kfgen.gap.scene.screen import MIN_OWN_SHARE

Array = NDArray[np.float64]

SMALL = 1e-3
"""A typical size of a relative error, from which fits start."""
SOME = 4000
"""Samples from which is seen whether directions can be distinguished."""
"""Rate of the earth [rad/s]."""
IN_TIME = ("rate_ramp", "warm_up")
"""Effects of time alone that compete, beside those proportional to a driver: they are linear in a coefficient."""

DRIFT_ALONE = 3.0
"""Nats by which a magnetometer that drifts in time but has no offset, which is hard iron, is rarer: one in twenty."""
DRIVEN_ELSEWHERE = 2.0
"""Nats by which what is known to drive one kind of sensor is rarer on the others: a motor's current on a barometer."""
SIMULTANEOUS_AXIS = 2.0
"""Nats by which it is rarer that one axis of a triad is late, or slow, than all: they are read at once."""
VERTICAL_AXIS = 1.0
"""Nats of the vertical of a receiver, which many smooth by itself."""
DRIFTING_RECEIVER = 2.0
"""Nats by which a receiver's fixes rarely follow time or a driver: its clocks and satellites take part in neither."""
MAX_EVENTS = 2
"""Effects of a while of one magnetometer: what more of them would describe is a field that changes, and no event."""
SLOW_DRIFT = 1e-5
"""Rate of a clock's drift with which fits begin."""
FIELD_PREFIX = "mag_"
"""How the constants of a filter are called that are the magnetic field in space: ``mag_N``."""


@dataclass(frozen=True)
class MotionCandidates:
    """What candidates are chosen by.

    Parameters
    ----------
    truth : Truth
    moved : tuple of (channel, sensor, axis)
        The channels whose truth varies.
    still : tuple of (channel, sensor, axis)
        The others: what another axis of the triad moves may show in them.
    good : ndarray of bool, shape (n,)
    mag : ndarray, shape (n, 3)
        Magnetometer readings less what effects explain [T].
    spread : float
        Standard deviation of a reading's noise [T].
    field : ndarray, shape (3,), optional
        The field in space, where an attitude alone is known.
    drive : mapping of str to ndarray
    unknown_field : tuple of int
        The axes in space along which nobody knows the magnetic field.
    boards : tuple of str
        Boards that may be turned to the vehicle where that would show.
    """

    truth: Truth
    moved: tuple[tuple[str, str, int], ...]
    still: tuple[tuple[str, str, int], ...]
    good: NDArray[np.bool_]
    mag: Array
    spread: float
    field: Array | None
    drive: Mapping[str, Array]
    unknown_field: tuple[int, ...] = ()
    boards: tuple[str, ...] = ()

    def axes(self, sensor: str) -> list[int]:
        """The axes of a sensor that moved."""
        return [a for _, s, a in self.moved if s == sensor]

    def every(self, sensor: str) -> list[int]:
        """The axes of a sensor that are compared, moved or not."""
        return sorted(a for _, s, a in (*self.moved, *self.still) if s == sensor)

    def size(self, sensor: str) -> float:
        """Root mean square of what a triad should have read [U]."""
        y = self.truth.signals(sensor, self.field).y
        return float(np.sqrt(np.mean(y[self.good] ** 2))) or 1.0


def offers(bench: MotionCandidates, placed: Sequence[Placed]) -> list[list[Placed]]:
    """Every addition beside those placed, each with the points from which its fit starts."""
    found: list[list[Placed]] = []
    sensors = list(dict.fromkeys(s for _, s, _ in bench.moved))
    for name, sensor, axis in bench.moved:
        if _has_scale(bench, sensor):
            found += _alone(bench, name, sensor) + _rows(bench, name, sensor, axis)
        found += _in_time(bench, name, sensor)
    for name, sensor, axis in bench.still:
        if sensor in sensors:
            found += _rows(bench, name, sensor, axis) if _has_scale(bench, sensor) else []
            found += _in_time(bench, name, sensor)
    for sensor in sensors:
        found += _lags(bench, sensor)
    if "accel" in sensors:
        found += _forces(bench)
    if len(bench.axes("gyro")) == 3 and bench.truth.R_bn is not None:
        found.append([Placed(EarthRate(EARTH_RATE, EARTH_RATE, EARTH_RATE), "gyro")])
    found += [[Placed(Mounting(SMALL, SMALL, SMALL), board)] for board in bench.boards]
    if "mag" in sensors:
        found += list(_magnetic(bench))
    if "baro" in bench.truth.read and bench.truth.speed_squared is not None:
        found.append([Placed(StaticPressureError(SMALL), "baro")])
    for place in dict.fromkeys(s.rpartition("_")[0] or s for s in sensors if s in bench.truth.antennas):
        found.append([Placed(LeverArm(SMALL, SMALL, SMALL), place)])
        found.append([Placed(TimeDelay(0.1 * bench.truth.dt), place)])
        found.append([Placed(ClockDrift(SLOW_DRIFT), place)])
    return [one for one in found if not _there(one[0], placed)]


def _has_scale(bench: MotionCandidates, sensor: str) -> bool:
    """Whether a sensor may read too much: a magnetometer has soft iron instead, and a receiver's places have no scale."""
    return sensor != "mag" and sensor not in bench.truth.antennas


def _there(new: Placed, placed: Sequence[Placed]) -> bool:
    """Whether an effect is placed already: of its class, at its place or that of its triad, with its entries."""
    names = {p.name for p in free(new.effect)}
    if _is_event(new):
        return sum(_is_event(old) for old in placed) >= MAX_EVENTS
    alike = [p for p in placed if type(p.effect) is type(new.effect) and acts_on(p.where, new.where)]
    return any(names <= {p.name for p in free(old.effect)} for old in alike)


def _is_event(placed: Placed) -> bool:
    """Whether an effect of a magnetometer lasts for a while alone."""
    return isinstance(placed.effect, HardIron | MagneticDisturbance) and placed.effect.duration > 0.0


def _alone(bench: MotionCandidates, name: str, sensor: str) -> list[list[Placed]]:
    """Effects of one channel by itself."""
    u = bench.size(sensor)
    effects: list[Effect] = [
        ScaleFactor(SMALL),
        ScaleAsymmetry(SMALL),
        Nonlinearity(k2=SMALL / u),
        Nonlinearity(k3=SMALL / u**2),
    ]
    T = bench.truth.warmth
    if T is not None and np.ptp(T) > 0.0:
        effects.append(ScaleDrift(SMALL / float(np.ptp(T)), float(np.mean(T))))
    if bench.truth.power is not None and np.ptp(bench.truth.power) > 0.0:
        own = float(sensor == "accel")
        effects.append(VibrationRectification(SMALL / STANDARD_GRAVITY**2 * u, own))
    return [[Placed(e, name)] for e in effects]


def _rows(bench: MotionCandidates, name: str, sensor: str, axis: int) -> list[list[Placed]]:
    """Rows of matrices and their single entries."""
    others = [AXES[axis] + AXES[j] for j in bench.axes(sensor) if j != axis]
    found = [Placed(Misalignment(**{e: SMALL}), name) for e in others]
    if len(others) == 2:
        found.append(Placed(Misalignment(**dict.fromkeys(others, SMALL)), name))
    if sensor == "gyro" and bench.truth.f_b is not None:
        g = SMALL * bench.size(sensor) / STANDARD_GRAVITY
        forced = [j for j in range(3) if np.ptp(bench.truth.f_b[bench.good, j]) > 0.0]
        entries = [AXES[axis] + AXES[j] for j in forced]
        found += [Placed(GSensitivity(**{e: g}), name) for e in entries]
        if len(entries) > 1:
            found.append(Placed(GSensitivity(**dict.fromkeys(entries, g)), name))
        squares = {k: float(np.ptp(v[bench.good])) for k, v in products(bench.truth.f_b).items()}
        most = max(squares.values())
        # Of coefficients of one size a product that hardly changes shows the least: seen in it, its own must be larger.
        found += [
            Placed(GSquared(**{k: g / STANDARD_GRAVITY}), name, prior_penalty_nats=float(np.log(most / v)))
            for k, v in squares.items()
            if v > 0.0
        ]
    return [[p] for p in found]


def _lags(bench: MotionCandidates, sensor: str) -> list[list[Placed]]:
    """Delay and bandwidth of a triad, and of each of its channels."""
    names = [c for c, s, _ in bench.moved if s == sensor]
    places = names if len(names) == 1 else [sensor, *names]
    dt = bench.truth.dt
    # The highest corners do what a delay does, of a hundredth and a tenth of a period.
    corners = [16.0 / dt, 1.6 / dt, 0.2 / dt, 0.05 / dt, 0.01 / dt]
    rarer = {w: 0.0 if w == places[0] else _axis_penalty_nats(bench, sensor, w) for w in places}
    found = [[Placed(TimeDelay(0.1 * dt), w, r)] for w, r in rarer.items()]
    return found + [[Placed(Bandwidth(f), w, r) for f in corners] for w, r in rarer.items()]


def _axis_penalty_nats(bench: MotionCandidates, sensor: str, channel: str) -> float:
    """By which it is rarer that one axis of a triad is late or slow by itself."""
    is_vertical = sensor in bench.truth.antennas and channel.endswith("_D")
    return VERTICAL_AXIS if is_vertical else SIMULTANEOUS_AXIS


def _forces(bench: MotionCandidates) -> list[list[Placed]]:
    """Effects of an accelerometer as a whole."""
    found = []
    turns = bench.truth.omega_b is not None and np.ptp(bench.truth.omega_b[bench.good]) > 0.0
    if turns and not bench.truth.antennas:  # beside an antenna the arm is the antenna's
        found.append([Placed(LeverArm(SMALL, SMALL, SMALL), "accel")])
    if bench.truth.R_bn is not None:
        found.append([Placed(GravityError(SMALL * STANDARD_GRAVITY), "accel")])
    return found


def _magnetic(bench: MotionCandidates) -> Iterator[list[Placed]]:
    """Iron, always or for a while, and disturbances in space."""
    h = SMALL * bench.size("mag")
    axes, every = bench.axes("mag"), bench.every("mag")
    known = "mag" in bench.truth.read
    # Beside a field that is unknown, a constant on an axis along which it does not change is part of it.
    offset = every if known else axes
    yield [Placed(HardIron(**{AXES[i]: h for i in offset}), "mag")]
    for i in offset if len(offset) > 1 else ():
        yield [Placed(HardIron(**{AXES[i]: h}), "mag")]
    entries = [AXES[i] + AXES[j] for i in every for j in axes]
    for some in _mirrored(entries):
        yield [Placed(SoftIron(**dict.fromkeys(_distinguishable(bench, some), SMALL)), "mag")]
    if len(entries) > 1:
        yield [Placed(SoftIron(**dict.fromkeys(_distinguishable(bench, entries), SMALL)), "mag")]
    if known and bench.truth.R_bn is not None and 1 not in bench.unknown_field:
        yield [Placed(Declination(SMALL), "mag")]
    if len(every) == 3:
        yield from _for_a_while(bench, h)


def _mirrored(entries: Sequence[str]) -> list[list[str]]:
    """Each entry with its mirror image: iron draws fields together symmetrically, which one of two would not show."""
    return [
        list(dict.fromkeys(e for e in (a, a[::-1]) if e in entries))
        for a in entries
        if a <= a[::-1] or a[::-1] not in entries
    ]


def _for_a_while(bench: MotionCandidates, h: float) -> Iterator[list[Placed]]:
    """A field in the body or in space for the span in which it explains most; it may show along an axis that is still."""
    R_bn = None if "mag" in bench.truth.read else bench.truth.R_bn
    for cls, in_body in ((HardIron, True), (MagneticDisturbance, False)):
        if cls is MagneticDisturbance and bench.truth.R_bn is None:
            continue
        span = best_span(bench.truth.t, bench.mag, bench.good, R_bn, in_body)
        if span is not None:
            times = {"time": span.start, "duration": span.stop - span.start, "edge": span.edge}
            yield [Placed(cls(**dict.fromkeys(AXES, h), **times), "mag")]


def _distinguishable(bench: MotionCandidates, entries: Sequence[str]) -> list[str]:
    """The entries of a matrix that are no sum of the ones before and of another field in space.

    Of an unknown field the whole size is unknown, so the scale of the last axis is its measure; where a body turns
    about one axis alone, so is its direction about it.
    """
    some = np.flatnonzero(bench.good)
    some = some[:: max(1, some.size // SOME)]
    u, every = bench.truth.signals("mag", bench.field).y[some], bench.every("mag")
    columns: list[Array] = []
    if bench.truth.R_bn is not None:
        columns = [bench.truth.R_bn[some][:, every, k].ravel() for k in bench.unknown_field]
    kept = []
    for e in entries:
        column = np.zeros((some.size, 3))
        column[:, AXES.index(e[0])] = u[:, AXES.index(e[1])]
        new = column[:, every].ravel()
        left = new
        if columns:
            A = np.column_stack(columns)
            left = new - A @ np.linalg.lstsq(A, new, rcond=1e-9)[0]
        if np.linalg.norm(left) > MIN_OWN_SHARE * np.linalg.norm(new):
            kept.append(e)
            columns.append(new)
    return kept


def _in_time(bench: MotionCandidates, name: str, sensor: str) -> list[list[Placed]]:
    """What follows a recorded driver or time alone, and has nothing to do with motion."""
    empty = np.zeros(0)
    drive = {k: float(v.mean()) for k, v in bench.drive.items() if _drives(bench, k)}
    t = bench.truth.t
    look = Look(empty, empty, bench.truth.dt, float(t[-1] - t[0]), drive)
    driven = [cls for cls in catalogue().values() if issubclass(cls, DriverProportional)]
    driven += [coupled(n) for n in drive if n in DRIVERS and not DRIVERS[n].effect]
    receiver = DRIFTING_RECEIVER if sensor in bench.truth.antennas else 0.0
    # Beside any sensor but a magnetometer stands a constant bias.
    prior_penalty_nats = DRIFT_ALONE if sensor == "mag" else receiver
    found: list[tuple[Sequence[Effect], float]] = []
    for cls in driven:
        usual = driver_named(cls.driver).drives in ("", sensor)
        found.append((cls.starts(look), receiver if usual else DRIVEN_ELSEWHERE))
    found += [(effect_named(n).starts(look), prior_penalty_nats) for n in IN_TIME]
    return [[Placed(e, name, r) for e in starts] for starts, r in found if starts]


def _drives(bench: MotionCandidates, name: str) -> bool:
    """Whether a recorded quantity may drive others: it is no reading of a sensor that is compared."""
    return driver_named(name).read_by not in bench.truth.read
