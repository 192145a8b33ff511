"""`integral`: a marginal likelihood by adaptive importance sampling (population Monte Carlo [1]_).

For effects of a few parameters whose likelihood is not normal, and cheap to evaluate at many points at once.

References
----------
.. [1] O. Cappé, A. Guillin, J.-M. Marin and C. P. Robert, Population Monte Carlo, J. Comput. Graph. Statist. 13(4), 2004.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

DRAWS_PER_ROUND = 64
"""Points drawn in a round."""
MAX_ROUNDS = 6
"""Rounds, each from the law that the one before it found."""
FINAL_ROUNDS = 2
"""Last rounds, from which the integral is taken; those before find where the integrand is large."""
STUDENT_DEGREES_OF_FREEDOM = 6.0
"""Degrees of freedom of Student's law from which points are drawn: its tails are heavier than the normal ones."""
HALFWAY_ROUND = 3
"""Rounds after which `integral` gives up where its bar was not reached."""
MIN_EFFECTIVE_DRAWS = 12.0
"""Effective sample size of a round below which its weights are tempered."""


@dataclass(frozen=True)
class Integral:
    """The logarithm of an integral, and mean and covariance of the law that the integrand is proportional to.

    Parameters
    ----------
    log : float
        [nats].
    mean : ndarray, shape (k,)
    covariance : ndarray, shape (k, k)
    """

    log: float
    mean: Array
    covariance: Array


def integral(
    log_f: Callable[[Array], Array],
    points: Array,
    bar: float = -np.inf,
    seed: int = 0,
    values: Array | None = None,
) -> Integral | None:
    """The integral of ``exp(log_f)`` over its k arguments [1]_.

    Parameters
    ----------
    log_f : callable
        Of points, shape (p, k), to values, shape (p,) [nats].
    points : ndarray, shape (p, k)
        First points, more than k, of which the best lie near the maximum.
    bar : float
        What the function must have reached after half the rounds [nats]; else there is no answer.
    seed : int
        Of the random numbers.
    values : ndarray, shape (p,), optional
        The function at the first points, where it is known.

    Returns
    -------
    Integral or None
        None where `bar` was not reached.
    """
    rng = np.random.default_rng(seed)
    values = log_f(points) if values is None else values
    top = float(values.max())
    logs: list[Array] = []
    points_of: list[Array] = []
    mean, covariance = _law(points, values)
    for r in range(MAX_ROUNDS):
        drawn = _draw(rng, mean, covariance)
        values = log_f(drawn)
        top = max(top, float(values.max()))
        if r == HALFWAY_ROUND - 1 and top < bar:
            return None
        w = values - _log_density(drawn, mean, covariance)
        mean, covariance = _law(drawn, w)
        if r >= MAX_ROUNDS - FINAL_ROUNDS:
            logs.append(w)
            points_of.append(drawn)
    every = np.concatenate(logs)
    mean, covariance = _law(np.concatenate(points_of), every)
    top = float(every.max())
    return Integral(top + float(np.log(np.mean(np.exp(every - top)))), mean, covariance)


def log_integral_about(log_f: Callable[[Array], Array], middle: Array, spread: Array) -> float:
    """The logarithm of the integral of ``exp(log_f)``, looked for from points about a middle.

    Parameters
    ----------
    log_f : callable
        As for `integral`.
    middle, spread : ndarray, shape (k,)
        Mean and standard deviations of the first points.

    Returns
    -------
    float
        [nats].
    """
    drawn = np.random.default_rng(0).standard_normal((DRAWS_PER_ROUND, middle.size))
    found = integral(log_f, middle + spread * drawn)
    assert found is not None
    return found.log


def _law(points: Array, w: Array) -> tuple[Array, Array]:
    """Mean and covariance of points under weights that are evened until enough of them count."""
    k, heat = points.shape[1], 1.0
    while True:
        p = np.exp(heat * (w - w.max()))
        p /= p.sum()
        if 1.0 / float(p @ p) >= MIN_EFFECTIVE_DRAWS or heat < 1e-3:
            break
        heat *= 0.7
    mean = p @ points
    d = points - mean
    covariance = (p[:, None] * d).T @ d * MIN_EFFECTIVE_DRAWS / (MIN_EFFECTIVE_DRAWS - 1.0)
    # Points may lie in a plane; coordinates are logarithms, or in units of what they may be.
    return np.asarray(mean), np.asarray(covariance + 1e-8 * (np.eye(k) + np.diag(np.diag(covariance))))


def _draw(rng: np.random.Generator, mean: Array, covariance: Array) -> Array:
    L = np.linalg.cholesky(covariance)
    normal = rng.standard_normal((DRAWS_PER_ROUND, mean.size))
    return np.asarray(
        mean
        + (normal @ L.T)
        / np.sqrt(
            rng.chisquare(STUDENT_DEGREES_OF_FREEDOM, (DRAWS_PER_ROUND, 1)) / STUDENT_DEGREES_OF_FREEDOM
        )
    )


def _log_density(points: Array, mean: Array, covariance: Array) -> Array:
    from scipy.stats import multivariate_t

    scale = np.sqrt(np.diag(covariance))
    law = multivariate_t(shape=covariance / np.outer(scale, scale), df=STUDENT_DEGREES_OF_FREEDOM)
    return np.asarray(law.logpdf((points - mean) / scale) - np.log(scale).sum())
