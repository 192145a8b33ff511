"""What averaging to blocks takes out of a record, as a likelihood of its own, and sums of likelihoods.

A long record is averaged to blocks before it is fitted. `BlockDifferences` holds the variances of the differences
inside the blocks, which are independent of the means; `IndependentLikelihoods` adds the two.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from kfgen.effects import Effect
from kfgen.identify.evidence.likelihood import Likelihood
from kfgen.identify.evidence.shapes import Key, Shapes
from kfgen.identify.evidence.whittle import SpectralFit

Array = NDArray[np.float64]


@dataclass(frozen=True)
class BlockDifferences:
    """Differences of adjoining means of ``2^i`` samples inside blocks, as if independent.

    Half their mean square is the Allan variance there. So they are for white noise, which rules at such
    short times; there they hold exactly the information that block means lack.

    Parameters
    ----------
    tau : ndarray, shape (k,)
        Averaging times [s].
    count : ndarray, shape (k,)
        Differences.
    variance : ndarray, shape (k,)
        Half their mean square [U^2].
    """

    tau: Array
    count: Array
    variance: Array

    @cached_property
    def _shapes(self) -> Shapes:
        return Shapes(lambda e: e.allan_variance(self.tau))

    def log_likelihood(self, effects: Sequence[Effect], coefficients: Array | None = None) -> SpectralFit:
        """``ln L``; deterministic effects are too slow to be seen inside a block.

        See `kfgen.identify.evidence.record.Likelihood`.
        """
        a = self._shapes.total(effects)
        value = float(-0.5 * self.count @ (np.log(a) + self.variance / a))
        return SpectralFit(value, np.zeros(0), np.zeros((0, 0)))

    def slope(self, effects: Sequence[Effect], keys: Sequence[Key]) -> Array:
        """Derivative in the logarithms of the keys' parameters.

        See `kfgen.identify.evidence.record.Likelihood`.
        """
        a = self._shapes.total(effects)
        return self._shapes.slopes(effects, keys) @ (0.5 * self.count * (self.variance / a - 1.0) / a)

    def information(self, effects: Sequence[Effect], keys: Sequence[Key]) -> Array:
        """Fisher information of the same, shape (k, k). See `kfgen.identify.evidence.record.Likelihood`."""
        relative = self._shapes.slopes(effects, keys) / self._shapes.total(effects)
        return np.asarray(0.5 * (relative * self.count) @ relative.T)


@dataclass(frozen=True)
class IndependentLikelihoods:
    """The sum of likelihoods of independent data; the first has the regressors.

    Parameters
    ----------
    terms : tuple of Likelihood
    """

    terms: tuple[Likelihood, ...]

    def log_likelihood(self, effects: Sequence[Effect], coefficients: Array | None = None) -> SpectralFit:
        """The sum. See `kfgen.identify.evidence.record.Likelihood`."""
        first = self.terms[0].log_likelihood(effects, coefficients)
        rest = sum(p.log_likelihood(effects).value for p in self.terms[1:])
        return replace(first, value=first.value + rest)

    def slope(self, effects: Sequence[Effect], keys: Sequence[Key]) -> Array:
        """The sum of derivatives. See `kfgen.identify.evidence.record.Likelihood`."""
        return np.asarray(np.sum([p.slope(effects, keys) for p in self.terms], axis=0))

    def information(self, effects: Sequence[Effect], keys: Sequence[Key]) -> Array:
        """The sum of information. See `kfgen.identify.evidence.record.Likelihood`."""
        return np.asarray(np.sum([p.information(effects, keys) for p in self.terms], axis=0))


def differences_inside(
    y: Array, full: NDArray[np.int64], levels: int, blind: int, dt: float
) -> BlockDifferences:
    """The differences inside full blocks.

    Parameters
    ----------
    y : ndarray, shape (n,)
        Samples.
    full : ndarray of int
        First samples of the blocks.
    levels : int
        A block has two to its power samples.
    blind : int
        Levels whose differences, the shortest, are left out.
    dt : float
        Sampling period [s].
    """
    means = y[full[:, None] + np.arange(2**levels)]
    count, variance = np.zeros(levels), np.ones(levels)
    for i in range(levels if full.size else 0):
        halves = means.reshape(full.size, -1, 2)
        d = halves[:, :, 1] - halves[:, :, 0]
        if i >= blind and d.size:
            count[i], variance[i] = d.size, 0.5 * float(np.mean(d**2))
        means = halves.mean(axis=2)
    return BlockDifferences(np.asarray(dt * 2.0 ** np.arange(levels), dtype=np.float64), count, variance)
