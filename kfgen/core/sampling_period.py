"""The sampling period of a log from its times, samples lost or not."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

GAP_IN_PERIODS = 1.5
"""Periods beyond which a step of time is a gap."""
WHOLE_IN_PERIODS = 0.1
"""Of a period: error of a step that is a whole number of them."""
STRETCHES = 20
"""Of a log, in each of which a rate is looked for."""
MIN_SHARE_OF_NEIGHBOURS = 0.1
"""Share of steps of one period of the log, from which on a channel has the log's rate and lost samples."""


def usual_period(t: Array) -> float:
    """The sampling period [s] of times of shape (n,), n > 1: their median step; where most steps are longer because
    samples were lost at random, the period of which they are multiples.
    """
    steps = np.diff(t)
    median, single = float(np.median(steps)), single_period(steps)
    return single if single and median > GAP_IN_PERIODS * single else median


def single_period(steps: Array) -> float:
    """The period [s] of which steps are multiples, single ones among them all along the log; zero where they are not."""
    if steps.size < STRETCHES:
        return 0.0
    period = float(np.quantile(steps, MIN_SHARE_OF_NEIGHBOURS))
    if not period > 0.0:
        return 0.0
    single = np.abs(steps / period - 1.0) < WHOLE_IN_PERIODS
    whole = np.abs(steps / period - np.round(steps / period)) < WHOLE_IN_PERIODS
    parts = np.array_split(single, STRETCHES)
    if not (whole.mean() > 0.95 and min(float(p.mean()) for p in parts) > MIN_SHARE_OF_NEIGHBOURS):
        return 0.0
    return float(np.median(steps[single]))
