"""The likelihood of a record: Whittle's, on the sine transform of its first differences.

Differences turn a random walk into white noise and take the constant out. Their type-I
discrete sine transform has, at ``omega_j = pi j / (n + 1)``, independent Gaussian coefficients
of variance ``S(omega_j)``, the spectral density of the differences: exactly so for white
noise with a random walk (their covariance is a tridiagonal Toeplitz matrix, which the sine
transform diagonalises), and with little leakage for a Gauss-Markov term. Then, up to a
constant, ``ln L = -1/2 sum_j (ln S_j + X_j^2 / S_j)``.

Ordinates are gathered in narrow bins (the lowest stand alone), each with the sums of the
products of the record's and of the regressors' coefficients: sufficient statistics, so
that a likelihood costs the same for a minute and for a day. Deterministic effects enter
as regressors, whose coefficients are solved for by generalised least squares.

References
----------
.. [1] P. Whittle, The analysis of multiple stationary time series, J. R. Stat. Soc. B 15, 1953.
.. [2] G. Strang, The discrete cosine transform, SIAM Review 41(1), 1999 (sine transform, sec. 4).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kfgen.effects import Effect

Array = NDArray[np.float64]

SINGLE = 96
PER_DECADE = 48


@dataclass(frozen=True)
class Ordinates:
    """The binned statistics of one evenly sampled stretch.

    Parameters
    ----------
    omega : ndarray, shape (m,)
        Mean angular frequency of each bin [rad per block].
    count : ndarray, shape (m,)
        Ordinates in it.
    gram : ndarray, shape (m, 1 + r, 1 + r)
        Sums of products of the coefficients of the record (first) and of r regressors.
    dt : float
        Sampling period before averaging [s].
    block : int
        Samples averaged to one.
    """

    omega: Array
    count: Array
    gram: Array
    dt: float
    block: int

    @property
    def n(self) -> int:
        """Number of ordinates."""
        return int(self.count.sum())

    @property
    def frequency(self) -> Array:
        """Frequency of the bins [Hz]."""
        return self.omega / (2.0 * np.pi * self.dt * self.block)


def block_means(y: Array, block: int) -> Array:
    """Means of successive blocks along the first axis; an incomplete last block is left out."""
    n = y.shape[0] // block
    return np.asarray(y[: n * block].reshape(n, block, *y.shape[1:]).mean(axis=1))


def transform(columns: Array, block: int) -> Array:
    """Sine coefficients of the differences of block means, shape (n - 1, k), of columns (n, k)."""
    from scipy.fft import dst

    return np.asarray(dst(np.diff(block_means(columns, block), axis=0), type=1, axis=0, norm="ortho"))


def ordinates(
    y: Array,
    dt: float,
    block: int = 1,
    regressors: Sequence[Array] = (),
    *,
    skip: Sequence[tuple[float, float]] = (),
) -> Ordinates:
    """Sine-transform a record and its regressors.

    Parameters
    ----------
    y : ndarray, shape (n,)
        Samples.
    dt : float
        Sampling period [s].
    block : int
        Samples averaged to one first.
    regressors : sequence of ndarray, shape (n,)
        Outputs of deterministic effects for a coefficient of one.
    skip : sequence of (lo, hi)
        Bands [Hz] to leave out.
    """
    X = transform(np.column_stack([y, *regressors]), block)
    n = X.shape[0]
    j = np.arange(1, n + 1, dtype=float)
    omega = j * (np.pi / (n + 1))
    f = omega / (2.0 * np.pi * dt * block)
    keep = np.ones(n)
    for lo, hi in skip:
        keep[(f >= lo) & (f <= hi)] = 0.0
    edges = _edges(n)
    products = X[:, :, None] * X[:, None, :] * keep[:, None, None]
    gram = np.add.reduceat(products, edges[:-1], axis=0)
    count = np.add.reduceat(keep, edges[:-1])
    centre = np.add.reduceat(omega, edges[:-1]) / np.diff(edges)
    some = count > 0.0
    return Ordinates(centre[some], count[some], gram[some], dt, block)


def _edges(n: int) -> NDArray[np.int64]:
    if n <= SINGLE:
        return np.arange(n + 1)
    top = np.geomspace(SINGLE, n, max(2, int(np.log10(n / SINGLE) * PER_DECADE) + 1))
    return np.unique(np.concatenate([np.arange(SINGLE), np.round(top)]).astype(np.int64))


def density_of_differences(effects: Sequence[Effect], omega: Array, dt: float, block: int) -> Array:
    """``S``: spectral density [U^2] of the first differences of block averages, shape (m,)."""
    total = sum((e.sampled_density(omega, dt, block) for e in effects), np.zeros(omega.size))
    return np.asarray(4.0 * np.sin(0.5 * omega) ** 2 * total)


@dataclass(frozen=True)
class Fitted:
    """A log-likelihood with the regressors' coefficients and their covariance."""

    value: float
    coefficients: Array
    covariance: Array


def log_likelihood(data: Ordinates, effects: Sequence[Effect], coefficients: Array | None = None) -> Fitted:
    """``ln L`` of the record under the random `effects`.

    Parameters
    ----------
    data : Ordinates
    effects : sequence of Effect
        Deterministic ones contribute nothing here: they are the regressors.
    coefficients : ndarray, shape (r,), optional
        Of the regressors; solved for when left out.
    """
    S = density_of_differences(effects, data.omega, data.dt, data.block)
    S = np.maximum(S, np.finfo(float).tiny)
    weighted = np.einsum("m,mij->ij", 1.0 / S, data.gram)
    xx, xb, bb = weighted[0, 0], weighted[0, 1:], weighted[1:, 1:]
    covariance = np.linalg.pinv(bb, hermitian=True) if bb.size else bb
    theta = covariance @ xb if coefficients is None else coefficients
    quadratic = xx - 2.0 * theta @ xb + theta @ bb @ theta
    return Fitted(-0.5 * float(data.count @ np.log(S) + quadratic), theta, covariance)


def residual_power(data: Ordinates, coefficients: Array) -> Array:
    """Power of the record less its regressors, summed in each bin [U^2], shape (m,)."""
    c = np.concatenate([[1.0], -coefficients])
    return np.asarray(np.einsum("i,mij,j->m", c, data.gram, c))


def residual_ratio(data: Ordinates, effects: Sequence[Effect], coefficients: Array) -> Array:
    """Power of the residual over its expectation, per bin, shape (m,): one where the model holds."""
    S = density_of_differences(effects, data.omega, data.dt, data.block)
    return residual_power(data, coefficients) / (data.count * S)


def sensitivity(data: Ordinates, effects: Sequence[Effect], coefficients: Array) -> Array:
    """Derivative of ``ln L`` with respect to the density in each bin [1/U^2], shape (m,)."""
    S = np.maximum(density_of_differences(effects, data.omega, data.dt, data.block), np.finfo(float).tiny)
    return np.asarray(0.5 * (residual_power(data, coefficients) / S - data.count) / S)
