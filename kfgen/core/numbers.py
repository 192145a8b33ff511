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


def moment(t_s: float) -> str:
    """A time in a message: six digits, and of clocks that began long ago a tenth of a millisecond still.

    Parameters
    ----------
    t_s : float
        [s].

    Returns
    -------
    str
    """
    return f"{t_s:.6g}" if abs(t_s) < 100.0 else f"{round(t_s, 4):.15g}"


def how_many(n: int, noun: str) -> str:
    """So many of something, in the singular or the plural.

    Parameters
    ----------
    n : int
    noun : str
        In the singular.

    Returns
    -------
    str
    """
    return f"{n} {noun}" if n == 1 else f"{n} {noun}s"


def few_digits(value: float, digits: int = 2) -> str:
    """A number with few digits and without an exponent below a million: 120, not 1.2e+02.

    Parameters
    ----------
    value : float
    digits : int
        That count.

    Returns
    -------
    str
    """
    return f"{float(f'{value:.{digits}g}'):g}"


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
