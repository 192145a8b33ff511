"""A reference attitude whose digits are too few for the sensors that it is held against.

Four components rounded to a step ``s`` turn the attitude by ``s / sqrt(3)`` [rad] about each axis, not white where the
sensor turns slowly: smoothing such a truth helps a fit, which is then called a bandwidth, a delay, a lever arm.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from kfgen.core.units import STANDARD_GRAVITY
from kfgen.effects.faults.reference import RoundedReference
from kfgen.effects.series import RawSamples
from kfgen.gap.motion.compared_channel import Compared
from kfgen.gap.motion.references.reference import references
from kfgen.gap.rest.faults import assumed_sd
from kfgen.gap.scene.scene import Placed
from kfgen.log.log import Log

MAX_ROUNDING_POWER_RATIO = 0.015
"""Power of what the rounding adds to a direction, over that of the noise, that is of no account in a few minutes."""
MAX_RATE_ROUNDING_POWER_RATIO = 3.0
"""The same at 1 Hz for a rate, where the noise of the attitude is counted as far as it is white."""


def step_of(log: Log) -> float:
    """The step of the components of the reference attitude, zero where they lie on no grid."""
    steps = []
    for name in (f"ref_q_{c}" for c in "wxyz" if f"ref_q_{c}" in log.channels):
        y = log.channels[name].values
        there = np.isfinite(y)
        if there.any() and np.ptp(y[there]) > 0.0:
            steps.append(RawSamples(log.t[there], y[there], 0.0).adc_step)
    return max(steps, default=0.0) if all(steps) else 0.0


def rounded(log: Log, compared: Sequence[Compared]) -> list[Placed]:
    """The sensors for which the rounding of the reference attitude cannot be neglected.

    Parameters
    ----------
    log : Log
    compared : sequence of Compared
    """
    step, given = step_of(log), references(log)
    if step == 0.0 or "q" not in given:
        return []
    angle = step / np.sqrt(3.0)
    found = []
    for sensor in dict.fromkeys(c.sensor for c in compared if c.sensor not in given):
        axes = [c for c in compared if c.sensor == sensor]
        noise = min(assumed_sd(c.noise, log.dt) for c in axes)
        length = float(np.sqrt(sum(np.mean(c.y[c.there] ** 2) for c in axes)))
        size, most = {
            "accel": (STANDARD_GRAVITY, MAX_ROUNDING_POWER_RATIO),
            "gyro": (2.0 * np.pi, MAX_RATE_ROUNDING_POWER_RATIO),
        }.get(sensor, (length, MAX_ROUNDING_POWER_RATIO))
        if noise > 0.0 and (size * angle / noise) ** 2 > most:
            found.append(Placed(RoundedReference(step), sensor))
    return found
