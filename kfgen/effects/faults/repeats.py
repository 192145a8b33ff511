"""Samples that repeat the one before, distinguished from neighbours that are equal because the ADC grid is coarse.

Differences of Gaussian noise of any colour, both ends rounded to a grid, have one free number, their standard
deviation: ``P(d = k) = F(k + 1) - 2 F(k) + F(k - 1)`` with ``F(x) = x Phi(x / s) + s phi(x / s)``, in steps of the grid.
It is fitted to the differences that are not zero, and says how many are zero by chance; what is more is the share
that repeats. Noise that is not Gaussian has as much at two and three samples' distance, which repeats now and then
have not: both excesses must be beyond chance. Their variance is that of sums over blocks, since equal neighbours of
coloured noise come in rows. Heavy tails or bursts of noise that a sensor has low-passed on a coarse grid can still pass
for repeats.

Samples that lie on no grid may still lie on a grid that a calibration has blurred, which mixes the codes of three axes
and rounds again: values then recur. Two samples far apart are equal as often, over those that are nearly equal, as
two neighbours are by chance. Where a drift was subtracted behind the converter they are equal but for what the mean
moves meanwhile: neighbours must be equal beyond chance whatever of that is allowed for.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Codes = NDArray[np.int64]

BLOCKS = 64
"""Of the record, over which the scatter is taken."""
FALSE_ALARM_PER_RECORD = 5e-4
"""Chance of each of the two tests, both of which must fail."""
MAX_CHANCE = 0.5
"""Of two equal neighbours, above which nothing is said: between samples the noise is less than a step of the grid."""
LAGS_BESIDE = (2, 3, 4, 5)
"""Samples' distances with which that to the neighbour is compared."""
MAX_SHARE_ELSEWHERE = 0.5
"""Of an excess that is less than chance, the excess at the other distances, beyond which noise is rather not Gaussian."""
REACH_SIGMAS = 3.0
"""Of the differences' standard deviation: those that are larger say nothing of their middle."""
MIN_DIFFERENCES_BEYOND_ONE_STEP = 25.0
"""Without so many of two steps of the grid or more the noise between neighbours is not known."""
SAME_SPREAD = 0.1
"""Relative difference of standard deviations that are taken for the same."""
LAGS_AFAR = (16, 17, 18, 19)
"""Samples' distances at which values of no grid are equal by chance alone, and held ones of a slower clock are over."""
NEARLY_EQUAL_SHARE = 0.2
"""Of neighbours that differ, the share that is nearly equal."""
MIN_EXCESS_OVER_CHANCE = 2.0
"""Of a blurred grid: what blurs it are the codes of other axes, which neighbours share more often than samples far apart."""
MAX_CHANCE_OF_NO_GRID = 0.01
"""Of two equal neighbours, below which the grid is as good as none; it may be that of a drift behind the converter."""
MAX_CHANCE_OVER_LAW = 3.0
"""Of two samples far apart that are equal, over what the grid allows: beyond, codes of a coarser grid were moved."""
MEANS_OVER_MEDIAN = 1.5
"""Of the mean's movement where it is fast, over the usual one."""
MAX_DRIFT_SHARE = 0.05
"""Of a usual change between neighbours: a mean that moves more within the distances leaves no values that recur."""
DRIFTS_TRIED = (0.01, 0.03, 0.1, 0.3, 1.0)
"""Over the largest, which is that of noise where nothing drifts."""
MAX_REACH_STEPS = 4096
"""Steps of the grid that are looked at: beyond, chance makes no two samples equal."""


@dataclass(frozen=True)
class Excess:
    """Zero differences at one distance beyond those by chance.

    Parameters
    ----------
    share : float
        Of the pairs that would differ by chance.
    chance : float
        Share of all pairs that is equal by chance.
    influence : ndarray, shape (n - lag,)
        What each pair adds to the share.
    """

    share: float
    chance: float
    influence: Array


