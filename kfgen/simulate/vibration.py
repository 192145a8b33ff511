"""Vibration that comes and goes: accelerations of a band, the same function of time wherever it is looked at."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

TONES = 24
"""Spectral lines of an axis."""
BAND_OF_RATE = (0.1, 0.4)
"""Frequencies of the vibration as shares of the sampling rate: the samples show it."""
SPANS = 7
"""Spans of a log; every second one is shaken."""
EDGE_OF_SPAN = 0.1
"""Share of a span within which the vibration comes or goes."""


@dataclass(frozen=True)
class Vibration:
    """Accelerations in body axes.

    Parameters
    ----------
    amplitude : float
        Standard deviation of each axis while it is on [m/s^2].
    duration : float
        Of the log [s].
    frequency, phase : ndarray, shape (3, tones)
        Of the lines [Hz], [rad].
    """

    amplitude: float
    duration: float
    frequency: Array
    phase: Array

    @staticmethod
    def drawn(amplitude: float, rate: float, duration: float, rng: np.random.Generator) -> Vibration:
        """Lines at random in the band of a log's rate [Hz]."""
        lo, hi = (share * rate for share in BAND_OF_RATE)
        frequency = rng.uniform(lo, hi, (3, TONES))
        return Vibration(amplitude, duration, frequency, rng.uniform(0.0, 2.0 * np.pi, (3, TONES)))

    def envelope(self, t: Array) -> Array:
        """Between zero and one at times (n,) [s]."""
        place = t / self.duration * SPANS
        inside = np.floor(place) % 2 == 1
        since = place - np.floor(place)
        edge = np.clip(np.minimum(since, 1.0 - since) / EDGE_OF_SPAN, 0.0, 1.0)
        return np.where(inside, 0.5 - 0.5 * np.cos(np.pi * edge), 0.0)

    def __call__(self, t: Array) -> Array:
        """Accelerations at times (n,), shape (n, 3) [m/s^2]."""
        out = np.zeros((t.size, 3))
        for axis in range(3):
            for f, phase in zip(self.frequency[axis], self.phase[axis]):
                out[:, axis] += np.sin(2.0 * np.pi * f * t + phase)
        return np.asarray(self.amplitude * np.sqrt(2.0 / TONES) * self.envelope(t)[:, None] * out)
