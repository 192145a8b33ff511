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


def quantity(value: float, unit: str) -> str:
    """A value in a unit, three digits; "unbounded" where it is infinite.

    Parameters
    ----------
    value : float
        In SI.
    unit : str
        In which it is shown.

    Returns
    -------
    str
    """
    return f"{from_si(value, unit):.3g} {unit}".rstrip() if math.isfinite(value) else "unbounded"