def repeated_share(y: Array, step: float) -> float:
    """The share of samples at rest that repeats the one before; zero where that is not beyond chance.

    Parameters
    ----------
    y : ndarray, shape (n,)
        Samples [U].
    step : float
        Of the ADC grid [U]; zero for none.

    Returns
    -------
    float
    """
    from scipy.stats import t

    limit = float(t.isf(FALSE_ALARM_PER_RECORD, BLOCKS - 1))
    if step <= 0.0:
        return _share_of_no_grid(y, limit)
    near = _excess(_differences(y, 1, step))
    if near is None or near.share < limit * _deviation(near.influence) or near.share <= 0.0:
        return 0.0
    if (
        near.chance < MAX_CHANCE_OF_NO_GRID
        or _excess_of_no_grid(y, 0.0).chance > MAX_CHANCE_OVER_LAW * near.chance
    ):
        return _share_of_no_grid(y, limit)
    usual = _typical(_differences(y, 1, step))
    beside = []
    for lag in LAGS_BESIDE:
        coarser = int(np.ceil(_typical(_differences(y, lag, step)) / usual - SAME_SPREAD))
        far = _excess(_differences(y, lag, step, max(coarser, 1)))
        if far is None:
            return 0.0
        beside.append(far)
    last = beside[-1].influence.size
    beyond = near.influence[:last] - np.mean([far.influence[:last] for far in beside], axis=0)
    elsewhere = float(np.mean([far.share for far in beside]))
    most = max(far.share for far in beside[:2])
    if near.share < near.chance and most > MAX_SHARE_ELSEWHERE * near.share:
        return 0.0
    return near.share if near.share - elsewhere >= limit * _deviation(beyond) else 0.0


def rounded_normal(k: Array, s: float) -> Array:
    """Chance of differences of `k` steps between two rounded normal deviates, shape (m,).

    Parameters
    ----------
    k : ndarray, shape (m,)
        Whole steps of the grid.
    s : float
        Standard deviation of the difference before it is rounded, in steps.

    Returns
    -------
    ndarray, shape (m,)
    """
    from scipy.special import ndtr

    def F(x: Array) -> Array:
        return np.asarray(x * ndtr(x / s) + s * np.exp(-0.5 * (x / s) ** 2) / np.sqrt(2.0 * np.pi))

    return np.maximum(F(k + 1.0) - 2.0 * F(k) + F(k - 1.0), 1e-300)


def _differences(y: Array, lag: int, step: float, coarser: int = 1) -> Codes:
    """Absolute differences in steps of a grid so many times as coarse, shape (n - lag,)."""
    code = np.rint((y - y[0]) / step).astype(np.int64) // coarser
    return np.asarray(np.abs(code[lag:] - code[:-lag]), dtype=np.int64)


def _typical(d: Codes) -> float:
    """Root mean square of differences that are no outliers, in steps of the grid."""
    return float(np.sqrt(np.mean(np.minimum(d, 4 * (1 + int(np.quantile(d, 0.75)))).astype(np.float64) ** 2)))


def _share_of_no_grid(y: Array, limit: float) -> float:
    """The share that repeats beyond chance, whatever neighbours differ by that a drift behind the converter moved."""
    usual = float(np.median(np.abs(np.diff(y))))
    most = min(MEANS_OVER_MEDIAN * _movement(y) * max(LAGS_AFAR), MAX_DRIFT_SHARE * usual)
    share = 1.0
    for of_most in (0.0, *DRIFTS_TRIED):
        one = _excess_of_no_grid(y, of_most * most)
        if one.share < max(limit * _deviation(one.influence), MIN_EXCESS_OVER_CHANCE * one.chance):
            return 0.0
        share = min(share, one.share)
    return share


