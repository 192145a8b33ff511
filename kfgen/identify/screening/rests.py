"""Where sensors that moved are at rest: what they read in motion is no noise."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from kfgen.core.channel_names import AXES
from kfgen.core.numbers import moment
from kfgen.identify.screening.motion import is_calm, motion_in
from kfgen.identify.words import IN_LONGEST_REST
from kfgen.log.log import Log

Array = NDArray[np.float64]

MAX_REST_NOISE_RATIO = 3.0
"""How far above its quietest tenth the running standard deviation of a sensor at rest may be."""
RUNNING_WINDOW_S = 0.5
"""Length of that running standard deviation, and of a hole in time that ends a rest [s]."""
MIN_POSE_S = 1.0
"""Shortest rest that counts as a pose [s]."""
MIN_REST_S = 10.0
"""Shortest rest of a log that moved, whose noise stands for that of the sensors [s]."""


def rests(log: Log, sensor: str = "accel") -> list[tuple[int, int]]:
    """The rests of a sensor, as slices: its running standard deviation is near that of its quietest tenth.

    Parameters
    ----------
    log : Log
    sensor : str
        Whose three channels rest.

    Raises
    ------
    InputError
        A channel is missing or has samples that are no numbers.
    """
    from scipy.ndimage import binary_erosion, label

    y = np.array([log.values(f"{sensor}_{a}") for a in AXES]).T
    size = max(3, round(RUNNING_WINDOW_S / log.dt))
    ends = np.flatnonzero(np.diff(log.t) > max(RUNNING_WINDOW_S, 1.5 * log.dt)) + 1
    bounds = [0, *ends.tolist(), log.n]
    parts = [(a, b) for a, b in pairwise(bounds) if b - a > size]
    deviations = [_running_deviation(y[a:b], size) for a, b in parts]
    if not parts:
        return []
    limit = MAX_REST_NOISE_RATIO * max(float(np.quantile(np.concatenate(deviations), 0.1)), 1e-9)
    found = []
    for (a, _), deviation in zip(parts, deviations, strict=True):
        marked, count = label(binary_erosion(deviation < limit, iterations=size // 2))
        at = [a + np.flatnonzero(marked == k + 1) for k in range(count)]
        found += [(int(k[0]), int(k[-1]) + 1) for k in at]
    return [(a, b) for a, b in found if (b - a) * log.dt >= MIN_POSE_S]


def _running_deviation(y: Array, size: int) -> Array:
    from kfgen.effects.inertial.vibration import running_variance

    return np.asarray(np.sqrt(running_variance(y, size, size).sum(axis=1)))


def longest_rest(log: Log) -> Log | None:
    """The longest rest of a log whose sensors moved, as a log of its own.

    Parameters
    ----------
    log : Log

    Returns
    -------
    Log or None
        None where neither gyro nor accelerometer has three axes, or they do not rest for `MIN_REST_S`.

    Raises
    ------
    InputError
        A channel of the gyro or the accelerometer has samples that are no numbers.
    """
    sensor = next((s for s in ("gyro", "accel") if all(f"{s}_{a}" in log.channels for a in AXES)), "")
    found = rests(log, sensor) if sensor else []
    long = [(a, b) for a, b in found if log.t[b - 1] - log.t[a] >= MIN_REST_S]
    parts = (log.cut(a, b) for a, b in sorted(long, key=lambda rest: rest[0] - rest[1]))
    return next((p for p in parts if is_calm(p) and not motion_in(p, list(p.channels))), None)


def at_rest_only(part: Log, how: str, done: str) -> str:
    """What is said where the longest rest stands for a log.

    Parameters
    ----------
    part : Log
        The rest.
    how : str
        In words, how its sensors moved.
    done : str
        With the rest: ``compared``.

    Returns
    -------
    str
        A sentence.
    """
    start, stop = (moment(float(t)) for t in part.t[[0, -1]])
    return IN_LONGEST_REST.format(how=how, done=done, start=start, stop=stop)
