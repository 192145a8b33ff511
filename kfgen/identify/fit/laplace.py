"""The evidence of a fitted model by Laplace's method in logarithms, no parameter spread wider than its prior.

References
----------
.. [1] D. J. C. MacKay, Information Theory, Inference, and Learning Algorithms, 2003, ch. 27-28.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kfgen.effects.series import DECADES
from kfgen.identify.fit.fit import Fit, Key, Problem, curvature

Array = NDArray[np.float64]


def log_evidence(problem: Problem, fit: Fit, H: Array | None = None) -> float:
    """The logarithm of the marginal likelihood, up to a constant of the record [nats].

    Parameters
    ----------
    problem, fit
        And its maximum.
    H : ndarray, shape (k, k), optional
        The `curvature` there, where it is known.
    """
    value = fit.likelihood.value
    k = fit.point.size
    for key, x in zip(fit.free, fit.point.tolist()):
        prior = problem.priors.get(key)
        if prior is not None:
            value += prior.log_density(x) - float(np.log(prior.deviation * np.sqrt(2 * np.pi)))
        else:
            value -= float(np.log(_width(problem, key)))
    if k:
        floor = 2.0 * np.pi / np.array([_volume(problem, key) for key in fit.free]) ** 2
        H = curvature(problem, fit.point) if H is None else H
        scaled = H / np.sqrt(np.outer(floor, floor))
        eigenvalues = np.maximum(np.linalg.eigvalsh(0.5 * (scaled + scaled.T)), 1.0)
        value += 0.5 * k * float(np.log(2 * np.pi)) - 0.5 * float(np.log(eigenvalues).sum())
        value -= 0.5 * float(np.log(floor).sum())
    return value + _linear_evidence(fit)


def _width(problem: Problem, key: Key) -> float:
    """Width of the log-uniform prior of a free parameter."""
    lo, hi = problem.bounds[problem.free.index(key)]
    kinds = {p.name: p.kind for p in problem.effects[key[0]].parameters()}
    return DECADES if kinds[key[1]] == "size" else hi - lo


def _volume(problem: Problem, key: Key) -> float:
    """The most that a parameter's likelihood can spread: its prior's width."""
    prior = problem.priors.get(key)
    return prior.deviation * float(np.sqrt(2 * np.pi)) if prior is not None else _width(problem, key)


def _linear_evidence(fit: Fit) -> float:
    theta, covariance = fit.likelihood.coefficients, fit.likelihood.covariance
    if not theta.size:
        return 0.0
    _, logdet = np.linalg.slogdet(covariance)
    value, at = 0.5 * theta.size * float(np.log(2 * np.pi)) + 0.5 * float(logdet), 0
    for effect in fit.effects:
        k = len(effect.coefficients())
        if k:
            value += effect.log_prior(covariance[at : at + k, at : at + k])
            at += k
    return value
