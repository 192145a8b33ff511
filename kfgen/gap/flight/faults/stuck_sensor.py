"""Sensors of a flight that show one and the same sample for a while, though the vehicle moves."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from kfgen.effects.faults.samples import Stuck, runs
from kfgen.gap.flight.faults.misread import sensor_of
from kfgen.gap.flight.path import FlownPath
from kfgen.gap.scene.scene import Placed
from kfgen.identify.screening.stuck import stuck_spans

Array = NDArray[np.float64]

MIN_STUCK_S = 1.0
"""Shorter, a logger only stumbled [s]."""
MIN_MOVED_SIGMAS = 5.0
"""By which a reading should have changed meanwhile; at rest some receivers hold their position."""


def stuck_sensors(path: FlownPath) -> tuple[Placed, ...]:
    """The longest time in which each sensor is stuck in all of its channels.

    Parameters
    ----------
    path : FlownPath
    """
    found: list[Placed] = []
    expected, log = path.expected(), path.log
    for a in (a for a in log.aiding if not a.sensor.is_constraint):
        rows = [path.rows.of(c) for c in a.sensor.channels]
        sd = np.sqrt([np.median(path.rows.R[r]) for r in rows])
        first, last = _longest_run(a.z, sd)
        moved = max(np.ptp(expected[r][first : last + 1]) / s for r, s in zip(rows, sd))
        if a.t[last] - a.t[first] >= MIN_STUCK_S and moved > MIN_MOVED_SIGMAS:
            found.append(_placed(a.sensor.channels, a.t[first], a.t[last]))
    for i in log.discrete.model.motion.inputs:
        z = log.u[:, log.triads[i.name]]
        first, last = _longest_run(z, np.full(z.shape[1], np.inf))
        if log.t[last] - log.t[first] >= MIN_STUCK_S:
            found.append(_placed(i.channels, log.t[first], log.t[last]))
    return tuple(found)


def _longest_run(z: Array, sd: Array) -> tuple[int, int]:
    """First and last of the longest run of samples that are stuck in every channel, of noises `sd`; one sample where none is."""
    stuck = np.ones(z.shape[0], dtype=bool)
    for y, s in zip(z.T, sd.tolist()):
        here = np.zeros(y.size, dtype=bool)
        for a, b in stuck_spans(y, s):
            here[a:b] = True
        stuck &= here
    first, length = runs(stuck)
    length = np.where(stuck[first], length, 1)
    k = int(np.argmax(length))
    return int(first[k]), int(first[k] + length[k] - 1)


def _placed(channels: Sequence[str], start: float, stop: float) -> Placed:
    return Placed(Stuck(time=float(start), lasting=float(stop - start)), sensor_of(channels))
