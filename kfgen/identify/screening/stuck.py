"""Samples that repeat one value for longer than noise lets them: a sensor that is stuck or sleeps, a logger that holds it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kfgen.effects.faults.samples import runs
from kfgen.effects.series import SAME, RawSamples

Array = NDArray[np.float64]

MAX_EQUAL_NEIGHBOUR_PROBABILITY = 0.25
"""Chance of two equal neighbours above which nothing is said of samples that repeat."""
MAX_RUN_PROBABILITY = 1e-6
"""Chance in a whole record of a run of equal samples that is none."""
MIN_RUN_SAMPLES = 16
"""Samples of such a run at least."""
MIN_OTHER_RUNS = 25
"""Of a value, from which it is known how often the next sample has it again."""


def by_chance(y: Array, assumed: float) -> float:
    """Chance of two equal neighbours, samples of shape (n,) being on an ADC grid: of normal deviates ``q / (2 sqrt(pi) s)``.

    Parameters
    ----------
    y : ndarray, shape (n,)
        [SI].
    assumed : float
        Standard deviation of a sample [SI].
    """
    raw = RawSamples(np.arange(y.size, dtype=np.float64), y, assumed, moves=True)
    steps = np.abs(np.diff(y))
    steps = steps[steps > SAME * float(np.ptp(y))]
    # An encoder that runs through many of its steps has hardly any value twice: its smallest step says what they are.
    step = max(raw.adc_step, float(steps.min(initial=np.inf)) if steps.size else 0.0)
    return float(step / (2.0 * np.sqrt(np.pi) * max(min(raw.noise, assumed), 1e-300)))


def stuck_spans(y: Array, assumed: float) -> list[tuple[int, int]]:
    """Spans of samples, shape (n,), that repeat the one before them longer than chance lets noisy ones, first and end.

    Values on an ADC grid about as wide as the noise repeat while nothing moves: of these nothing is said.

    Parameters
    ----------
    y : ndarray, shape (n,)
        [SI].
    assumed : float
        Standard deviation of a sample [SI].
    """
    chance = by_chance(y, assumed)
    return standing(y, chance, MIN_RUN_SAMPLES, 2) if chance <= MAX_EQUAL_NEIGHBOUR_PROBABILITY else []


def standing(y: Array, chance: float, least: int, often: int) -> list[tuple[int, int]]:
    """Runs of equal samples, shape (n,), that chance does not give, first and end: of `least` samples at least.

    A value at which the sensor often stays, as in its dead zone, is no sign of a stuck channel.

    Parameters
    ----------
    y : ndarray, shape (n,)
    chance : float
        That a sample equals the one before it; of a value that has many shorter runs it is taken from these.
    least : int
    often : int
        Runs at one end of the range that are a limit.
    """
    first, length = runs(y)

    def longest(p: float) -> float:
        return float(1.0 + np.log(MAX_RUN_PROBABILITY / y.size) / np.log(max(p, 1e-12)))

    ends = (float(y.min()), float(y.max()))
    limits = [v for v in ends if np.sum(y[first] == v) >= often and np.ptp(y) > 0.0]
    long = length >= max(longest(chance), least, 2)
    spans = zip(first[long].tolist(), length[long].tolist())
    stays = {v: _stays(length[~long & (y[first] == v)]) for v in set(y[first[long]].tolist())}
    return [(a, a + k) for a, k in spans if y[a] not in limits and k >= longest(stays[float(y[a])])]


def _stays(length: NDArray[np.intp]) -> float:
    """Chance that a sample equals the one before it, the larger of at first and after one that did; 0 for few runs."""
    again = length[length > 1]
    if again.size < MIN_OTHER_RUNS:
        return 0.0
    return float(min(max((again - 2.0).sum() / (again - 1.0).sum(), again.size / length.size), 0.95))
