"""Profile-likelihood intervals and one-sided limits.

A value belongs to the interval while twice the loss of log-likelihood, the other
parameters fitted anew, stays below the chi-square quantile [1]_: 3.84 for 95 %. A one-sided limit
takes the same quantile and not 2.71: over a few correlation times the likelihood is so skewed
that the smaller one covers less than 95 % (benchmarks/identify_monte_carlo.py).

The chi-square law is that of long records. Where the least known of the parameters that are mixed up with
one another is known to a relative standard deviation b only, the loss at the truth is larger by a factor, as in
Bartlett's correction [2]_: 1.4 on average at b = 0.5 and 1.0 at b = 0.16 in 150 logs each, so that the quantile is
raised by ``1 + 2 min(b, 0.5)^2``.

The root of the loss is nearly a straight line in the logarithm, so that an edge is found by secants.

References
----------
.. [1] D. J. Venzon and S. H. Moolgavkar, A method for computing profile-likelihood-based
   confidence intervals, Applied Statistics 37(1), 1988.
.. [2] D. N. Lawley, A general method for approximating to the distribution of likelihood ratio criteria,
   Biometrika 43(3/4), 1956.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kfgen.core.time_budget import fit_is_over
from kfgen.identify.fit.fit import Fit, Key, Problem, inverse, profile

Array = NDArray[np.float64]

CHI_SQUARE_95 = 3.841458820694124
NORMAL_975 = CHI_SQUARE_95**0.5
"""The same quantile of a normal deviate."""
EDGE_TOLERANCE = 0.01
"""Of that quantile: an edge is found to half a percent of the interval's half width."""
MIXED_SHARE_OF_LARGEST_DEVIATION = 0.1
"""Of the largest relative standard deviation: a parameter known better than that is not mixed up with the rest."""
MAX_SPREAD = 1.0
"""Standard deviation of a logarithm, beyond which the information is taken for none."""
SPREAD_OF_PLACE = 0.05
"""Standard deviation of the logarithm of a place or width, from which its end is looked for."""
_MAX_SECANT_STEPS = 60


def edge(problem: Problem, best: Fit, key: Key, *, direction: int) -> float | None:
    """Where the loss reaches its quantile, going up or down from the best value [SI].

    Returns None where it never does within its reach: the likelihood does not close there.

    Parameters
    ----------
    problem : Problem
        What is fitted.
    best : Fit
        Its maximum.
    key : Key
        Index of the effect, name of its parameter.
    direction : int
        +1 to go up, -1 to go down.
    """
    limit = problem.reach(key)[direction > 0]
    value = float(getattr(best.effects[key[0]], key[1]))
    if not value > 0.0:
        return None
    origin = float(np.log(value))
    inside, r_in, warm = origin, 0.0, best
    outside: float | None = None
    spread, is_known, wanted = _expected(problem, best, key)
    r_out, step = np.inf, max(wanted * spread, 1e-3)
    for _ in range(_MAX_SECANT_STEPS):
        if fit_is_over():  # by the expected information, as far as the likelihood was not followed
            return float(np.exp(origin + direction * wanted * spread)) if is_known else None
        x = (
            inside + direction * step
            if outside is None
            else _secant((inside, r_in), (outside, r_out), wanted)
        )
        clipped = (x - limit) * direction >= 0.0
        x = limit if clipped else x
        fit = profile(problem, warm, key, float(np.exp(x)))
        r = float(np.sqrt(max(2.0 * (best.value - fit.value), 0.0)))
        if abs(r - wanted) < EDGE_TOLERANCE or (outside is not None and abs(outside - inside) < 1e-4):
            return float(np.exp(x))
        if r > wanted:
            outside, r_out = x, r
        elif clipped:
            most = problem.ceiling(key)
            return float(np.exp(most)) if direction > 0 and np.isfinite(most) else None
        else:
            # The next step aims at the quantile, along the slope seen so far.
            step = min(max(1.1 * abs(x - origin) * (wanted / max(r, 0.2) - 1.0), 0.1 * step), 3.0)
            inside, r_in, warm = x, r, fit
    return float(np.exp(inside))


