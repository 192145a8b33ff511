"""Shocks: short stretches in which many samples at once are far from their neighbours, a knock on the bench.

They are distinguished from outliers that are spread over the record by how many large samples stand in one window: more
than the binomial law gives at the share that the record has everywhere. A shock ends where the noise is again what it
was. What stands in its place is a straight line with noise of the same size, so that no frequency lacks power.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kfgen.effects.series import adc_step
from kfgen.identify import words

Array = NDArray[np.float64]
Span = tuple[int, int]

WINDOW_SAMPLES = 32
MIN_WINDOWS = 20
LARGE_DEVIATIONS = 4.5
"""Robust standard deviations beyond which a sample is large; of normal noise six in a window never are."""
FAR_DEVIATIONS = 6.0
"""Robust standard deviations beyond which the mean of a window is far from the usual one."""
MIN_LARGE_IN_WINDOW = 6
LARGE_OF_ONE_OUTLIER = 3
"""Samples that one outlier makes large: itself and its neighbours."""
FALSE_ALARM_PER_RECORD = 1e-6
POWER_OVER_NOISE_OF_TAIL = 1.6
"""Mean square of a window over that of the noise, above which a shock has not ended."""
MAX_SHARE_OF_SHOCKS = 0.05
"""Of the record: beyond, it is its motion or its noise; unless it is few long ones."""
MAX_HANDLINGS = 3
"""Shocks that may be long: the sensor is put down, and lifted."""
MAX_SHARE_OF_HANDLINGS = 0.15
"""Of the record, of so few."""
EDGE_SAMPLES = 16
"""Samples on either side from which the straight line starts."""
SMALLEST_SHARE_OF_RANGE = 1e-9
"""Of the range of a record, that its noise is taken to have at least: a sensor that slept repeats one value."""


def away_from_neighbours(y: Array) -> tuple[Array, float]:
    """Each sample less the mean of its two neighbours, and the robust standard deviation of that.

    Parameters
    ----------
    y : ndarray, shape (n,)
        Samples [SI].

    Returns
    -------
    away : ndarray, shape (n,)
        Zero at both ends; of white noise 1.5 times its variance.
    scale : float
    """
    away = np.zeros(y.size)
    away[1:-1] = y[1:-1] - 0.5 * (y[:-2] + y[2:])
    scale = 1.4826 * float(np.median(np.abs(away)))
    least = SMALLEST_SHARE_OF_RANGE * float(np.ptp(y))
    return away, max(scale, 0.5 * adc_step(y), least, float(np.finfo(float).tiny))


def shocks(y: Array) -> list[Span]:
    """The shocks of an even record, as slices from the first sample to the one after the last.

    Parameters
    ----------
    y : ndarray, shape (n,)
        Samples [SI].
    """
    from scipy.stats import binom

    count = y.size // WINDOW_SAMPLES
    if count < MIN_WINDOWS:
        return []
    away, scale = away_from_neighbours(y)
    windows = np.abs(away[: count * WINDOW_SAMPLES].reshape(count, WINDOW_SAMPLES)) / scale
    large = (windows > LARGE_DEVIATIONS).sum(axis=1)
    if large.max() < MIN_LARGE_IN_WINDOW:
        return []
    per_window = float(np.median([part.mean() for part in np.array_split(large, MIN_WINDOWS)]))
    chance = per_window / (LARGE_OF_ONE_OUTLIER * WINDOW_SAMPLES)
    outliers = float(binom.isf(FALSE_ALARM_PER_RECORD / count, WINDOW_SAMPLES, chance))
    least = max(float(MIN_LARGE_IN_WINDOW), LARGE_OF_ONE_OUTLIER * outliers)
    loud = np.mean(np.minimum(windows, 1e6) ** 2, axis=1) > POWER_OVER_NOISE_OF_TAIL * _usual(windows)
    away_from_level = _away_from_level(y, count)
    found: list[Span] = []
    for k in np.flatnonzero(large >= least).tolist():
        if found and k * WINDOW_SAMPLES < found[-1][1]:
            continue
        first, last = _along(loud, k, k, count)
        first, last = _along(away_from_level, first, last, last - first + 1)
        start, stop = max(first * WINDOW_SAMPLES - EDGE_SAMPLES, 0), min((last + 1) * WINDOW_SAMPLES, y.size)
        if found and start <= found[-1][1]:
            start = found.pop()[0]
        found.append((start, stop))
    share = MAX_SHARE_OF_HANDLINGS if len(found) <= MAX_HANDLINGS else MAX_SHARE_OF_SHOCKS
    return found if sum(b - a for a, b in found) <= share * y.size else []


def _along(yes: NDArray[np.bool_], first: int, last: int, most: int) -> tuple[int, int]:
    """A row of windows made longer at both ends by those next to it for which something holds, by so many at most."""
    ends = first - most, last + most
    while first > max(ends[0], 0) and yes[first - 1]:
        first -= 1
    while last < min(ends[1], yes.size - 1) and yes[last + 1]:
        last += 1
    return first, last


def _away_from_level(y: Array, count: int) -> NDArray[np.bool_]:
    """Windows whose mean is far from the usual one: a sensor that is put down turns slowly at the end."""
    means = y[: count * WINDOW_SAMPLES].reshape(count, WINDOW_SAMPLES).mean(axis=1)
    away = np.abs(means - np.median(means))
    return np.asarray(away > FAR_DEVIATIONS * 1.4826 * np.median(away))


def _usual(windows: Array) -> float:
    """The mean square of windows of the noise: the median over them."""
    return float(np.median(np.mean(np.minimum(windows, 1e6) ** 2, axis=1)))


def bridged(y: Array, spans: list[Span]) -> Array:
    """The samples with a straight line and noise in the place of shocks, shape (n,).

    Parameters
    ----------
    y : ndarray, shape (n,)
        Samples [SI].
    spans : list of (int, int)
        As `shocks` gives them.
    """
    if not spans:
        return y
    out, rng = y.copy(), np.random.default_rng(y.size)
    scale, step = away_from_neighbours(y)[1] / np.sqrt(1.5), adc_step(y)
    for a, b in spans:
        before, after = y[max(a - EDGE_SAMPLES, 0) : a], y[b : b + EDGE_SAMPLES]
        ends = [float(np.median(part)) for part in (before, after) if part.size]
        line = np.linspace(ends[0], ends[-1], b - a)
        out[a:b] = on_grid(line + scale * rng.standard_normal(b - a), step, float(y[0]))
    return out


def on_grid(y: Array, step: float, origin: float) -> Array:
    """Values rounded to an ADC grid, shape (n,).

    Parameters
    ----------
    y : ndarray, shape (n,)
        Values [SI].
    step : float
        Of the grid [SI]; zero for none.
    origin : float
        A value that lies on it [SI].
    """
    return origin + step * np.round((y - origin) / step) if step > 0.0 else y


def shocks_said(t: Array, spans: list[Span]) -> list[str]:
    """A sentence on shocks, with their times.

    Parameters
    ----------
    t : ndarray, shape (n,)
        Times [s].
    spans : list of (int, int)
        As `shocks` gives them.
    """
    if not spans:
        return []
    return [words.shocks([(float(t[a]), float(t[b - 1] - t[a])) for a, b in spans])]
