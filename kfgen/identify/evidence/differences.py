"""Sums of squared second differences: by numpy, or compiled where numba is installed and the record is long.

Both take a block of phase that stays in the cache, and all steps at once. They agree to rounding: sums are
taken in another order.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Steps = NDArray[np.int64]

MIN_SAMPLES_FOR_COMPILED = 10_000_000
"""Samples of one channel from which the compiled kernel is taken: it saves a quarter of a second there, and
costs a process 0.4 s once, so that it pays from the second channel on."""
BUFFER_DIFFERENCES = 1 << 15
"""Differences at a time: two buffers of them and the phase stay in a cache of one megabyte."""
DOT_PRODUCT_LENGTH = 1 << 13
"""Length of a dot product that no library splits over threads."""


class Kernel(Protocol):
    """The two loops over samples."""

    def accumulate(self, y: Array, rate: float) -> None:
        """Replace `y`, shape (n,) [U], by the running sum of ``y - rate``.

        Parameters
        ----------
        y : ndarray, shape (n,)
            Samples [U]; overwritten.
        rate : float
            What is subtracted from each of them [U].
        """

    def squares(self, x: Array, done: int, steps: Steps) -> Array:
        """Sums of ``(x[i + 2 m] - 2 x[i + m] + x[i])^2`` over every ``i + 2 m >= done``.

        Parameters
        ----------
        x : ndarray, shape (n,)
            Phase [U samples].
        done : int
            Points up to which the differences were taken before.
        steps : ndarray of int, shape (k,)
            The steps m.
        """


def kernel(n: float) -> Kernel:
    """The kernel for a record of `n` samples; the compiled one is left out where numba is missing."""
    if n >= MIN_SAMPLES_FOR_COMPILED:
        try:
            from kfgen.identify.evidence.compiled import CompiledKernel
        except ImportError:
            return NumpyKernel()
        return CompiledKernel()
    return NumpyKernel()


class NumpyKernel:
    """Vector operations on buffers that are kept: new ones would cost more than the arithmetic."""

    def __init__(self) -> None:
        self._first = np.empty(2 * BUFFER_DIFFERENCES)
        self._second = np.empty(BUFFER_DIFFERENCES)

    def accumulate(self, y: Array, rate: float) -> None:
        """See `Kernel`."""
        y -= rate
        np.cumsum(y, out=y)

    def squares(self, x: Array, done: int, steps: Steps) -> Array:
        """See `Kernel`."""
        return np.array([self._sum(x[max(0, done - 2 * m) :], m) for m in steps.tolist()])

    def _sum(self, x: Array, m: int) -> float:
        total = 0.0
        for start in range(0, x.size - 2 * m, BUFFER_DIFFERENCES):
            part = x[start : start + BUFFER_DIFFERENCES + 2 * m]
            d = self._second[: part.size - 2 * m]
            if m <= BUFFER_DIFFERENCES:
                first = np.subtract(part[m:], part[:-m], out=self._first[: part.size - m])
                np.subtract(first[m:], first[:-m], out=d)
            else:
                np.subtract(part[2 * m :], part[m:-m], out=d)
                d -= part[m:-m]
                d += part[: -2 * m]
            total += sum(
                float(e @ e)
                for e in (d[k : k + DOT_PRODUCT_LENGTH] for k in range(0, d.size, DOT_PRODUCT_LENGTH))
            )
        return total
