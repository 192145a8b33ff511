"""Numbers as they are shown and stored."""

from __future__ import annotations

import math

from kfgen.core.units import from_si

MIN_RATE_HZ, MAX_RATE_HZ = 1e-9, 1e9
"""Sampling rates that a sensor may have."""


def is_sampling_rate(rate: float) -> bool:
    """Whether a number is the sampling rate [Hz] of a sensor that could be."""
    return MIN_RATE_HZ <= rate <= MAX_RATE_HZ


def finite(value: float) -> float | None:
    """A number for JSON: infinities and not-a-number as null."""
    return float(value) if math.isfinite(value) else None


def digits_of(lo: float, hi: float) -> int:
    """Digits with which an interval's ends differ in two places: three at least, twelve at most.

    Parameters
    ----------
    lo, hi : float
        Its ends.

    Returns
    -------
    int
    """
    width, size = hi - lo, max(abs(lo), abs(hi))
    if not (0.0 < width < math.inf and size < math.inf):
        return 3
    return min(max(3, math.ceil(math.log10(size / width)) + 2), 12)


def quantity(value: float, unit: str, digits: int = 3) -> str:
    """A value in a unit; "unbounded" where it is infinite.

    Parameters
    ----------
    value : float
        In SI.
    unit : str
        In which it is shown.
    digits : int
        How many of its digits.

    Returns
    -------
    str
    """
    return f"{from_si(value, unit):.{digits}g} {unit}".rstrip() if math.isfinite(value) else "unbounded"
