"""The likelihood of a record: Whittle's, on the sine transform of its first differences.

Differences turn a random walk into white noise and take the constant out. Their type-I
discrete sine transform has, at ``omega_j = pi j / (n + 1)``, independent Gaussian coefficients
of variance ``S(omega_j)``, the spectral density of the differences: exactly so for white
noise with a random walk (their covariance is a tridiagonal Toeplitz matrix, which the sine
transform diagonalises), and with little leakage for a Gauss-Markov term. Then, up to a
constant, ``ln L = -1/2 sum_j (ln S_j + X_j^2 / S_j)``.

Ordinates are gathered in narrow bins (the lowest stand alone), each with the sums of the products of the record's and of
the regressors' coefficients: sufficient statistics, so that a likelihood costs the same for a minute and for a day.
Deterministic effects enter as regressors, whose coefficients are solved for by generalised least squares.

References
----------
.. [1] P. Whittle, The analysis of multiple stationary time series, J. R. Stat. Soc. B 15, 1953.
.. [2] G. Strang, The discrete cosine transform, SIAM Review 41(1), 1999 (sine transform, sec. 4).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from kfgen.core.recent_results import RecentResults
from kfgen.effects import Effect, filtered, sampled_spectrum
from kfgen.effects.samples.filtered_spectrum import is_passed
from kfgen.identify.evidence.peaks import SpectralPeak, split_edges
from kfgen.identify.evidence.shapes import RECENT, Key, Shapes

Array = NDArray[np.float64]

SINGLE_ORDINATES = 96
"""Ordinates at the bottom that stand alone, without a bin."""
BINS_PER_DECADE = 48
"""Bins of ordinates above those that stand alone."""


@dataclass(frozen=True)
class SpectralFit:
    """A log-likelihood with the regressors' coefficients and their covariance."""

    value: float
    coefficients: Array
    covariance: Array


