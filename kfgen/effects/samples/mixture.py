"""Outliers as a mixture of two normal laws of one centre (contaminated normal), fitted to a histogram.

References
----------
.. [1] J. W. Tukey, A survey of sampling from contaminated distributions, 1960.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaincc

Array = NDArray[np.float64]

HISTOGRAM_BINS = 3000
"""Bins up to six standard deviations."""
MIN_OUTLIERS_EXPECTED = 0.5
"""Samples of the wide law on average below which there is none."""
LOG_LEVEL_RANGE = (-float(np.log(1e3)), float(np.log(1e3)))
"""Range of the logarithm of the narrow law's standard deviation over that of the series."""
LOG_SHARE_RANGE = (float(np.log(1e-6)), float(np.log(0.3)))
"""Range of the logarithm of the share: a log-uniform prior."""
END_OF_LOG_SHARE = 0.01
"""From the end of that range, within which a share is as large as it may be."""
LOG_KAPPA_RANGE = (float(np.log(1.3)), float(np.log(1e3)))
"""Range of the logarithm of the ratio of standard deviations: a log-uniform prior."""
SURE_OF_WIDE = 0.9
"""Probability of the wide law from which a sample surely has it."""
MAX_PAUSE_IN_EVENT_SAMPLES = 64
"""Samples between two that are of one event: a glitch, a knock on the bench that rings down."""
NEIGHBOURS_OF_EVENT_SAMPLES = 16
"""On either side of a single sample: louder than the noise where it is the crest of an event, and no bad sample."""
MAX_CHANCE_OF_LOUD_NEIGHBOURS = 1e-3
"""False alarm of that test: a bad sample among loud neighbours that are noise."""


@dataclass(frozen=True)
class Mixture:
    """``(1 - share) N(0, level^2) + share N(0, (kappa level)^2)``, with its evidence over one normal law.

    Parameters
    ----------
    level : float
        Standard deviation of the narrow law.
    share : float
        Share of the samples in the wide law.
    kappa : float
        Standard deviation of the wide law over that of the narrow one.
    evidence : float
        Logarithm of the ratio of marginal likelihoods [nats].
    spread : ndarray, shape (3,)
        Standard deviations of the logarithms of level, share and kappa.
    """

    level: float
    share: float
    kappa: float
    evidence: float
    spread: Array

    @property
    def is_the_noise(self) -> bool:
        """Whether no share is large enough: samples of the wide law are then no outliers, but the noise of all of them."""
        return float(np.log(self.share)) > LOG_SHARE_RANGE[1] - END_OF_LOG_SHARE

    def is_at_one_place(self, z: Array) -> bool:
        """Whether the samples of a series that are surely of the wide law follow one another: one event, and no law.

        A single one is an event where its neighbours are louder than the narrow law, by the sum of their squares.

        Parameters
        ----------
        z : ndarray, shape (n,)
            The series that was fitted.

        Returns
        -------
        bool
        """
        at = np.flatnonzero(chance_of_wide(z / self.level, self.share, self.kappa) > SURE_OF_WIDE)
        if at.size == 1:
            first, last = max(at[0] - NEIGHBOURS_OF_EVENT_SAMPLES, 0), at[0] + NEIGHBOURS_OF_EVENT_SAMPLES
            sides = np.delete(z, at)[first:last] / self.level
            return bool(gammaincc(sides.size / 2, sides @ sides / 2) < MAX_CHANCE_OF_LOUD_NEIGHBOURS)
        return at.size > 1 and bool((np.diff(at) <= MAX_PAUSE_IN_EVENT_SAMPLES).all())

    @staticmethod
    def fitted(z: Array, level_prior: tuple[float, float]) -> Mixture | None:
        """Fit the mixture to a series.

        Parameters
        ----------
        z : ndarray, shape (n,)
            The series, of about unit standard deviation.
        level_prior : (mean, standard deviation)
            Prior of the logarithm of `level`.

        Returns
        -------
        Mixture or None
            None where one normal law is as good, or fewer than `MIN_OUTLIERS_EXPECTED` samples are in the wide one.
        """
        from scipy.optimize import minimize

        law = _Histogram.of(z, level_prior)
        how = {"method": "L-BFGS-B", "options": {"ftol": 1e-14, "gtol": 1e-6}}
        base = minimize(law.one, [0.0], jac=law.slope_of_one, bounds=[LOG_LEVEL_RANGE], **how)
        box = [LOG_LEVEL_RANGE, LOG_SHARE_RANGE, LOG_KAPPA_RANGE]
        found = []
        for kappa in (2.0, 4.0, 12.0):
            beyond = float(np.mean(np.abs(z) > 2.0 * kappa))
            start = [0.0, np.log(max(beyond, 2.0 / z.size, 1e-5)), np.log(kappa)]
            found.append(minimize(law.two, start, jac=law.slope_of_two, bounds=box, **how))
        best = min(found, key=lambda f: float(f.fun))
        share, kappa = float(np.exp(best.x[1])), float(np.exp(best.x[2]))
        if best.fun >= base.fun or share * z.size < MIN_OUTLIERS_EXPECTED:
            return None
        H, H0 = _second(law.two, best.x), _second(law.one, base.x)
        values = np.maximum(np.linalg.eigvalsh(H), 1e-2)
        gain = float(base.fun - best.fun) + np.log(2.0 * np.pi) - 0.5 * float(np.log(values).sum())
        gain += 0.5 * float(np.log(max(float(H0[0, 0]), 1e-2)))
        gain -= float(
            np.log((LOG_SHARE_RANGE[1] - LOG_SHARE_RANGE[0]) * (LOG_KAPPA_RANGE[1] - LOG_KAPPA_RANGE[0]))
        )
        spread = np.sqrt(np.abs(np.diag(np.linalg.pinv(H, hermitian=True))))
        return Mixture(float(np.exp(best.x[0])), share, kappa, float(gain), spread)


