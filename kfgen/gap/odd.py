"""Samples that are no measurements: a stretch that stands still, a value far beyond all others.

They are left out like missing ones, and named: a model of the noise would be bent by them, and another effect
would be found in their place.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from kfgen.effects.event import Outliers
from kfgen.effects.integrity import RepeatedSamples
from kfgen.effects.series import Raw, Spotted

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

CHANCE = 1e-6
"""Number of equal runs of a length that chance may give in a record."""
RARE = 1e-4
"""Chance that a sample equals the one before it, at least."""
OFTEN = 3
"""Runs at one end of the range that are a limit and no stretch that stands still."""
MOST = 0.2
"""Share of the samples beyond which they are not left out: the channel is spoilt."""
WILD, TAME = 30.0, 8.0
"""Deviations beyond which a value is no noise, if none lies between both."""
FEW_WILD = 1e-3
"""Share of wild samples beyond which they are a law of the noise."""


def odd_samples(raw: Raw) -> tuple[Mask, tuple[Spotted, ...]]:
    """Which samples are no measurements, shape (n,), and what they show."""
    still, wild = _still(raw), _wild(raw)
    found = []
    if still.any():
        found.append(Spotted(RepeatedSamples(float(np.mean(still))), float(still.sum())))
    if wild.any():
        off = float(np.sqrt(np.mean((raw.y[wild] - np.median(raw.y)) ** 2)))
        found.append(Spotted(Outliers(float(np.mean(wild)), off), float(wild.sum())))
    return still | wild, tuple(found)


def _still(raw: Raw) -> Mask:
    """Runs of equal values that the noise and the lattice do not explain."""
    same = np.concatenate([[False], np.diff(raw.y) == 0.0, [False]])
    edges = np.flatnonzero(np.diff(same.astype(np.int8)))
    starts, stops = edges[::2], edges[1::2]
    out = np.zeros(raw.n, dtype=np.bool_)
    if not starts.size:
        return out
    equal = raw.lattice / (2.0 * np.sqrt(np.pi) * max(raw.noise, 1e-300))
    chance = min(max(equal, 2.0 * starts.size / raw.n, RARE), 0.95)
    longest = np.log(CHANCE / raw.n) / np.log(chance)
    limits = [v for v in (raw.y.min(), raw.y.max()) if np.sum(raw.y[starts] == v) >= OFTEN]
    for a, b in zip(starts.tolist(), stops.tolist()):
        if b - a >= longest and raw.y[a] not in limits:
            out[a : b + 1] = True
    return out if np.mean(out) < MOST else np.zeros(raw.n, dtype=np.bool_)


def _wild(raw: Raw) -> Mask:
    from scipy.signal import medfilt

    away = np.abs(raw.y - medfilt(raw.y, 5))
    scale = max(1.4826 * float(np.median(away)), raw.lattice)
    wild = away > WILD * scale
    between = np.any((away > TAME * scale) & ~wild)
    few = np.mean(wild) <= max(FEW_WILD, 1.0 / raw.n)
    return np.asarray(wild) if few and not between and scale > 0.0 else np.zeros(raw.n, dtype=np.bool_)


def words_of(name: str, t: Array, odd: Mask, found: Sequence[Spotted]) -> list[str]:
    """What is said of them: how many, and when."""
    if not found:
        return []
    first, last = t[odd][[0, -1]]
    when = f"at {first:.6g} s" if first == last else f"between {first:.6g} and {last:.6g} s"
    kinds = " and ".join(f.effect.title for f in found)
    return [f"{int(odd.sum())} samples of {name} {when} are no measurements ({kinds}); they are left out"]