@dataclass(frozen=True)
class Ordinates:
    """The binned statistics of one or more evenly sampled stretches.

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

    @cached_property
    def _shapes(self) -> Shapes:
        def plain(effect: Effect) -> Array:
            S = effect.sampled_density(self.omega, self.dt, self.block)
            return np.asarray(4.0 * np.sin(0.5 * self.omega) ** 2 * S)

        return Shapes(plain, lambda es: filtered(es, self.omega, self.dt, self.block, self.n))

    def sharing(self, other: Ordinates) -> Ordinates:
        """The same, which asks another one for densities; its own where the bins of that one are others.

        Parameters
        ----------
        other : Ordinates
            Of the same record, beside other regressors.
        """
        same = self.omega.size == other.omega.size and bool(np.all(self.omega == other.omega))
        if same and (self.dt, self.block, self.n) == (other.dt, other.block, other.n):
            self.__dict__["_shapes"] = other._shapes
        return self

    def part(self, effect: Effect) -> Array:
        """Density [U^2] of the differences of one effect, shape (m,)."""
        return self._shapes.of(effect)

    def density(self, effects: Sequence[Effect]) -> Array:
        """``S`` [U^2] of the differences under the random effects, shape (m,): where a filter stops, as it is."""
        return self._recent_densities.recalled(tuple(effects), lambda: self._density(effects))

    @cached_property
    def _recent_densities(self) -> RecentResults[Array]:
        """A fit asks for the value, the slope and the information at one point."""
        return RecentResults(RECENT)

    def _density(self, effects: Sequence[Effect]) -> Array:
        S, seen = self._shapes.total(effects), self._seen(effects)
        return S if np.all(seen) else np.where(seen, S, self.gram[:, 0, 0] / self.count)

    def _seen(self, effects: Sequence[Effect]) -> NDArray[np.bool_]:
        """Where the filters among the effects do not stop, shape (m,)."""
        filters = tuple(e for e in effects if e.is_filter)
        return self._recently_seen.recalled(
            filters, lambda: is_passed(filters, self.omega, self.dt, self.block, self.n)
        )

    @cached_property
    def _recently_seen(self) -> RecentResults[NDArray[np.bool_]]:
        return RecentResults(RECENT)

    def weight(self, effects: Sequence[Effect]) -> Array:
        """``1 / S`` [1/U^2], shape (m,): zero where a filter stops, so that nothing is fitted to what it leaves there."""
        return np.asarray(self._seen(effects) / self.density(effects))

    def log_likelihood(self, effects: Sequence[Effect], coefficients: Array | None = None) -> SpectralFit:
        """``ln L`` of the record under the random `effects`; deterministic ones are the regressors.

        See `kfgen.identify.evidence.record.Likelihood`.
        """
        S, weight = self.density(effects), self.weight(effects)
        theta, covariance, quadratic = least_squares(self._weighted(weight), coefficients)
        stopped = float(self.count @ (weight == 0.0))  # a misfit of one each
        return SpectralFit(-0.5 * (float(self.count @ np.log(S) + quadratic) + stopped), theta, covariance)

    def _weighted(self, weight: Array) -> Array:
        """Products of the record and the regressors times a weight, summed, shape (1 + r, 1 + r)."""
        k = self.gram.shape[1]
        return np.asarray(weight @ self.gram.reshape(-1, k * k)).reshape(k, k)

    def slope(self, effects: Sequence[Effect], keys: Sequence[Key]) -> Array:
        """Derivative of ``ln L`` in logarithms, the coefficients at their best. See `Likelihood`."""
        weight = self.weight(effects)
        theta = least_squares(self._weighted(weight))[0]
        sensitivity = 0.5 * (residual_power(self, theta) * weight - self.count) * weight
        return self._shapes.slopes(effects, keys) @ sensitivity

    def information(self, effects: Sequence[Effect], keys: Sequence[Key]) -> Array:
        """Fisher information of the same logarithms, shape (k, k).

        See `kfgen.identify.evidence.record.Likelihood`.
        """
        relative = self.relative_slopes(effects, keys)
        return np.asarray(0.5 * (relative * self.count) @ relative.T)

    def relative_slopes(self, effects: Sequence[Effect], keys: Sequence[Key]) -> Array:
        """Derivative of ``ln S`` in logarithms of parameters, shape (k, m); see `information`."""
        return self._shapes.slopes(effects, keys) * self.weight(effects)


def least_squares(weighted: Array, coefficients: Array | None = None) -> tuple[Array, Array, float]:
    """Generalised least squares from weighted products ``[x b]' [x b]``: coefficients, covariance, misfit.

    Parameters
    ----------
    weighted : ndarray, shape (1 + r, 1 + r)
        Products of the record (first) and of r regressors, over the density.
    coefficients : ndarray, shape (r,), optional
        Of the regressors; solved for when left out.

    Returns
    -------
    coefficients : ndarray, shape (r,)
    covariance : ndarray, shape (r, r)
    misfit : float
    """
    xx, xb, bb = weighted[0, 0], weighted[0, 1:], weighted[1:, 1:]
    if not bb.size:
        return xb, bb, float(xx)
    covariance = _pseudo_inverse(bb)
    theta = covariance @ xb if coefficients is None else coefficients
    return theta, covariance, float(xx - 2.0 * theta @ xb + theta @ bb @ theta)


def _pseudo_inverse(bb: Array) -> Array:
    """Of a symmetric matrix that is not negative: a third of the time that ``numpy.linalg.pinv`` takes for small ones."""
    values, V = np.linalg.eigh(bb)
    some = values > values[-1] * values.size * np.finfo(float).eps
    V = V[:, some]
    return np.asarray((V / values[some]) @ V.T)


def block_means(y: Array, block: int) -> Array:
    """Means of successive blocks along the first axis; an incomplete last block is left out.

    Parameters
    ----------
    y : ndarray, shape (n, ...)
        Samples.
    block : int
        Samples in a block.

    Returns
    -------
    ndarray, shape (n // block, ...)
    """
    n = y.shape[0] // block
    return np.asarray(y[: n * block].reshape(n, block, *y.shape[1:]).mean(axis=1)) if block > 1 else y


def transform(means: Array) -> Array:
    """Sine coefficients of the differences, shape (n - 1, ...), of values (n, ...)."""
    from scipy.fft import dst

    return np.asarray(dst(np.diff(means, axis=0), type=1, axis=0, norm="ortho", overwrite_x=True))


def coarse_transform(edges: Array, size: int) -> Array:
    """The low sine coefficients of a smooth function from its values at the edges of equal cells.

    A sum of differences over a cell is the difference at its edges, and a slow sine is what it is in
    the cell's middle: a sine transform of the second type, exact to second order in cells a period.

    Parameters
    ----------
    edges : ndarray, shape (c + 1,)
    size : int
        Coefficients of the whole record; at most the lower quarter of the cells is given.
    """
    from scipy.fft import dst

    low = min(size, max((edges.size - 1) // 4, 1))
    return np.asarray(dst(np.diff(edges), type=2)[:low] * np.sqrt(0.5 / (size + 1)))


def frequencies(n: int) -> Array:
    """Of n sine coefficients [rad per block], shape (n,)."""
    return np.arange(1, n + 1, dtype=float) * (np.pi / (n + 1))


def ordinates(
    columns: Sequence[Array],
    dt: float,
    block: int = 1,
    *,
    skip: Sequence[tuple[float, float]] = (),
    per_decade: int = BINS_PER_DECADE,
    peaks: Sequence[SpectralPeak] = (),
) -> Ordinates:
    """Bin the sine coefficients of a record and its regressors.

    Parameters
    ----------
    columns : sequence of ndarray
        Coefficients, see `transform`, of the record first, shape (n,); then of regressors, of which only the
        low ones need to be there.
    dt : float
        Sampling period [s].
    block : int
        Samples that were averaged to one.
    skip : sequence of (lo, hi)
        Bands [Hz] to leave out.
    per_decade : int
        Bins above the lowest ordinates, which stand alone.
    peaks : sequence of SpectralPeak
        Narrow peaks of the densities that will be compared with it: bins about them are finer.
    """
    n = columns[0].size
    edges = split_edges(_edges(n, per_decade), peaks, dt * block, n)
    to_omega = 2.0 * np.pi * dt * block
    keep = np.ones(n)
    for lo, hi in skip:
        first, last = (hz * to_omega * (n + 1) / np.pi - 1.0 for hz in (lo, hi))
        keep[max(int(np.ceil(first)), 0) : int(min(np.floor(last) + 1.0, n))] = 0.0
    gram = np.zeros((edges.size - 1, len(columns), len(columns)))
    for a, x in enumerate([x * keep[: x.size] for x in columns] if skip else columns):
        for b, z in enumerate(columns[: a + 1]):
            low = min(x.size, z.size)
            at = edges[:-1][edges[:-1] < low]
            gram[: at.size, a, b] = gram[: at.size, b, a] = np.add.reduceat(x[:low] * z[:low], at)
    count = np.add.reduceat(keep, edges[:-1])
    centre = np.asarray(0.5 * (edges[:-1] + edges[1:] + 1.0) * (np.pi / (n + 1)), dtype=np.float64)
    some = count > 0.0
    return Ordinates(centre[some], count[some], gram[some], dt, block)


def _edges(n: int, per_decade: int) -> NDArray[np.int64]:
    if n <= SINGLE_ORDINATES:
        return np.arange(n + 1)
    top = np.geomspace(SINGLE_ORDINATES, n, max(2, int(np.log10(n / SINGLE_ORDINATES) * per_decade) + 1))
    return np.unique(np.concatenate([np.arange(SINGLE_ORDINATES), np.round(top)]).astype(np.int64))


def density_of_differences(effects: Sequence[Effect], omega: Array, dt: float, block: int) -> Array:
    """``S``: spectral density [U^2] of the first differences of block averages, shape (m,).

    Parameters
    ----------
    effects : sequence of Effect
        With their values [SI].
    omega : ndarray, shape (m,)
        Angular frequency [rad per block].
    dt : float
        Sampling period [s].
    block : int
        Samples averaged to one.
    """
    return np.asarray(4.0 * np.sin(0.5 * omega) ** 2 * sampled_spectrum(effects, omega, dt, block))


def residual_power(data: Ordinates, coefficients: Array) -> Array:
    """Power of the record less its regressors, summed in each bin [U^2], shape (m,).

    Parameters
    ----------
    data : Ordinates
        Of the record and its regressors.
    coefficients : ndarray, shape (r,)
        Of the regressors.
    """
    c = np.concatenate([[1.0], -coefficients])
    return np.asarray((data.gram @ c) @ c)


def residual_ratio(data: Ordinates, effects: Sequence[Effect], coefficients: Array) -> Array:
    """Power of the residual over its expectation, per bin, shape (m,): one where the model holds.

    Parameters
    ----------
    data, coefficients
        As of `residual_power`.
    effects : sequence of Effect
        With their values [SI].
    """
    return residual_power(data, coefficients) / (data.count * data.density(effects))
