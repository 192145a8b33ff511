"""Sensors of a flight that show one and the same sample for a while, though the vehicle moves."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kfgen.effects.faults.samples import Stuck
from kfgen.gap.flight.path import FlownPath
from kfgen.gap.scene.scene import Placed

Array = NDArray[np.float64]

MIN_STUCK_SAMPLES = 8
MIN_STUCK_S = 1.0
MAX_EQUAL_SHARE = 0.2
"""Of samples that are the one before outside of that time, above which a sensor repeats its samples by habit."""
MIN_MOVED_SIGMAS = 5.0
"""By which a reading should have changed meanwhile; at rest some receivers hold their position."""


def stuck_sensors(path: FlownPath) -> tuple[Placed, ...]:
    """The longest time in which each sensor is stuck.

    Parameters
    ----------
    path : FlownPath
    """
    expected, found = path.expected(), []
    for a in path.log.aiding:
        first, last = _longest_run(a.z)
        rows = [path.rows.of(c) for c in a.sensor.channels]
        moved = max(np.ptp(expected[r][first : last + 1]) / np.sqrt(np.median(path.rows.R[r])) for r in rows)
        if _is_stuck(a.t, a.z, first, last) and moved > MIN_MOVED_SIGMAS:
            found.append(_placed(a.sensor.channels, a.t[first], a.t[last]))
    u = path.log.u
    for i in path.log.discrete.model.motion.inputs:
        z = u[:, path.log.triads[i.name]]
        first, last = _longest_run(z)
        if _is_stuck(path.log.t, z, first, last):
            found.append(_placed(i.channels, path.log.t[first], path.log.t[last]))
    return tuple(found)


def _longest_run(z: Array) -> tuple[int, int]:
    """First and last sample of the longest run of equal ones."""
    same = np.concatenate([[False], (np.diff(z, axis=0) == 0.0).all(axis=1), [False]])
    edges = np.flatnonzero(np.diff(same.astype(np.int8)))
    if not edges.size:
        return 0, 0
    runs = edges.reshape(-1, 2)
    first, last = runs[int(np.argmax(runs[:, 1] - runs[:, 0]))].tolist()
    return first, last


def _is_stuck(t: Array, z: Array, first: int, last: int) -> bool:
    equal = (np.diff(z, axis=0) == 0.0).all(axis=1)
    beside = (equal.sum() - (last - first)) / max(equal.size - (last - first), 1)
    return bool(
        last - first >= MIN_STUCK_SAMPLES and t[last] - t[first] >= MIN_STUCK_S and beside < MAX_EQUAL_SHARE
    )


def _placed(channels: tuple[str, ...], start: float, stop: float) -> Placed:
    where = channels[0] if len(channels) == 1 else channels[0].rpartition("_")[0]
    return Placed(Stuck(time=float(start), lasting=float(stop - start)), where)
