"""Linear terms in white noise: least squares with priors, and how much a term is worth.

References
----------
.. [1] C. R. Rao, Linear Statistical Inference and Its Applications, 2nd ed., 1973, ch. 4.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

COEFFICIENT = float(2.0 * np.log(1e4))
"""Normalisation of the log-uniform prior of a coefficient of either sign, over four decades."""


@dataclass(frozen=True)
class Solved:
    """Coefficients of regressors, their covariance, and the gain of log-likelihood [nats]."""

    theta: Array
    covariance: Array
    gain: float


def solve(z: Array, B: Array, information: Array | None = None) -> Solved:
    """Least squares of unit white noise `z`, shape (n,), on regressors `B`, shape (n, p).

    Parameters
    ----------
    information : ndarray, shape (p,), optional
        Of Gaussian priors about zero; zero where there is none.
    """
    scale = np.linalg.norm(B, axis=0)
    scale[scale == 0.0] = 1.0
    A = B / scale
    J = A.T @ A
    if information is not None:
        J = J + np.diag(information / scale**2)
    inverse = np.linalg.pinv(J, rcond=1e-12, hermitian=True)
    b = A.T @ z
    theta = inverse @ b
    return Solved(theta / scale, inverse / np.outer(scale, scale), 0.5 * float(theta @ b))


def projected(x: Array, nuisance: Array, information: Array | None = None) -> Array:
    """What of columns `x`, shape (n, ...), the nuisance columns, shape (n, q), do not explain."""
    if not nuisance.size:
        return x
    columns = x.reshape(x.shape[0], -1)
    out = [c - nuisance @ solve(c, nuisance, information).theta for c in columns.T]
    return np.asarray(np.array(out).T.reshape(x.shape))


def coefficient_evidence(theta: Array, covariance: Array) -> float:
    """Logarithm of the share of the prior that coefficients keep: each log-uniform in size, of either sign."""
    if not theta.size:
        return 0.0
    spread = np.sqrt(np.diag(covariance))
    _, logdet = np.linalg.slogdet(covariance)
    priors = np.log(COEFFICIENT * np.maximum(np.abs(theta), spread))
    return float(0.5 * theta.size * np.log(2.0 * np.pi) + 0.5 * logdet - priors.sum())


def alike(a: Array, b: Array) -> float:
    """cos^2 of the smallest angle between the spaces of two sets of whitened, projected columns."""
    qa, qb = (np.linalg.qr(x.reshape(x.shape[0], -1))[0] for x in (a, b))
    return float(np.linalg.svd(qa.T @ qb, compute_uv=False)[0] ** 2)