def _expected(problem: Problem, best: Fit, key: Key) -> tuple[float, bool, float]:
    """What is expected of a parameter's logarithm: its standard deviation, whether that is known, the loss's root.

    It is not known of a place, for which no fit searches, nor without information, which a pseudoinverse does not show.
    """
    if key not in best.free:
        return SPREAD_OF_PLACE, False, NORMAL_975
    index = best.free.index(key)
    information = problem.information(best.point)
    spreads = _spreads(information)
    is_known = bool(spreads[index] < MAX_SPREAD and information[index, index] > MAX_SPREAD**-2)
    return float(spreads[index]), is_known, NORMAL_975 * _widened(spreads, index)


def _secant(near: tuple[float, float], far: tuple[float, float], wanted: float) -> float:
    """Where a straight line between two points reaches the quantile; kept off their ends."""
    (a, r_a), (b, r_b) = near, far
    share = (wanted - r_a) / max(r_b - r_a, 1e-12)
    return float(a + min(max(share, 0.05), 0.95) * (b - a))


def _spreads(information: Array) -> Array:
    """Standard deviations of the logarithms from their information, at most `MAX_SPREAD`, shape (k,)."""
    variance = np.diag(inverse(information))
    return np.asarray(np.minimum(np.sqrt(np.maximum(variance, 0.0)), MAX_SPREAD))


def _widened(spreads: Array, index: int) -> float:
    """By how much the root of the quantile is raised for one parameter."""
    least = float(spreads.max())
    if spreads[index] < MIXED_SHARE_OF_LARGEST_DEVIATION * least:
        return 1.0  # nothing that is badly known matters to it
    return float(np.sqrt(1.0 + 2.0 * min(least, 0.5) ** 2))


def interval95(problem: Problem, best: Fit, key: Key) -> tuple[float, float]:
    """The 95 % interval [SI]; an end that the likelihood does not close is 0 or infinity.

    Parameters
    ----------
    problem : Problem
        What is fitted.
    best : Fit
        Its maximum.
    key : Key
        Index of the effect, name of its parameter.
    """
    lo = edge(problem, best, key, direction=-1)
    hi = edge(problem, best, key, direction=+1)
    return (0.0 if lo is None else lo, float("inf") if hi is None else hi)


def upper95(problem: Problem, best: Fit, key: Key) -> float:
    """The one-sided 95 % limit of a size that may be zero [SI].

    Parameters
    ----------
    problem : Problem
        What is fitted.
    best : Fit
        Its maximum.
    key : Key
        Index of the effect, name of its parameter.
    """
    hi = edge(problem, best, key, direction=+1)
    return float("inf") if hi is None else hi


def linear_intervals(fit: Fit) -> dict[Key, tuple[float, float]]:
    """The 95 % intervals [SI] of the coefficients of regressors, from their covariance."""
    found: dict[Key, tuple[float, float]] = {}
    at = 0
    for i, effect in enumerate(fit.effects):
        k = len(effect.coefficients())
        block = fit.likelihood.covariance[at : at + k, at : at + k]
        at += k
        for name, sd in effect.spread(block).items() if k else ():
            value = float(getattr(effect, name))
            found[i, name] = (value - NORMAL_975 * sd, value + NORMAL_975 * sd)
    return found


def intervals95(problem: Problem, best: Fit) -> dict[Key, tuple[float, float]]:
    """The 95 % intervals [SI] of every fitted parameter.

    Parameters
    ----------
    problem : Problem
        What is fitted.
    best : Fit
        Its maximum.
    """
    return {key: interval95(problem, best, key) for key in best.free} | linear_intervals(best)


def stretched(interval: tuple[float, float], value: float, factor: float) -> tuple[float, float]:
    """An interval of a positive number made wider in its logarithm; ends that are open stay so.

    A size that may be zero has no width in its logarithm: above it the distance itself is made wider.

    Parameters
    ----------
    interval : (float, float)
        [SI].
    value : float
        The estimate [SI], in its middle.
    factor : float
        On both distances from the estimate, at least one.

    Returns
    -------
    (float, float)
        An end that is too far away for a number is open.
    """
    lo, hi = interval
    if not (value > 0.0 and factor > 1.0):
        return interval
    if lo <= 0.0:
        return lo, value + factor * (hi - value)
    with np.errstate(over="ignore", under="ignore"):
        ends = value * (np.array([lo, hi]) / value) ** factor
    return float(ends[0]), float(ends[1])