def chance_of_wide(z: Array, share: float, kappa: float) -> Array:
    """Probability of each sample to have the wide law of a mixture.

    Parameters
    ----------
    z : ndarray, shape (n,)
        Samples over the standard deviation of the narrow law.
    share, kappa : float
        As of `Mixture`.

    Returns
    -------
    ndarray, shape (n,)
    """
    odds = share / (1.0 - share) / kappa
    log_odds = np.clip(0.5 * z**2 * (1.0 - kappa**-2) + np.log(odds), -700.0, 700.0)
    return np.asarray(1.0 / (1.0 + np.exp(-log_odds)))


@dataclass(frozen=True)
class _Histogram:
    """Counts of squares, and minus the logarithm of their probability under one law and under two, with the slopes."""

    count: Array
    square: Array
    mean: float
    sd: float

    @staticmethod
    def of(z: Array, level_prior: tuple[float, float]) -> _Histogram:
        """Of a series of about unit standard deviation."""
        size = np.abs(z)
        top = max(float(size.max()), 6.1) * 1.01
        edges = np.unique(
            np.concatenate([np.linspace(0.0, 6.0, HISTOGRAM_BINS), np.geomspace(6.0, top, 300)])
        )
        count = np.histogram(size, edges)[0].astype(float)
        some = count > 0.0
        middle = 0.5 * (edges[1:] + edges[:-1])
        return _Histogram(count[some], middle[some] ** 2, *level_prior)

    def _normal(self, log_level: float) -> Array:
        return np.asarray(-0.5 * self.square * np.exp(-2.0 * log_level) - log_level)

    def _falls(self, log_level: float) -> Array:
        return np.asarray(self.square * np.exp(-2.0 * log_level) - 1.0)

    def one(self, p: Any) -> float:
        """Of the logarithm of the level."""
        level = float(p[0])
        return -float(self.count @ self._normal(level)) + 0.5 * ((level - self.mean) / self.sd) ** 2

    def slope_of_one(self, p: Any) -> Array:
        """Its derivative."""
        level = float(p[0])
        return np.array([(level - self.mean) / self.sd**2 - self.count @ self._falls(level)])

    def two(self, p: Any) -> float:
        """Of the logarithms of level, share and kappa; steep outside of their ranges."""
        share = float(np.exp(np.clip(p[1], *LOG_SHARE_RANGE)))
        narrow, wide = self._normal(float(p[0])), self._normal(float(p[0] + p[2]))
        both = np.logaddexp(float(np.log1p(-share)) + narrow, float(np.log(share)) + wide)
        outside = sum(
            max(0.0, lo - v) + max(0.0, v - hi)
            for v, (lo, hi) in ((p[1], LOG_SHARE_RANGE), (p[2], LOG_KAPPA_RANGE))
        )
        prior = 0.5 * ((p[0] - self.mean) / self.sd) ** 2
        return float(-(self.count @ both) + prior + 1e3 * outside)

    def slope_of_two(self, p: Any) -> Array:
        """Its derivatives inside the ranges."""
        share = float(np.exp(p[1]))
        narrow, wide = self._normal(float(p[0])), self._normal(float(p[0] + p[2]))
        ratio = np.clip(narrow - wide + np.log1p(-share) - p[1], -700.0, 700.0)
        wider = 1.0 / (1.0 + np.exp(ratio))
        inner, outer = self._falls(float(p[0])), self._falls(float(p[0] + p[2]))
        by_level = (p[0] - self.mean) / self.sd**2 - self.count @ (inner + wider * (outer - inner))
        by_share = -self.count @ (wider - share) / (1.0 - share)
        return np.array([by_level, by_share, -self.count @ (wider * outer)])


def _second(f: Callable[[Any], float], x: Array, step: float = 1e-3) -> Array:
    """Second derivatives by central differences, shape (k, k)."""
    k = x.size
    H = np.zeros((k, k))
    h = step * np.eye(k)
    for i in range(k):
        for j in range(i + 1):
            H[i, j] = H[j, i] = (
                f(x + h[i] + h[j]) - f(x + h[i] - h[j]) - f(x - h[i] + h[j]) + f(x - h[i] - h[j])
            ) / (4.0 * step**2)
    return H
