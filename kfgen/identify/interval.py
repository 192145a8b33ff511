"""Profile-likelihood intervals and one-sided limits.

A value belongs to the interval while twice the loss of log-likelihood, the other
parameters fitted anew, stays below the chi-square quantile [1]_: 3.84 for 95 %. A one-sided limit
takes the same quantile and not 2.71: over a few correlation times the likelihood is so skewed
that the smaller one covers less than 95 % (benchmarks/identify_monte_carlo.py).

References
----------
.. [1] D. J. Venzon and S. H. Moolgavkar, A method for computing profile-likelihood-based
   confidence intervals, Applied Statistics 37(1), 1988.
"""

from __future__ import annotations

import numpy as np

from kfgen.identify.fit import Fit, Key, Problem, is_linear, profile

QUANTILE = 3.841458820694124
NORMAL = QUANTILE**0.5
"""The same quantile of a normal deviate."""
_STEPS = 40


def loss(problem: Problem, best: Fit, key: Key, log_value: float) -> float:
    """Twice the loss of log-likelihood with the parameter at ``exp(log_value)``."""
    return 2.0 * (best.value - profile(problem, best, key, float(np.exp(log_value))).value)


def edge(problem: Problem, best: Fit, key: Key, *, direction: int) -> float | None:
    """Where the loss reaches `QUANTILE`, going up or down from the best value [SI].

    Returns None where it never does inside the box: the likelihood does not close there.
    """
    from scipy.optimize import brentq

    index = best.free.index(key)
    lo, hi = problem.bounds[index]
    inside, limit = float(best.point[index]), hi if direction > 0 else lo
    step = 0.02 * direction
    for _ in range(_STEPS):
        outside = inside + step
        if (outside - limit) * direction > 0:
            return None
        if loss(problem, best, key, outside) > QUANTILE:
            root = brentq(lambda x: loss(problem, best, key, x) - QUANTILE, inside, outside, xtol=1e-3)
            return float(np.exp(root))
        inside, step = outside, step * 1.6
    return None


def interval95(problem: Problem, best: Fit, key: Key) -> tuple[float, float]:
    """The 95 % interval [SI]; an end that the likelihood does not close is 0 or infinity."""
    lo = edge(problem, best, key, direction=-1)
    hi = edge(problem, best, key, direction=+1)
    return (0.0 if lo is None else lo, float("inf") if hi is None else hi)


def upper95(problem: Problem, best: Fit, key: Key) -> float:
    """The one-sided 95 % limit of a size that may be zero [SI]."""
    hi = edge(problem, best, key, direction=+1)
    return float("inf") if hi is None else hi


def linear_intervals(fit: Fit) -> dict[Key, tuple[float, float]]:
    """The 95 % intervals [SI] of the coefficients of regressors, from their covariance."""
    keys = [(i, e.estimated()[0].name) for i, e in enumerate(fit.effects) if is_linear(e)]
    theta, variance = fit.likelihood.coefficients, np.diag(fit.likelihood.covariance) if keys else np.zeros(0)
    spread = NORMAL * np.sqrt(np.maximum(variance, 0.0))
    return dict(zip(keys, zip((theta - spread).tolist(), (theta + spread).tolist())))


def intervals95(problem: Problem, best: Fit) -> dict[Key, tuple[float, float]]:
    """The 95 % intervals [SI] of every fitted parameter."""
    return {key: interval95(problem, best, key) for key in best.free} | linear_intervals(best)
