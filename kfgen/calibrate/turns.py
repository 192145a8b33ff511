"""Turns of a gyro between its rests: what was turned about one axis by a known angle, and what was only moved."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from kfgen.calibrate.known_turns import Turn
from kfgen.core.channel_names import AXES
from kfgen.identify.screening.rests import rests
from kfgen.log.log import Log

MAX_ERROR_OF_ANGLE = 0.25
"""Of the angle: a motion that differs by more is no turn by it."""
MAX_SHARE_OF_OTHER_AXES = 0.3
"""Of the angle: what the other axes may turn beside it."""


def turns_between_rests(log: Log, angle: float) -> tuple[list[Turn], int]:
    """Rests, as turns by nothing about every axis, turns by multiples of an angle, and how many other motions there are.

    Parameters
    ----------
    log : Log
        With an evenly sampled triad ``gyro``.
    angle : float
        [rad].
    """
    still, dt = rests(log, "gyro"), log.uniform_dt()
    y = np.array([log.values(f"gyro_{a}") for a in AXES]).T
    t, found, skipped = log.t, list[Turn](), 0
    if not still:
        return found, skipped
    bias = np.mean([y[a:b].mean(axis=0) for a, b in still], axis=0)
    for a, b in still:
        found += [Turn(float(t[a]), float(t[b - 1]), i, 0.0) for i in range(3)]
    for (_, a), (b, _) in pairwise(still):
        total = (y[a:b] - bias).sum(axis=0) * dt
        axis = int(np.argmax(np.abs(total)))
        times = round(float(abs(total[axis])) / angle)
        error = abs(abs(total[axis]) - times * angle)
        beside = np.abs(np.delete(total, axis)).max()
        if times and error < MAX_ERROR_OF_ANGLE * angle and beside < MAX_SHARE_OF_OTHER_AXES * angle:
            found.append(Turn(float(t[a]), float(t[b]), axis, times * angle))
        elif abs(total[axis]) > MAX_SHARE_OF_OTHER_AXES * angle:
            skipped += 1
    return found, skipped
