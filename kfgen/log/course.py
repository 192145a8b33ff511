"""The course of a quantity whose sensor has a clock of its own: a battery's current, a thermometer, a throttle.

In a log of an autopilot such a channel has a sample in few of the rows of the inertial sensor.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kfgen.core.errors import InputError
from kfgen.log.log import Log

Array = NDArray[np.float64]

MAX_SILENT_SHARE = 0.1
"""Of a log's duration, for which a quantity may have no sample, at its ends too: what it did then would be a guess."""


def longest_silence_s(log: Log, name: str) -> float:
    """The longest time for which a channel has no sample, from the first time of a log to its last.

    Parameters
    ----------
    log : Log
    name : str

    Returns
    -------
    float
        [s]; infinite where it has none.
    """
    t = log.t[np.isfinite(log.channel(name).values)]
    return float(np.diff(np.concatenate([log.t[:1], t, log.t[-1:]])).max()) if t.size else np.inf


def own_period_s(log: Log, name: str) -> float:
    """The sampling period of a channel, which may be slower than the rows of its log.

    Parameters
    ----------
    log : Log
    name : str

    Returns
    -------
    float
        The median of its steps [s]; that of the log where it has fewer than two samples.
    """
    t = log.t[np.isfinite(log.channel(name).values)]
    return float(np.median(np.diff(t))) if t.size > 1 else log.dt


def is_silent(log: Log, name: str) -> bool:
    """Whether a channel has no sample for so long that nobody knows its course.

    Parameters
    ----------
    log : Log
    name : str

    Returns
    -------
    bool
    """
    return longest_silence_s(log, name) > max(MAX_SILENT_SHARE * float(log.t[-1] - log.t[0]), log.dt)


def between_samples(log: Log, name: str, values: Array) -> Array:
    """Straight lines between the samples that a channel has, held before the first and after the last.

    Parameters
    ----------
    log : Log
    name : str
    values : ndarray, shape (m,)
        Of the samples that it has, in their order.

    Returns
    -------
    ndarray, shape (n,)
    """
    there = np.isfinite(log.channel(name).values)
    return values if there.all() else np.asarray(np.interp(log.t, log.t[there], values))


def course(log: Log, name: str) -> Array:
    """The course of a channel over all times of a log.

    Parameters
    ----------
    log : Log
    name : str

    Returns
    -------
    ndarray, shape (n,)
        [SI]

    Raises
    ------
    InputError
        The log has no such channel, or it has no sample for more than `MAX_SILENT_SHARE` of the log.
    """
    values = log.channel(name).values
    if is_silent(log, name):
        raise InputError(
            f"channel {name} has no sample for {longest_silence_s(log, name):.4g} s"
            if np.isfinite(values).any()
            else f"channel {name} holds no number",
            where=log.source,
            remedy="Give the part of the log that has it, or a filter without its effect",
        )
    return between_samples(log, name, values[np.isfinite(values)])
