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

Array = NDArray[np.float64]

HISTOGRAM_BINS = 3000
"""Bins up to six standard deviations."""
MIN_OUTLIERS_EXPECTED = 0.5
"""Samples of the wide law on average below which there is none."""
LOG_LEVEL_RANGE = (-float(np.log(1e3)), float(np.log(1e3)))
"""Range of the logarithm of the narrow law's standard deviation over that of the series."""
LOG_SHARE_RANGE = (float(np.log(1e-6)), float(np.log(0.3)))
"""Range of the logarithm of the share: a log-uniform prior."""
LOG_KAPPA_RANGE = (float(np.log(1.3)), float(np.log(1e3)))
"""Range of the logarithm of the ratio of standard deviations: a log-uniform prior."""


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

        size = np.abs(z)
        top = float(size.max())
        edges = np.unique(
            np.concatenate(
                [np.linspace(0.0, 6.0, HISTOGRAM_BINS), np.geomspace(6.0, max(top, 6.1) * 1.01, 300)]
            )
        )
        count = np.histogram(size, edges)[0].astype(float)
        middle = 0.5 * (edges[1:] + edges[:-1])
        some = count > 0.0
        count, square = count[some], middle[some] ** 2
        mean, sd = level_prior

        def normal(log_level: float) -> Array:
            return np.asarray(-0.5 * square * np.exp(-2.0 * log_level) - log_level)

        def slope_of_one(p: Any) -> Array:
            falls = square * np.exp(-2.0 * float(p[0])) - 1.0
            return np.array([(p[0] - mean) / sd**2 - count @ falls])

        def slope_of_two(p: Any) -> Array:
            share = float(np.exp(p[1]))
            narrow, wide = normal(float(p[0])), normal(float(p[0] + p[2]))
            wider = 1.0 / (1.0 + np.exp(np.clip(narrow - wide + np.log1p(-share) - p[1], -700.0, 700.0)))
            inner, outer = (square * np.exp(-2.0 * float(level)) - 1.0 for level in (p[0], p[0] + p[2]))
            by_level = (p[0] - mean) / sd**2 - count @ (inner + wider * (outer - inner))
            return np.array([by_level, -count @ (wider - share) / (1.0 - share), -count @ (wider * outer)])

        def one(p: Any) -> float:
            return -float(count @ normal(float(p[0]))) + 0.5 * ((float(p[0]) - mean) / sd) ** 2

        def two(p: Any) -> float:
            share = float(np.exp(np.clip(p[1], *LOG_SHARE_RANGE)))
            narrow, wide = normal(float(p[0])), normal(float(p[0] + p[2]))
            both = np.logaddexp(float(np.log1p(-share)) + narrow, float(np.log(share)) + wide)
            outside = sum(
                max(0.0, lo - v) + max(0.0, v - hi)
                for v, (lo, hi) in ((p[1], LOG_SHARE_RANGE), (p[2], LOG_KAPPA_RANGE))
            )
            return float(-(count @ both) + 0.5 * ((p[0] - mean) / sd) ** 2 + 1e3 * outside)

        how = {"method": "L-BFGS-B", "options": {"ftol": 1e-14, "gtol": 1e-6}}
        base = minimize(one, [0.0], jac=slope_of_one, bounds=[LOG_LEVEL_RANGE], **how)
        box = [LOG_LEVEL_RANGE, LOG_SHARE_RANGE, LOG_KAPPA_RANGE]
        best = None
        for kappa in (2.0, 4.0, 12.0):
            start = [0.0, np.log(max(float(np.mean(size > 2.0 * kappa)), 2.0 / z.size, 1e-5)), np.log(kappa)]
            found = minimize(two, start, jac=slope_of_two, bounds=box, **how)
            if best is None or found.fun < best.fun:
                best = found
        assert best is not None
        share, kappa = float(np.exp(best.x[1])), float(np.exp(best.x[2]))
        if best.fun >= base.fun or share * z.size < MIN_OUTLIERS_EXPECTED:
            return None
        H, H0 = _second(two, best.x), _second(one, base.x)
        values = np.maximum(np.linalg.eigvalsh(H), 1e-2)
        gain = float(base.fun - best.fun) + np.log(2.0 * np.pi) - 0.5 * float(np.log(values).sum())
        gain += 0.5 * float(np.log(max(float(H0[0, 0]), 1e-2)))
        gain -= float(
            np.log((LOG_SHARE_RANGE[1] - LOG_SHARE_RANGE[0]) * (LOG_KAPPA_RANGE[1] - LOG_KAPPA_RANGE[0]))
        )
        spread = np.sqrt(np.abs(np.diag(np.linalg.pinv(H, hermitian=True))))
        return Mixture(float(np.exp(best.x[0])), share, kappa, float(gain), spread)


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