def _movement(y: Array) -> float:
    """How far the mean moves in a sample, by means of blocks."""
    size = max(y.size // BLOCKS, 1)
    means = y[: y.size // size * size].reshape(-1, size).mean(axis=1)
    return float(np.median(np.abs(np.diff(means)))) / size if means.size > 1 else 0.0


def _excess_of_no_grid(y: Array, same: float) -> Excess:
    """Neighbours equal within `same` beyond those by chance; the commonest value, which a dead zone holds, is left out."""
    values, count = np.unique(y, return_counts=True)
    common = y == values[int(np.argmax(count))]
    last = y.size - max(LAGS_AFAR)
    moved = np.abs(np.diff(y))
    moved = moved[moved > same]
    width = float(np.quantile(moved, NEARLY_EQUAL_SHARE)) if moved.size else same

    def pairs(lag: int) -> tuple[Array, Array]:
        d = np.abs(y[lag : lag + last] - y[:last])
        looked = ~(common[lag : lag + last] | common[:last])
        return np.asarray(looked & (d <= same), float), np.asarray(looked & (d > same) & (d <= width), float)

    equal, close = pairs(1)
    afar = [pairs(lag) for lag in LAGS_AFAR]
    equal_afar, close_afar = (np.mean([pair[k] for pair in afar], axis=0) for k in (0, 1))
    among = max(float(close_afar.sum()), 1.0)
    ratio, weight = float(equal_afar.sum()) / among, float(close.sum()) / among
    chance = ratio * float(close.sum())
    away = max(last - chance, 1.0)
    each = equal - ratio * close - weight * (equal_afar - ratio * close_afar)
    return Excess((float(equal.sum()) - chance) / away, chance / last, each / away)


def _excess(d: Codes) -> Excess | None:
    """Zeros among differences beyond chance; None where the noise between samples is too small to say that."""
    is_zero = (d == 0).astype(np.float64)
    moved = d[d > 0]
    if not moved.size:
        return None
    middle = float(np.median(moved))
    reach = int(np.ceil(REACH_SIGMAS * max(middle / 0.6745, 1.0)))
    if reach > MAX_REACH_STEPS:
        return Excess(float(is_zero.mean()), 0.0, is_zero / d.size)
    inside = (d > 0) & (d <= reach)
    k = np.arange(1, reach + 1, dtype=np.float64)
    count = np.bincount(d[inside], minlength=reach + 1)[1:].astype(np.float64)
    if count[1:].sum() < MIN_DIFFERENCES_BEYOND_ONE_STEP:
        return None
    s = _fitted(k, count, middle)
    h = 1e-4
    logs = [np.log(rounded_normal(k, s * np.exp(e))) for e in (-h, 0.0, h)]
    ratios = [
        0.5 * float(rounded_normal(np.zeros(1), s * np.exp(e))[0] / np.exp(log).sum())
        for e, log in zip((-h, 0.0, h), logs)
    ]
    ratio, slope = ratios[1], (ratios[2] - ratios[0]) / (2.0 * h)
    score = (logs[2] - logs[0]) / (2.0 * h)
    score = score - float(score @ np.exp(logs[1])) / float(np.exp(logs[1]).sum())
    information = float(count @ score**2)
    chance = ratio * float(count.sum())
    away = d.size - chance
    if chance > MAX_CHANCE * d.size:
        return None
    each = is_zero - ratio * inside
    each[inside] -= slope * float(count.sum()) / max(information, 1e-300) * score[d[inside] - 1]
    return Excess((float(is_zero.sum()) - chance) / away, chance / d.size, each / away)


def _fitted(k: Array, count: Array, middle: float) -> float:
    """Standard deviation, in steps of the grid, under which counts of the differences that are not zero are likeliest."""
    from scipy.optimize import minimize_scalar

    def loss(log_s: float) -> float:
        p = rounded_normal(k, float(np.exp(log_s)))
        return float(count.sum()) * float(np.log(p.sum())) - float(count @ np.log(p))

    about = float(np.log(middle / 0.6745))
    return float(np.exp(minimize_scalar(loss, bounds=(about - 2.5, about + 1.5), method="bounded").x))


def _deviation(influence: Array) -> float:
    """Standard deviation of a sum of influences: by blocks, and no less than of independent ones."""
    centred = influence - influence.mean()
    whole = centred[: centred.size // BLOCKS * BLOCKS].reshape(BLOCKS, -1).sum(axis=1)
    return float(np.sqrt(max(np.sum(whole**2) * BLOCKS / (BLOCKS - 1.0), np.sum(centred**2))))
