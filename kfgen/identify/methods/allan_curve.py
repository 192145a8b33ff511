"""The Allan curve fitted by the declared effects, a Gauss-Markov term among them.

Least squares on the logarithm of the Allan variance at octaves of averaging time. With degrees
of freedom as weights, ``ln AVAR`` has the variance ``2 / edf`` [1]_. With wavelet weights the
points are Haar wavelet variances (half the Allan variance at octaves) and their covariance is
the asymptotic one under the spectrum ``S`` of the terms fitted first [2]_,
``cov(a_i, a_j) = (2 / M) (1 / 2 pi) int |H_i|^2 |H_j|^2 S^2``: the efficient second step of the
generalised method of wavelet moments [3]_. The curvature of the fit gives its intervals.

References
----------
.. [1] N. El-Sheimy, H. Hou and X. Niu, Analysis and modeling of inertial sensors using Allan variance,
   IEEE Trans. Instrum. Meas. 57(1), 2008, eq. (14).
.. [2] D. B. Percival, On estimation of the wavelet variance, Biometrika 82(3), 1995, sec. 3.
.. [3] S. Guerrier, J. Skaloud, Y. Stebler and M.-P. Victoria-Feser, Wavelet-variance-based estimation for
   composite stochastic processes, J. Am. Stat. Assoc. 108(503), 2013, sec. 3.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kfgen.effects import Effect, make
from kfgen.identify.evidence.record import Evidence
from kfgen.identify.evidence.shapes import Shapes
from kfgen.identify.fit.fit import Problem

Array = NDArray[np.float64]

POINTS = 128
"""Frequencies an octave at which a covariance is integrated."""
GOLDEN = 0.6180339887498949
"""Spreads them evenly whatever the period of a transfer function."""

WALK, RAMP = "rate_random_walk", "rate_ramp"
"""What the end of a curve rises by: AVAR grows as the averaging time, or as its square."""

Weighting = Callable[[Evidence, Sequence[Effect]], Array]
"""Evidence and the effects fitted first, as a matrix that whitens the logarithms of the variances."""


@dataclass(frozen=True)
class CurveFit:
    """Fitted effects, the logarithms of their parameters with covariance, and how well they fit.

    Parameters
    ----------
    misfit : float
        Sum of squares of the whitened residuals.
    chance : float
        Probability of a larger misfit under the model.
    """

    effects: tuple[Effect, ...]
    point: Array
    covariance: Array
    misfit: float
    chance: float


def by_degrees_of_freedom(record: Evidence, effects: Sequence[Effect]) -> Array:
    """Each point by its own degrees of freedom.

    Parameters
    ----------
    record : Evidence
        What is identified.
    effects : sequence of Effect
        With their values [SI].
    """
    return np.diag(np.sqrt(record.octaves.edf / 2.0))


def by_wavelet_covariance(record: Evidence, effects: Sequence[Effect]) -> Array:
    """All points by their covariance under the effects.

    Parameters
    ----------
    record : Evidence
        What is identified.
    effects : sequence of Effect
        With their values [SI].
    """
    m = np.round(record.octaves.tau / record.dt)
    bands = int(np.ceil(np.log2(m[-1]))) + 3
    share = (np.arange(bands * POINTS) * GOLDEN) % 1.0
    octave = np.repeat(np.arange(bands), POINTS)
    omega = np.pi * 2.0 ** -(octave + share)
    weight = omega * np.log(2.0) / POINTS
    S = np.sum([e.sampled_density(omega, record.dt, 1) for e in effects], axis=0)
    transfer = 2.0 * np.sin(0.5 * np.outer(m, omega)) ** 4 / (m[:, None] * np.sin(0.5 * omega)) ** 2
    level = (transfer * weight) @ S / np.pi
    spread = (transfer * (weight * S**2)) @ transfer.T / np.pi
    count = np.maximum(record.n - 2.0 * m + 1.0, 1.0)
    C = 2.0 * spread / np.outer(level, level) / np.sqrt(np.outer(count, count))
    return np.linalg.inv(np.linalg.cholesky(C + 1e-9 * np.diag(np.diag(C))))


def fit_curve(problem: Problem, weighting: Weighting = by_degrees_of_freedom) -> CurveFit:
    """Fit the random effects of a problem to the octaves of its record, from its start values.

    Parameters
    ----------
    problem : Problem
        What is fitted.
    weighting : callable
        Weights of the points of the curve under effects.
    """
    first = _weighted(problem, by_degrees_of_freedom(problem.record, problem.effects))
    if weighting is by_degrees_of_freedom:
        return first
    return _weighted(problem.starting(first.effects), weighting(problem.record, first.effects))


def misfit_of_ramp(problem: Problem, effects: Sequence[Effect], weighting: Weighting) -> float:
    """The misfit of the same terms with a ramp in place of the random walk; of its sign a curve says nothing.

    Parameters
    ----------
    problem : Problem
        That was fitted.
    effects : sequence of Effect
        Its fit, a random walk among them.
    weighting : callable
        Weights of the points of the curve under effects.

    Returns
    -------
    float
        Sum of squares of the whitened residuals.
    """
    from scipy.optimize import least_squares

    curve = problem.record.octaves
    rest = tuple(e for e in effects if e.name != WALK)
    left = Problem(problem.record, rest)
    whiten, seen = weighting(problem.record, effects), 2.0 * np.log(curve.deviation)
    shapes = Shapes(lambda effect: effect.allan_variance(curve.tau))
    of_ramp = make(RAMP, R=1.0).allan_variance(curve.tau)

    def residual(point: Array) -> Array:
        total = shapes.total(left.at(point[:-1])) + np.exp(2.0 * point[-1]) * of_ramp
        return np.asarray(whiten @ (np.log(total) - seen))

    largest = float(np.log(curve.deviation[-1]) - 0.5 * np.log(of_ramp[-1]))
    lo, hi = np.array([*left.bounds, (largest - 10.0, largest + 3.0)]).T
    start = np.clip(np.append(left.start(), largest), lo + 1e-6, hi - 1e-6)
    found = least_squares(residual, start, bounds=(lo, hi), x_scale=1.0, diff_step=1e-4)
    return float(2.0 * found.cost)


def _weighted(problem: Problem, whiten: Array) -> CurveFit:
    from scipy.optimize import least_squares
    from scipy.stats import chi2

    curve = problem.record.octaves
    seen = 2.0 * np.log(curve.deviation)
    shapes = Shapes(lambda effect: effect.allan_variance(curve.tau))

    def residual(point: Array) -> Array:
        return np.asarray(whiten @ (np.log(shapes.total(problem.at(point))) - seen))

    lo, hi = np.array(problem.bounds).T
    start = np.clip(problem.start(), lo + 1e-6, hi - 1e-6)
    found = least_squares(residual, start, bounds=(lo, hi), x_scale=1.0, diff_step=1e-4)
    covariance = np.linalg.pinv(found.jac.T @ found.jac, hermitian=True)
    point, misfit = np.asarray(found.x), float(2.0 * found.cost)
    chance = float(chi2.sf(misfit, max(seen.size - point.size, 1)))
    return CurveFit(problem.at(point), point, covariance, misfit, chance)
