"""Whether the sensors of a log moved: what they read then is no noise."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kfgen.core.channel_names import AXES
from kfgen.core.units import parse_unit
from kfgen.log.log import Log

Array = NDArray[np.float64]

AVERAGED_S = 1.0
"""Time over which readings are averaged: noise and vibration are small then [s]."""
MIN_AVERAGES = 8
"""Of a log that can show motion."""
MIN_TURN_RAD = np.radians(3.0)
"""Turn of gravity in the axes of accelerometers that no bias makes."""
MIN_RATE_RAD_S = np.radians(2.0)
"""Range of averaged rates that no drift of a gyro makes."""
MAX_RATE_OF_REST_RAD_S = np.radians(0.25)
"""Standard deviation of a gyro's averaged rates from second to second at rest: idling propellers make half of it, hovering twice."""
MAX_SIGMAS_OF_REST = 3.0
"""The same in standard deviations of an average by chance, of a gyro that is noisier."""
MIN_SIGMAS = 8.0
"""Range, in standard deviations of an average by chance, below which it is the noise of the readings."""
MIN_TURN_OF_FIELD_RAD = np.radians(15.0)
"""Turn of the magnetic field in the axes of magnetometers that no current nearby makes."""
MIN_SPEED_RANGE_M_S = 1.0
"""Range of averaged velocities that no receiver at rest gives."""
SENSED = ("gyro_", "accel_", "mag_", "gnss_", "flow_", "baro_height", "airspeed", "range", "heading")
"""How channels begin whose readings change when the body moves."""
MAX_KNOCKED_SHARE = 0.01
"""Of the averages, but one at least, that do not count at either end: a knock on the bench is no motion."""


def motion_in(log: Log, channels: Collection[str]) -> str:
    """How a log shows that its sensors moved, in words; empty where it does not.

    Parameters
    ----------
    log : Log
    channels : collection of str
        That are looked at: where none of them reads motion, there is nothing to be said.
    """
    if not any(c.startswith(SENSED) for c in channels):
        return ""
    if log.n < 2 or float(log.t[-1] - log.t[0]) < MIN_AVERAGES * AVERAGED_S:
        return ""
    turn = _turn_of(log, "accel", "m/s^2", MIN_TURN_RAD)
    if turn:
        return f"gravity turns by {np.degrees(turn):.0f} deg in the axes of the accelerometers"
    for name in (f"gyro_{a}" for a in AXES):
        if ends := _range_of(log, name, "rad/s", MIN_RATE_RAD_S):
            return f"{name} turns at {np.degrees(ends[0]):.3g} to {np.degrees(ends[1]):.3g} deg/s"
    for name in (f"gnss_v_{a}" for a in "NED"):
        if ends := _range_of(log, name, "m/s", MIN_SPEED_RANGE_M_S):
            return f"{name} is {ends[0]:.3g} to {ends[1]:.3g} m/s"
    turn = _turn_of(log, "mag", "T", MIN_TURN_OF_FIELD_RAD)
    return f"the field turns by {np.degrees(turn):.0f} deg in the axes of the magnetometers" if turn else ""


def is_calm(log: Log) -> bool:
    """Whether averaged rates change from second to second no more than those of a body at rest: a hover may look like one.

    Parameters
    ----------
    log : Log
        Of which each gyro axis that is there is looked at.
    """
    for name in (f"gyro_{a}" for a in AXES):
        w = _averages(log, name, "rad/s")
        if w is None:
            continue
        changes = np.diff(w.y[np.isfinite(w.y)])
        scatter = float(np.sqrt(0.5 * np.mean(changes**2))) if changes.size else 0.0
        if scatter > max(MAX_RATE_OF_REST_RAD_S, MAX_SIGMAS_OF_REST * w.sd):
            return False
    return True


def _turn_of(log: Log, sensor: str, unit: str, least: float) -> float:
    """The turn [rad] of what the three axes of a sensor read, zero below the least that counts."""
    f = [_averages(log, f"{sensor}_{a}", unit) for a in AXES]
    if any(x is None for x in f):
        return 0.0
    turn, chance = _turn(np.column_stack([x.y for x in f if x is not None]), max(x.sd for x in f if x))
    return turn if turn > max(least, MIN_SIGMAS * chance) else 0.0


def _range_of(log: Log, name: str, unit: str, least: float) -> tuple[float, float] | None:
    """Between which values [SI] most averages of a channel are, where they differ by more than the least that counts."""
    w = _averages(log, name, unit)
    if w is None or not np.isfinite(w.y).any():
        return None
    y = np.sort(w.y[np.isfinite(w.y)])
    low, high = float(y[min(_knocked(y.size), y.size - 1)]), float(y[max(y.size - 1 - _knocked(y.size), 0)])
    return (low, high) if high - low > max(least, MIN_SIGMAS * w.sd) else None


def _knocked(count: int) -> int:
    """Averages at one end that do not count."""
    return max(1, round(MAX_KNOCKED_SHARE * count))


@dataclass(frozen=True)
class _Averages:
    """Means of a channel over a second each, shape (m,), and their standard deviation by what is inside a usual second."""

    y: Array
    sd: float


def _averages(log: Log, name: str, unit: str) -> _Averages | None:
    """None of a channel that is not there or has another unit."""
    if name not in log.channels or not parse_unit(log.channels[name].unit).same_dimension(parse_unit(unit)):
        return None
    y = log.channels[name].values
    second = np.floor((log.t - log.t[0]) / AVERAGED_S)
    block = np.cumsum(np.diff(second, prepend=0.0) > 0.0)  # of seconds in which there is a row
    there, blocks = np.isfinite(y), int(block[-1]) + 1
    count = np.bincount(block[there], minlength=blocks)
    total = np.bincount(block[there], weights=y[there], minlength=blocks)
    mean = np.where(count > 0, total / np.maximum(count, 1), np.nan)
    inside = y[there] - mean[block[there]]
    usual = max(float(np.median(count[count > 0])), 1.0) if there.any() else 1.0
    largest = float(np.abs(inside).max(initial=0.0)) or 1.0  # whose square need not be a number
    squares = np.bincount(block[there], weights=(inside / largest) ** 2, minlength=blocks)
    several = count > 1
    variance = float(np.median(squares[several] / (count[several] - 1))) if several.any() else 0.0
    return _Averages(np.asarray(mean), largest * float(np.sqrt(variance / usual)))


def _turn(f: Array, sd: float) -> tuple[float, float]:
    """Angle from the usual direction that few of the averages exceed, and the standard deviation of one by chance [rad]."""
    f = f[np.isfinite(f).all(axis=1)]
    largest = float(np.abs(f).max(initial=0.0)) or 1.0
    f, sd = f / largest, sd / largest
    size = np.linalg.norm(f, axis=1)
    f = f[size > 0.0] / size[size > 0.0, None]
    if f.shape[0] < MIN_AVERAGES:
        return 0.0, 0.0
    usual = np.median(f, axis=0)
    usual /= max(float(np.linalg.norm(usual)), 1e-300)
    turns = np.sort(np.arccos(np.clip(f @ usual, -1.0, 1.0)))
    turn = float(turns[-1 - _knocked(turns.size)])
    return turn, sd / float(np.median(size[size > 0.0]))
