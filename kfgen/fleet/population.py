"""`Population`: the distribution of a parameter over sensors, from estimates that each have an error of their own.

The estimate of sensor i is ``y_i = mu + u_i + e_i``, with ``Var u = spread^2`` the same for all sensors and
``Var e_i`` known from its interval: the random-effects model of meta-analysis.

References
----------
.. [1] R. DerSimonian, N. Laird, Meta-analysis in clinical trials, Controlled Clinical Trials 7, 1986.
.. [2] W. Viechtbauer, Confidence intervals for the amount of heterogeneity in meta-analysis, Statistics in
   Medicine 26, 2007.
.. [3] G. Knapp, J. Hartung, Improved tests for a random effects meta-regression with a single covariate,
   Statistics in Medicine 22, 2003.
.. [4] K. Nagashima, H. Noma, T. A. Furukawa, Prediction intervals for random-effects meta-analysis: a confidence
   distribution approach, Statistical Methods in Medical Research 28, 2019.
.. [5] B. Rosner, Percentage points for a generalized ESD many-outlier procedure, Technometrics 25, 1983.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Interval = tuple[float, float]

CONFIDENCE_LEVEL = 0.95
"""Of every interval."""
MIN_SENSORS_FOR_OUTLIER = 4
"""Sensors from which on one of them can be an outlier."""
MAX_OUTLIERS = 20
"""Outliers that are looked for in a number."""
NODES_IN_STANDARD_DEVIATIONS = np.linspace(-6.0, 6.0, 121)
"""Of the quadrature over a confidence distribution."""


@dataclass(frozen=True)
class Population:
    """A normal distribution over sensors.

    Parameters
    ----------
    size : int
        Sensors.
    mean : float
        Weighted by what is known of each; of a normal distribution the median too.
    spread : float
        Standard deviation between sensors, without their own errors, by the method of moments [1]_.
    error : float
        Standard deviation of the mean.
    mean95 : (float, float)
        By Student's law, at least as wide as the spread says [3]_; unbounded for one sensor.
    spread95 : (float, float)
        By inversion of Cochran's Q [2]_.
    next95 : (float, float)
        Where the next sensor of the kind lies [4]_; unbounded for fewer than three sensors.
    """

    size: int
    mean: float
    spread: float
    error: float
    mean95: Interval
    spread95: Interval
    next95: Interval


def population(y: Array, s: Array) -> Population:
    """The population from which sensors are drawn.

    Parameters
    ----------
    y : ndarray, shape (k,)
        One estimate of each sensor.
    s : ndarray, shape (k,)
        Their standard deviations, in the unit of `y`.
    """
    from scipy.stats import t as student

    k = y.size
    mean, spread, error = _moments(y, s)
    w = 1.0 / (s**2 + spread**2)
    excess = max(1.0, float((w * (y - mean) ** 2).sum()) / (k - 1)) if k > 1 else 1.0
    wide = (
        float(student.ppf(0.5 * (1.0 + CONFIDENCE_LEVEL), k - 1)) * error * excess**0.5 if k > 1 else np.inf
    )
    ahead = NextSensor.of(y, s).interval() if k > 2 else (-np.inf, np.inf)
    return Population(k, mean, spread, error, _around(mean, wide), _spread95(y, s), ahead)


def _around(mean: float, wide: float) -> Interval:
    return mean - wide, mean + wide


def _moments(y: Array, s: Array) -> tuple[float, float, float]:
    """Mean, spread between sensors, and standard deviation of the mean [1]_."""
    w = 1.0 / s**2
    spread = 0.0
    if y.size > 1:
        rest = float(w.sum() - (w**2).sum() / w.sum())
        spread = max(0.0, (_cochran_q(y, s, 0.0) - (y.size - 1)) / rest) ** 0.5
    w = 1.0 / (s**2 + spread**2)
    return float((w * y).sum() / w.sum()), spread, float(w.sum() ** -0.5)


def _cochran_q(y: Array, s: Array, variance: float) -> float:
    """Weighted sum of squares about the weighted mean, for a variance between sensors."""
    w = 1.0 / (s**2 + variance)
    return float((w * (y - (w * y).sum() / w.sum()) ** 2).sum())


def _spread95(y: Array, s: Array) -> Interval:
    """The spreads for which Cochran's Q is neither too large nor too small [2]_."""
    from scipy.optimize import brentq
    from scipy.stats import chi2

    if y.size < 2:
        return 0.0, np.inf
    ends = []
    for share in (0.5 * (1.0 + CONFIDENCE_LEVEL), 0.5 * (1.0 - CONFIDENCE_LEVEL)):
        wanted = float(chi2.ppf(share, y.size - 1))
        if _cochran_q(y, s, 0.0) <= wanted:
            ends.append(0.0)
            continue
        top = float(np.ptp(y)) ** 2 + float((s**2).max())
        while _cochran_q(y, s, top) > wanted:
            top *= 4.0
        found = brentq(lambda v, q: _cochran_q(y, s, v) - q, 0.0, top, args=(wanted,), xtol=1e-12 * top)
        ends.append(float(found) ** 0.5)
    return ends[0], ends[1]


