"""The gain of a sensor above the frequency from which on its internal low-pass takes power away.

The terms are fitted below that frequency. Above it the power of the record over that of the terms is the square of the
gain, whose logarithm is a sum of `hats`: the spectral likelihood is concave in it, and Newton's steps climb to its top.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from kfgen.effects import Effect
from kfgen.effects.process.sensor_response import GAINS, SensorResponse, hats
from kfgen.identify.evidence.record import Record
from kfgen.identify.evidence.whittle import residual_ratio

Array = NDArray[np.float64]

MIN_ORDINATES_OF_A_GAIN = 20
"""Spectral ordinates for each gain, from which its logarithm is known to a sixth."""
MAX_NEWTON_STEPS = 100
MAX_STEP_NATS = 1.0
"""Change of the logarithm of a power in one step."""
SMALL_STEP_NATS = 1e-9


def response_beyond(
    cut_hz: float, records: Sequence[Record], effects: Sequence[Effect]
) -> SensorResponse | None:
    """The gain beyond a frequency, None where too little of the spectrum lies there.

    Parameters
    ----------
    cut_hz : float
        Up to it the gain is one [Hz].
    records : sequence of Record
        Of one sensor at one rate, without averages.
    effects : sequence of Effect
        Fitted below `cut_hz`, with their values [SI].

    Returns
    -------
    SensorResponse or None
    """
    end = 0.5 / records[0].dt
    f, ratio, count = np.concatenate([_excess(cut_hz, r, effects) for r in records], axis=1)
    if count.sum() < MIN_ORDINATES_OF_A_GAIN * GAINS:
        return None
    B = hats(f, cut_hz, end)
    log_power = np.zeros(GAINS)
    for _ in range(MAX_NEWTON_STEPS):
        seen = count * ratio * np.exp(-(B @ log_power))
        information = B.T @ (B * seen[:, None]) + 1e-9 * count.sum() * np.eye(GAINS)
        step = np.linalg.solve(information, B.T @ (seen - count))
        log_power += np.clip(step, -MAX_STEP_NATS, MAX_STEP_NATS)
        if np.abs(step).max() < SMALL_STEP_NATS:
            break
    return SensorResponse.through(cut_hz, end, np.exp(0.5 * log_power).tolist())


def _excess(cut_hz: float, record: Record, effects: Sequence[Effect]) -> Array:
    """Frequency [Hz], power over that of the effects and ordinates of each bin beyond, shape (3, m)."""
    whole = replace(record, skip=tuple(band for band in record.skip if band[1] < np.inf))
    data = whole.ordinates(effects)
    theta = data.log_likelihood(effects).coefficients
    beyond = data.frequency > cut_hz
    return np.stack([data.frequency, residual_ratio(data, effects, theta), data.count])[:, beyond]
