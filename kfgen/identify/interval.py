"""Profile-likelihood intervals and one-sided limits.

A value belongs to the interval while twice the loss of log-likelihood, the other
parameters fitted anew, stays below the chi-square quantile [1]_: 3.84 for 95 %. A one-sided limit
takes the same quantile and not 2.71: over a few correlation times the likelihood is so skewed
that the smaller one covers less than 95 % (benchmarks/identify_monte_carlo.py).

The root of the loss is nearly a straight line in the logarithm, so that an edge is found by secants.

References
----------
.. [1] D. J. Venzon and S. H. Moolgavkar, A method for computing profile-likelihood-based
   confidence intervals, Applied Statistics 37(1), 1988.
"""

from __future__ import annotations

import numpy as np

from kfgen.identify.fit import Fit, Key, Problem, profile

QUANTILE = 3.841458820694124
NORMAL = QUANTILE**0.5
"""The same quantile of a normal deviate."""
NEAR = 0.01
"""Of that quantile: an edge is found to half a percent of the interval's half width."""
_STEPS = 60


def edge(problem: Problem, best: Fit, key: Key, *, direction: int) -> float | None:
    """Where the loss reaches `QUANTILE`, going up or down from the best value [SI].

    Returns None where it never does inside the box: the likelihood does not close there.
    """
    index = best.free.index(key)
    limit = problem.bounds[index][direction > 0]
    origin = float(best.point[index])
    inside, r_in, warm = origin, 0.0, best
    outside: float | None = None
    r_out, step = np.inf, max(NORMAL * _spread(problem, best, index), 1e-3)
    for _ in range(_STEPS):
        x = inside + direction * step if outside is None else _secant(inside, r_in, outside, r_out)
        clipped = (x - limit) * direction >= 0.0
        x = limit if clipped else x
        fit = profile(problem, warm, key, float(np.exp(x)))
        r = float(np.sqrt(max(2.0 * (best.value - fit.value), 0.0)))
        if abs(r - NORMAL) < NEAR or (outside is not None and abs(outside - inside) < 1e-4):
            return float(np.exp(x))
        if r > NORMAL:
            outside, r_out = x, r
        elif clipped:
            return None
        else:
            # The next step aims at the quantile, along the slope seen so far.
            step = min(max(1.1 * abs(x - origin) * (NORMAL / max(r, 0.2) - 1.0), 0.1 * step), 3.0)
            inside, r_in, warm = x, r, fit
    return float(np.exp(inside))


def _secant(a: float, r_a: float, b: float, r_b: float) -> float:
    """Where a straight line between two points reaches the quantile; kept off their ends."""
    share = (NORMAL - r_a) / max(r_b - r_a, 1e-12)
    return float(a + min(max(share, 0.05), 0.95) * (b - a))


def _spread(problem: Problem, best: Fit, index: int) -> float:
    """A first guess of the deviation of a logarithm, from the expected information."""
    J = problem.information(best.point)
    scale = np.sqrt(np.maximum(np.diag(J), 1e-8))
    variance = np.linalg.pinv(J / np.outer(scale, scale), rcond=1e-10, hermitian=True)[index, index]
    return float(min(np.sqrt(max(variance, 0.0)) / scale[index], 1.0))


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
    keys = [(i, name) for i, e in enumerate(fit.effects) for name in e.coefficients()]
    theta, variance = fit.likelihood.coefficients, np.diag(fit.likelihood.covariance) if keys else np.zeros(0)
    spread = NORMAL * np.sqrt(np.maximum(variance, 0.0))
    return dict(zip(keys, zip((theta - spread).tolist(), (theta + spread).tolist())))


def intervals95(problem: Problem, best: Fit) -> dict[Key, tuple[float, float]]:
    """The 95 % intervals [SI] of every fitted parameter."""
    return {key: interval95(problem, best, key) for key in best.free} | linear_intervals(best)
