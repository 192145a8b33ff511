"""Samples that are no measurements: a stuck stretch, a value far beyond all others.

They are left out like missing ones, and named: a model of the noise would be bent by them, and another effect
would be found in their place.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from kfgen.effects.faults.samples import Stuck, runs
from kfgen.effects.samples.event import Outliers
from kfgen.effects.series import DetectedFault, RawSamples
from kfgen.gap.rest.words import no_measurements
from kfgen.identify.screening.stuck import MAX_EQUAL_NEIGHBOUR_PROBABILITY, standing

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

MIN_REPEAT_PROBABILITY, MAX_REPEAT_PROBABILITY = 1e-4, 0.95
"""Chance that a sample equals the one before it, at least and at most."""
MIN_RUNS_AT_A_LIMIT = 3
"""Runs at one end of the range that are a limit and no stuck stretch."""
MAX_STUCK_STRETCHES = 8
"""Stretches beyond which samples rather repeat."""
MAX_BAD_SHARE = 0.2
"""Share of the samples beyond which they are not left out: the channel is spoilt."""
MIN_MOVING_SHARE = 0.1
"""Share of the samples that differ from the one before, below which a channel rather never changes."""
WILD, TAME = 30.0, 8.0
"""Standard deviations beyond which a value is no noise, if none lies between both."""
MAX_WILD_SHARE = 1e-3
"""Share of wild samples beyond which they are a law of the noise."""


def invalid_samples(raw: RawSamples) -> tuple[Mask, tuple[DetectedFault, ...]]:
    """Which samples are no measurements, shape (n,), and what they show; none is left out where they spoil the channel."""
    if not np.ptp(raw.y) > 0.0:
        return np.zeros(raw.n, dtype=np.bool_), ()  # a channel that never changes is refused as a whole
    still, invalid, found = _still(raw), _wild(raw), []
    if _is_spoilt(raw, still):
        spoils = [DetectedFault(_stuck(raw, a, b), float(b - a), spoils=True) for a, b in still]
        return np.zeros(raw.n, dtype=np.bool_), tuple(spoils)
    if not np.any(np.diff(raw.y)):  # a channel that never changes is refused as what it is
        return np.zeros(raw.n, dtype=np.bool_), ()
    if invalid.any():
        off = float(np.sqrt(np.mean((raw.y[invalid] - np.median(raw.y)) ** 2)))
        found.append(DetectedFault(Outliers(float(np.mean(invalid)), off), float(invalid.sum())))
    for a, b in still:
        invalid[a:b] = True
        found.append(DetectedFault(_stuck(raw, a, b), float(b - a)))
    return invalid, tuple(found)


def _stuck(raw: RawSamples, first: int, end: int) -> Stuck:
    """The fault of a stretch of samples that repeats one value, from its first sample to before its end."""
    began, ended = float(raw.t[first] - raw.t[0]), float(raw.t[end - 1] - raw.t[0])
    return Stuck(began, ended - began)


def _is_spoilt(raw: RawSamples, still: Sequence[tuple[int, int]]) -> bool:
    """Whether so many samples repeat one value, out of many others, that the rest is no record."""
    moving = np.count_nonzero(np.diff(raw.y))
    share = sum(b - a for a, b in still) / raw.n
    return bool(share >= MAX_BAD_SHARE and moving >= MIN_MOVING_SHARE * raw.n)


def _still(raw: RawSamples) -> list[tuple[int, int]]:
    """Runs of equal values that the noise and the ADC grid do not explain."""
    twice = 2.0 * float(np.count_nonzero(runs(raw.y)[1] > 1)) / raw.n
    equal = raw.chance_of_equals
    if equal > MAX_EQUAL_NEIGHBOUR_PROBABILITY:  # on a grid wider than the noise a quiet spell has one value
        equal = MAX_REPEAT_PROBABILITY
    chance = min(max(equal, twice, MIN_REPEAT_PROBABILITY), MAX_REPEAT_PROBABILITY)
    spans = standing(raw.y, chance, 2, MIN_RUNS_AT_A_LIMIT)
    return spans if len(spans) <= MAX_STUCK_STRETCHES else []


def _wild(raw: RawSamples) -> Mask:
    from scipy.signal import medfilt

    away = np.abs(raw.y - medfilt(raw.y, 5))
    scale = max(1.4826 * float(np.median(away)), raw.adc_step)
    wild = away > WILD * scale
    between = np.any((away > TAME * scale) & ~wild)
    few = np.mean(wild) <= max(MAX_WILD_SHARE, 1.0 / raw.n)
    return np.asarray(wild) if few and not between and scale > 0.0 else np.zeros(raw.n, dtype=np.bool_)


def words_of(name: str, t: Array, invalid: Mask, found: Sequence[DetectedFault]) -> list[str]:
    """What is said of them: how many, and when.

    Parameters
    ----------
    name : str
        Of the channel.
    t : ndarray, shape (n,)
        Times [s].
    invalid : ndarray of bool, shape (n,)
        Samples that are left out.
    found : sequence of DetectedFault
    """
    if not invalid.any():
        return []
    first, last = t[invalid][[0, -1]].tolist()
    kinds = list(dict.fromkeys(f.effect.title for f in found))
    return [no_measurements(int(invalid.sum()), name, (first, last), kinds)]
