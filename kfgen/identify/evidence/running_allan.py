"""The overlapping Allan variance of samples that come one piece after the other: `Phase`.

One pass, linear time, bounded memory; "phase" is the running sum of the samples, of which the Allan variance is the
mean square of second differences.

A cascade of levels. The first takes the samples; each next one takes the averages of pairs from the one before
it, so that level s sees every ``2^s``-th point of the phase. A level keeps as much of the phase as its longest
difference spans, adds up squares, and forgets the rest.

Rounding
--------
Second differences do not see a constant or a line in the phase. So each block is summed up about its own mean and from
zero, and the phase that is kept from before is turned into the same frame: it grows with the noise and the drift within
a block and a span, not with the length of the record, and an offset of the samples costs no more digits than
their own rounding has cost them. What is handed on is an average minus the first mean that the level has seen.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kfgen.core.errors import InputError
from kfgen.identify.evidence.differences import BUFFER_DIFFERENCES, Kernel, kernel

Array = NDArray[np.float64]
Factors = NDArray[np.int64]
Samples = NDArray[np.floating[Any]] | NDArray[np.integer[Any]]

MAX_SAMPLES_EXACT = 2_000_000
"""Samples up to which every difference is taken at every factor."""
MAX_STEPS_IN_FACTOR = 128


def stride(m: int) -> int:
    """The power of two that leaves between half of `MAX_STEPS_IN_FACTOR` and `MAX_STEPS_IN_FACTOR` steps in m."""
    return (
        1 << max(0, m.bit_length() - MAX_STEPS_IN_FACTOR.bit_length() + 1) if m >= MAX_STEPS_IN_FACTOR else 1
    )


class Level:
    """Averages over one stride, their phase, and the squares of its second differences.

    Parameters
    ----------
    steps : sequence of int
        Steps of the differences, in strides.
    size : int
        Samples in a block at least, even.
    kernel : Kernel
    """

    def __init__(self, steps: Iterable[int], size: int, kernel: Kernel) -> None:
        self.steps = np.array(sorted(steps), dtype=np.int64)
        self.sums = np.zeros(self.steps.size)
        self.points = 1
        self.next: Level | None = None
        self._tail, self._kernel = 2 * int(self.steps.max(initial=1)), kernel
        self._size = max(size, self._tail)  # so that moving the tail costs no more than taking the block
        self._phase = np.empty(self._tail + self._size)
        self._phase[0] = 0.0
        self._done = self._fill = 1
        self._rate = self._origin = 0.0

    def add(self, y: Samples) -> None:
        """Take samples, shape (n,) [U], of any kind of number."""
        start = 0
        while start < y.size:
            part = y[start : start + self._done + self._size - self._fill]
            self._phase[self._fill : self._fill + part.size] = part
            self._fill += part.size
            start += part.size
            if self._fill == self._done + self._size:
                self._take()

    def finish(self) -> None:
        """Take what is left, here and in the levels that follow."""
        if self._fill > self._done:
            self._take()
        if self.next is not None:
            self.next.finish()

    def _take(self) -> None:
        """Turn the block of samples into phase, take its differences, hand on, keep the tail."""
        done, x = self._done, self._phase[: self._fill]
        with np.errstate(all="ignore"):
            rate = float(x[done:].mean())
        if not np.isfinite(rate):
            self._refuse(x[done:])
        if self.points == 1:
            self._rate = self._origin = rate
        x[:done] -= (rate - self._rate) * np.arange(1.0 - done, 1.0)  # the last point that is kept is zero
        self._rate = rate
        self._kernel.accumulate(x[done:], rate)
        self.sums += self._kernel.squares(x, done, self.steps)
        self.points += x.size - done
        if self.next is not None:
            self.next.add(np.diff(x[done - 1 :: 2]) / 2.0 + (rate - self._origin))
        kept = x[-self._tail :] - x[-1]
        self._phase[: kept.size] = kept
        self._done = self._fill = kept.size

    def _refuse(self, y: Array) -> None:
        bad = np.flatnonzero(~np.isfinite(y))
        if not bad.size:
            raise InputError("the values are too large to be squared", remedy="Check the unit and the column")
        raise InputError(
            f"sample {self.points + bad[0]} is not a number", remedy="Cut or correct these samples"
        )


class Phase:
    """The running Allan variance of a stream.

    Parameters
    ----------
    m : ndarray of int, shape (k,)
        Averaging factors. Those beyond `MAX_STEPS_IN_FACTOR` that are no multiple of their `stride` take all points
        that their powers of two allow, and memory for twice as many.
    n : int, optional
        Samples that will come. Not known: up to `MAX_SAMPLES_EXACT` of them are held back until it is clear
        whether every difference is taken.
    """

    def __init__(self, m: Factors, n: int | None = None) -> None:
        self.n = 0
        self._m, self._expected = m.tolist(), n
        self._held: list[Samples] = []
        self._levels: list[Level] = []
        if n is not None:
            self._start(n, n <= MAX_SAMPLES_EXACT)

    def _start(self, n: float, exact: bool) -> None:
        places = [-1 if 2 * k > n else 0 if exact else _level(k) for k in self._m]
        size = 2 * int(n // 2 + 1) if exact else BUFFER_DIFFERENCES
        best = kernel(n)
        for s in range(max(places, default=0) + 1):
            level = Level({k >> s for k, at in zip(self._m, places) if at == s}, size, best)
            if self._levels:
                self._levels[-1].next = level
            self._levels.append(level)
        self._places = places
        for held in self._held:
            self._levels[0].add(held)
        self._held.clear()

    def add(self, chunk: Samples) -> None:
        """Take the samples that follow, shape (n,) [U]: float32, float64 or integers."""
        if chunk.ndim != 1:
            raise InputError(f"a chunk of {chunk.ndim} dimensions is no row of samples")
        self.n += chunk.size
        if self._levels:
            self._levels[0].add(chunk)
            return
        if self.n <= MAX_SAMPLES_EXACT:
            self._held.append(chunk.copy())
            return
        self._start(float("inf"), False)
        self._levels[0].add(chunk)

    def variance(self) -> Array:
        """The overlapping Allan variance [U^2] at every factor, shape (k,); NaN where ``2 m > n``. It ends the stream.

        Raises
        ------
        InputError
            Another number of samples came than was said.
        """
        if self._expected is not None and self.n != self._expected:
            raise InputError(f"{self.n} samples came instead of {self._expected}")
        if not self._levels:
            self._start(self.n, True)
        self._levels[0].finish()
        return np.array([self._at(k, s) for k, s in zip(self._m, self._places)])

    def _at(self, k: int, s: int) -> float:
        if s < 0:
            return float("nan")
        level, step = self._levels[s], k >> s
        count = level.points - 2 * step
        place = int(np.searchsorted(level.steps, step))
        return float(level.sums[place]) / count / (2.0 * step * step) if count > 0 else float("nan")


def _level(m: int) -> int:
    """The level of a factor in a thinned record: that of its stride, or the highest that its divisors allow."""
    return min(stride(m).bit_length(), (m & -m).bit_length()) - 1


def variance_of_chunks(chunks: Iterable[Samples], m: Factors, n: int | None = None) -> Array:
    """Overlapping Allan variance [U^2] of a stream, shape (k,); see `Phase`.

    Parameters
    ----------
    chunks : iterable of ndarray, shape (any,)
        Samples [U] one after the other, in pieces of any length.
    m : ndarray of int, shape (k,)
        Averaging factors.
    n : int, optional
        Samples in all, where known.
    """
    phase = Phase(m, n)
    for chunk in chunks:
        phase.add(chunk)
    return phase.variance()
