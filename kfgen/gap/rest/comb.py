"""Lines that are harmonics of one: what repeats is no sum of sines, and lines would be added for ever."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

MIN_LINES = 4
"""Lines that make a comb: a tone with an overtone or two is the sum of its lines."""
MAX_HARMONIC = 40
"""Harmonic that is looked at."""
FREQUENCY_TOLERANCE_INVERSE_RECORDS = 0.3
"""Of the record's resolution: how well the frequency of a line is known, at least."""
MAX_ACCIDENT_PROBABILITY = 1e-3
"""That so many lines would be multiples of something by accident, below which they are a comb."""


MAX_RATIO_BESIDE_WAVE = 12
"""Of two frequencies of which one is a multiple of the other."""


def beside_wave(waves: Sequence[float], lines: Sequence[float], duration: float) -> float:
    """The fundamental [Hz] of a periodic wave that leaves other waves or lines at its multiples: it has another shape.

    Zero where there is none.

    Parameters
    ----------
    waves, lines : sequence of float
        Fundamentals of periodic waves and frequencies of lines [Hz].
    duration : float
        Of the record [s].
    """
    for i, wave in enumerate(waves):
        for other in [*waves[:i], *lines]:
            low, high = min(wave, other), max(wave, other)
            order = round(high / low)
            if order <= MAX_RATIO_BESIDE_WAVE and abs(high - order * low) < 1.0 / duration:
                return low
    return 0.0


def comb_of(frequencies: Sequence[float], duration: float) -> float:
    """The fundamental [Hz] of which at least `MIN_LINES` lines are harmonics; zero where there is none.

    Two lines fix a fundamental f; each further one lies within `FREQUENCY_TOLERANCE_INVERSE_RECORDS` of the record's resolution ``1 / duration``
    of a multiple of it by chance with the probability ``2 FREQUENCY_TOLERANCE_INVERSE_RECORDS / (duration f)``.

    Parameters
    ----------
    frequencies : sequence of float
        Of the lines [Hz].
    duration : float
        Of the record [s].
    """
    f = np.sort(np.asarray(frequencies, dtype=np.float64))
    if f.size < MIN_LINES:
        return 0.0
    spacings = np.concatenate([f, np.diff(f)])
    tried = (spacings[:, None] / np.arange(1, 4)).ravel()
    tried = np.sort(tried[tried > 4.0 / duration])[::-1]
    for start in tried.tolist():
        order = np.round(f / start)
        near = (order >= 1) & (order <= MAX_HARMONIC) & (np.abs(f - order * start) < 1.0 / duration)
        if near.sum() < MIN_LINES:
            continue
        f0 = float((order[near] @ f[near]) / (order[near] @ order[near]))
        count = int((near & (np.abs(f - order * f0) < FREQUENCY_TOLERANCE_INVERSE_RECORDS / duration)).sum())
        if (
            count >= MIN_LINES
            and tried.size * (2.0 * FREQUENCY_TOLERANCE_INVERSE_RECORDS / (duration * f0)) ** (count - 2)
            < MAX_ACCIDENT_PROBABILITY
        ):
            return f0
    return 0.0
