"""What a row of time stamps says of its clock: rate, gaps, stamps that repeat or go back."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

GAP_PERIODS = 1.5
"""Steps of time longer than this many periods are gaps."""


@dataclass(frozen=True)
class Clock:
    """Facts of a row of time stamps.

    Parameters
    ----------
    n : int
        Stamps.
    start, end : float
        The first and the last in order of time [s]; not a number where there is none.
    period : float
        Median step [s]; not a number below two stamps.
    jitter : float
        Standard deviation of the steps that are no gaps [s].
    gaps : int
        Steps longer than `GAP_PERIODS` periods.
    longest : float
        The longest step [s]; zero where there is none.
    longest_at : float
        When it begins [s].
    repeated, back : int
        Stamps equal to, and earlier than, the one before.
    """

    n: int
    start: float
    end: float
    period: float
    jitter: float
    gaps: int
    longest: float
    longest_at: float
    repeated: int
    back: int

    @property
    def rate(self) -> float:
        """Samples a second by the median step [Hz]; not a number below two stamps."""
        return 1.0 / self.period if self.period > 0.0 else float("nan")

    @staticmethod
    def counted(n: int) -> Clock:
        """A row of which only the number of stamps is known."""
        nan = float("nan")
        return Clock(n, nan, nan, nan, 0.0, 0, 0.0, nan, 0, 0)

    @staticmethod
    def of(t: Array) -> Clock:
        """The facts of stamps [s], shape (n,), as they follow each other in the file."""
        nan = float("nan")
        if t.size < 2:
            at = float(t[0]) if t.size else nan
            return Clock(t.size, at, at, nan, 0.0, 0, 0.0, nan, 0, 0)
        steps = np.diff(t)
        forward = steps[steps > 0.0]
        period = float(np.median(forward)) if forward.size else nan
        usual = forward[forward <= GAP_PERIODS * period]
        k = int(np.argmax(steps))
        return Clock(
            t.size,
            float(np.min(t)),
            float(np.max(t)),
            period,
            float(np.std(usual)) if usual.size else 0.0,
            int(np.count_nonzero(steps > GAP_PERIODS * period)),
            max(float(steps[k]), 0.0),
            float(t[k]),
            int(np.count_nonzero(steps == 0.0)),
            int(np.count_nonzero(steps < 0.0)),
        )
