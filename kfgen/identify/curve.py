"""The Allan curve fitted by the declared effects, a Gauss-Markov term among them.

Least squares on the logarithm of the Allan variance at octaves of averaging time, each point weighted
by its equivalent degrees of freedom: ``ln AVAR`` has the variance ``2 / edf``. Octaves of an overlapping
estimate are nearly independent, so that the curvature of the fit gives its intervals.

References
----------
.. [1] N. El-Sheimy, H. Hou and X. Niu, Analysis and modeling of inertial sensors using Allan variance,
   IEEE Trans. Instrum. Meas. 57(1), 2008, eq. (14) for the weights.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kfgen.effects import Effect
from kfgen.identify.fit import Problem

Array = NDArray[np.float64]


@dataclass(frozen=True)
class CurveFit:
    """Fitted effects, the logarithms of their parameters with covariance, and the weighted misfit."""

    effects: tuple[Effect, ...]
    point: Array
    covariance: Array
    misfit: float


def fit_curve(problem: Problem) -> CurveFit:
    """Fit the random effects of a problem to the octaves of its record, from its start values."""
    from scipy.optimize import least_squares

    curve = problem.record.octaves
    weight = np.sqrt(curve.edf / 2.0)
    seen = 2.0 * np.log(curve.deviation)

    def residual(point: Array) -> Array:
        expected = sum(
            (e.allan_variance(curve.tau) for e in problem.at(point) if not e.driver), np.zeros(seen.size)
        )
        return np.asarray(weight * (np.log(expected) - seen))

    lo, hi = np.array(problem.bounds).T
    start = np.clip(problem.start(), lo + 1e-6, hi - 1e-6)
    found = least_squares(residual, start, bounds=(lo, hi), x_scale=1.0, diff_step=1e-4)
    covariance = np.linalg.pinv(found.jac.T @ found.jac, hermitian=True)
    return CurveFit(problem.at(found.x), np.asarray(found.x), covariance, float(2.0 * found.cost))
