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

MIN_STEPS_OF_A_RATE = 8
MIN_SHARE_OF_OWN_STEPS = 0.5
"""Of the steps of a channel with a rate of its own: those that are about a period long."""


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


def channel_period(logged: Array, steps: Array) -> tuple[float, bool]:
    """The sampling period [s], and whether it is the channel's own: a channel of half the log's rate has every second
    sample, one that lost half of them at random has neighbours too, and the log's period.

    Parameters
    ----------
    logged : ndarray, shape (n,)
        Times of the rows of the log [s].
    steps : ndarray, shape (m,)
        Between samples of the channel [s].

    Returns
    -------
    (float, bool)
    """
    own, of_log = float(np.median(steps)), float(np.median(np.diff(logged)))
    neighbours = float(np.mean(np.abs(steps / of_log - 1.0) < 0.1))
    lost = own > GAP_IN_PERIODS * of_log and neighbours >= MIN_SHARE_OF_NEIGHBOURS
    return (of_log, False) if lost else (own, own > GAP_IN_PERIODS * of_log)


def is_slower(t: Array, there: NDArray[np.bool_]) -> bool:
    """Whether a channel has a rate of its own below that of the log: nothing of it is missing between its samples.

    Parameters
    ----------
    t : ndarray, shape (n,)
        Times of the rows [s].
    there : ndarray of bool, shape (n,)
        At which it has a sample.

    Returns
    -------
    bool
    """
    steps = np.diff(t[there])
    if steps.size < MIN_STEPS_OF_A_RATE:
        return False
    own, is_own = channel_period(t, steps)
    return is_own and float(np.mean(np.abs(steps / own - 1.0) < 0.5)) > MIN_SHARE_OF_OWN_STEPS
