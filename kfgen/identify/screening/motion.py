"""Whether the sensors of a log moved: what they read then is no noise."""

from __future__ import annotations

from collections.abc import Collection

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
MIDDLE = (5.0, 95.0)
"""Percentiles between which averages count: a knock on the bench is no motion."""


def motion_in(log: Log, channels: Collection[str]) -> str:
    """How a log shows that its sensors moved, in words; empty where it does not.

    Parameters
    ----------
    log : Log
    channels : collection of str
        In whose readings motion is looked for, if they are gyros or accelerometers.
    """
    if not any(c.startswith(("gyro_", "accel_")) for c in channels):
        return ""
    if log.n < 2 or float(log.t[-1] - log.t[0]) < MIN_AVERAGES * AVERAGED_S:
        return ""
    f = [_averages(log, f"accel_{a}", "m/s^2") for a in AXES]
    if all(x is not None for x in f):
        turn = _turn(np.column_stack([x for x in f if x is not None]))
        if turn > MIN_TURN_RAD:
            return f"gravity turns by {np.degrees(turn):.0f} deg in the axes of the accelerometers"
    for name in (f"gyro_{a}" for a in AXES):
        w = _averages(log, name, "rad/s")
        if w is None or not np.isfinite(w).any():
            continue
        low, high = np.nanpercentile(w, MIDDLE)
        if high - low > MIN_RATE_RAD_S:
            return f"{name} turns at {np.degrees(low):.3g} to {np.degrees(high):.3g} deg/s"
    return ""


def _averages(log: Log, name: str, unit: str) -> Array | None:
    """Means of a channel over a second each; None where it is not there or has another unit."""
    if name not in log.channels or not parse_unit(log.channels[name].unit).same_dimension(parse_unit(unit)):
        return None
    y = log.values(name)
    block = ((log.t - log.t[0]) / AVERAGED_S).astype(np.int64)
    there = np.isfinite(y)
    count = np.bincount(block[there], minlength=int(block[-1]) + 1)
    total = np.bincount(block[there], weights=y[there], minlength=int(block[-1]) + 1)
    with np.errstate(invalid="ignore"):
        return np.asarray(np.where(count > 0, total / np.maximum(count, 1), np.nan))


def _turn(f: Array) -> float:
    """Angle from the usual direction that few of the averages exceed [rad]."""
    f = f[np.isfinite(f).all(axis=1)]
    size = np.linalg.norm(f, axis=1)
    f = f[size > 0.0] / size[size > 0.0, None]
    if f.shape[0] < MIN_AVERAGES:
        return 0.0
    usual = np.median(f, axis=0)
    usual /= max(float(np.linalg.norm(usual)), 1e-300)
    return float(np.percentile(np.arccos(np.clip(f @ usual, -1.0, 1.0)), MIDDLE[1]))
