"""Rows that a log of a plant has lost: what its inputs did meanwhile is not known.

A held input that is another one after such a hole changed at some time within it. That moves the states by an unknown part
of what the change does over the rows that are lost; after a long one the plant may be anywhere near where it usually is. Each such
motion is a unit normal deviate times a column of the residuals, and all of them are integrated out at once.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from kfgen.gap.plant.shooting import MIN_FIRST_WINDOW_SAMPLES

Array = NDArray[np.float64]
Counts = NDArray[np.intp]

MIN_LOST_STEPS = 1.5
"""Usual steps of time from which on rows are lost."""
MAX_STEPS_FOLLOWED = 3.5
"""Usual steps of time beyond which nothing is known of the inputs in a hole."""
MAX_LOST_SHARE = 0.2
"""Share of the steps of a log that are longer, from which on its rows are uneven, and none is lost."""
MAX_COLUMNS, MAX_COLUMN_VALUES = 600, 2e7
"""Of holes, those with the largest changes; and values of all of them."""
MAX_NEW_STARTS = 8
"""After long holes; what is left of these counts as unknown with what the plant does as it is simulated through them."""
MIN_SEEN_POWER = 1e-6
"""Of a column in variances of the noise, below which nobody sees it."""


@dataclass(frozen=True)
class LostRows:
    """Where rows are lost.

    Parameters
    ----------
    before : ndarray, shape (holes,)
        The last sample before each hole.
    steps : ndarray, shape (holes,)
        How long each is, in usual steps of time.
    """

    before: Counts
    steps: Array

    @staticmethod
    def of(t: Array) -> LostRows:
        """Of the times of a log, shape (n,) [s]; none where they are uneven."""
        steps = np.diff(t)
        usual = float(np.median(steps)) if steps.size else 1.0
        lost = np.flatnonzero(steps > MIN_LOST_STEPS * usual)
        if lost.size > MAX_LOST_SHARE * steps.size:
            lost = lost[:0]
        return LostRows(lost, steps[lost] / usual)

    def anew(self, n: int) -> tuple[int, ...]:
        """Samples of a log of n after the longest of the long holes: the plant is followed from there anew."""
        ends = self.before[self.is_long] + 1
        longest = np.sort(ends[np.argsort(-self.steps[self.is_long], kind="stable")[:MAX_NEW_STARTS]])
        far: list[int] = []
        for end in longest.tolist():
            if min(end - (far[-1] if far else 0), n - end) >= MIN_FIRST_WINDOW_SAMPLES:
                far.append(end)
        return tuple(far)

    def clock(self, t: Array) -> Array:
        """The times of the log, shape (n,), long holes cut short [s]: after them states are not known, however long they last."""
        steps = np.diff(t)
        steps[self.before] *= np.minimum(1.0, MAX_STEPS_FOLLOWED / self.steps)
        return np.asarray(t[0] + np.concatenate([[0.0], np.cumsum(steps)])) if self.is_long.any() else t

    def moving(self, inputs: Mapping[str, Array]) -> LostRows:
        """Those in which an input, shape (n,), changes, or that are long; the largest changes where they are too many."""
        size = np.zeros(self.before.size)
        for u in inputs.values():
            size += np.abs(u[self.before + 1] - u[self.before]) / max(float(np.ptp(u)), 1e-300)
        size[self.steps > MAX_STEPS_FOLLOWED] = np.inf
        most = int(min(MAX_COLUMNS, MAX_COLUMN_VALUES / next(iter(inputs.values())).size)) if inputs else 0
        best = np.sort(np.argsort(-size, kind="stable")[:most])
        best = best[size[best] > 0.0]
        return LostRows(self.before[best], self.steps[best])

    @property
    def is_long(self) -> NDArray[np.bool_]:
        """Whether nothing is known of the inputs in them, shape (holes,)."""
        return self.steps > MAX_STEPS_FOLLOWED


@dataclass(frozen=True)
class Disturbed:
    """Residuals without what holes do to them.

    Parameters
    ----------
    E : ndarray, shape (N, columns)
        Whitened, each times a unit normal deviate.
    mean : ndarray, shape (N,)
        Whitened, what is added to measured less simulated values in the mean.
    """

    E: Array = field(default_factory=lambda: np.zeros((0, 0)))
    mean: Array = field(default_factory=lambda: np.zeros(0))

    @cached_property
    def _axes(self) -> tuple[Array, Array]:
        """Orthonormal directions, shape (N, k), and their variances, shape (k,)."""
        power, V = np.linalg.eigh(self.E.T @ self.E)
        seen = power > MIN_SEEN_POWER
        return self.E @ V[:, seen] / np.sqrt(power[seen]), power[seen]

    def centred(self, X: Array) -> Array:
        """Whitened residuals, shape (N, k), without the mean."""
        return X - self.mean[:, None] if self.mean.size else X

    def without(self, X: Array) -> Array:
        """Whitened columns, shape (N, k), with the deviates integrated out: their squares are what is left of the likelihood."""
        if not self.E.size:
            return X
        U, power = self._axes
        shrunk = 1.0 - 1.0 / np.sqrt(1.0 + power)
        return np.asarray(X - U @ (shrunk[:, None] * (U.T @ X)))

    @property
    def spread(self) -> float:
        """Logarithm of how much wider that makes the data [nats]."""
        return 0.5 * float(np.log1p(self._axes[1]).sum()) if self.E.size else 0.0
