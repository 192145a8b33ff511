"""Numbers as they are shown and stored."""

from __future__ import annotations

import math

from kfgen.core.units import from_si


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