@dataclass(frozen=True)
class NextSensor:
    """Where the true value of a next sensor lies: a mixture of normal laws over what the spread may be [4]_.

    Cochran's Q at the true spread is chi-square with k - 1 degrees of freedom; each of its quantiles gives a
    spread, a mean and an error of the mean. Where the sensors' own errors vanish this is Student's law with
    k - 1 degrees of freedom, where the sensors are alike the normal law.

    Parameters
    ----------
    weight, mean, variance : ndarray, shape (m,)
        Of each normal law of the mixture.
    """

    weight: Array
    mean: Array
    variance: Array

    @classmethod
    def of(cls, y: Array, s: Array) -> NextSensor:
        """Seen from at least two estimates.

        Parameters
        ----------
        y, s : ndarray, shape (k,)
            Estimates and their standard deviations.
        """
        from scipy.stats import chi2, norm

        top = float(np.ptp(y)) ** 2 + float((s**2).max())
        grid = np.concatenate([[0.0], top * np.geomspace(1e-8, 1e8, 321)])
        w = 1.0 / (s**2 + grid[:, None])
        mean = (w @ y) / w.sum(axis=1)
        Q = (w * (y - mean[:, None]) ** 2).sum(axis=1)
        wanted = np.where(
            NODES_IN_STANDARD_DEVIATIONS < 0.0,
            chi2.ppf(norm.cdf(NODES_IN_STANDARD_DEVIATIONS), y.size - 1),
            chi2.isf(norm.sf(NODES_IN_STANDARD_DEVIATIONS), y.size - 1),
        )
        at = np.interp(-np.log(wanted), -np.log(np.maximum(Q, 1e-300)), np.arange(Q.size))
        low = np.floor(at).astype(int)
        part, high = at - low, np.minimum(low + 1, Q.size - 1)
        spread = np.where(
            low == 0, part * grid[1], np.exp(_interpolated(np.log(np.maximum(grid, 1e-300)), low, high, part))
        )
        error = 1.0 / w.sum(axis=1)
        weight = norm.pdf(NODES_IN_STANDARD_DEVIATIONS)
        return cls(
            weight / weight.sum(),
            _interpolated(mean, low, high, part),
            spread + _interpolated(error, low, high, part),
        )

    def p_value(self, value: float, own: float) -> float:
        """Two-sided p-value of an estimate.

        Parameters
        ----------
        value : float
            The estimate.
        own : float
            Its own standard deviation.
        """
        from scipy.stats import norm

        z = np.abs(value - self.mean) / np.sqrt(self.variance + own**2)
        return float(2.0 * (self.weight * norm.sf(z)).sum())

    def interval(self) -> Interval:
        """Of the true value."""
        from scipy.optimize import brentq
        from scipy.stats import norm

        deviation = np.sqrt(self.variance)

        def below(x: float, share: float) -> float:
            return float((self.weight * norm.cdf((x - self.mean) / deviation)).sum()) - share

        far = 10.0 * float(deviation.max())
        ends = float(self.mean.min()) - far, float(self.mean.max()) + far
        lo, hi = (
            float(brentq(below, *ends, args=(p,)))
            for p in (0.5 * (1.0 - CONFIDENCE_LEVEL), 0.5 * (1.0 + CONFIDENCE_LEVEL))
        )
        return lo, hi


def _interpolated(values: Array, low: NDArray[np.int_], high: NDArray[np.int_], part: Array) -> Array:
    return np.asarray((1.0 - part) * values[low] + part * values[high])


@dataclass(frozen=True)
class OutlyingSensor:
    """A sensor that is not of the population of the others.

    Parameters
    ----------
    index : int
        Among the estimates.
    deviations : float
        How many standard deviations off.
    p : float
        p-value among those that were left.
    """

    index: int
    deviations: float
    p: float


def outliers(y: Array, s: Array, rate: float) -> list[OutlyingSensor]:
    """The outlying sensors, by Rosner's many-outlier procedure [5]_.

    The sensor farthest from the others is set aside, then the farthest of the rest, up to a quarter of them:
    so two outliers cannot hide each other. All up to the last one that is significant are outliers. A sensor
    is held against where the others say the next one lies.

    Parameters
    ----------
    y, s : ndarray, shape (k,)
        Estimates and their standard deviations.
    rate : float
        Share of populations without an outlier in which one is named.
    """
    left = np.arange(y.size)
    found: list[OutlyingSensor] = []
    last = 0
    for _ in range(min(MAX_OUTLIERS, y.size // 4) if y.size >= MIN_SENSORS_FOR_OUTLIER else 0):
        far = _farthest(y[left], s[left])
        found.append(OutlyingSensor(int(left[far.index]), far.deviations, min(1.0, far.p * left.size)))
        if found[-1].p < rate:
            last = len(found)
        left = np.delete(left, far.index)
    return found[:last]


def _farthest(y: Array, s: Array) -> OutlyingSensor:
    mean, spread, _ = _moments(y, s)
    i = int((np.abs(y - mean) / np.hypot(s, spread)).argmax())
    others, errors = np.delete(y, i), np.delete(s, i)
    mean, spread, error = _moments(others, errors)
    z = abs(float(y[i]) - mean) / float(np.sqrt(s[i] ** 2 + spread**2 + error**2))
    return OutlyingSensor(i, z, NextSensor.of(others, errors).p_value(float(y[i]), float(s[i])))


def standard_deviation(interval: Sequence[float]) -> float:
    """The standard deviation of an estimate from its 95 % interval."""
    from scipy.stats import norm

    return float(interval[1] - interval[0]) / (2.0 * float(norm.ppf(0.5 * (1.0 + CONFIDENCE_LEVEL))))
