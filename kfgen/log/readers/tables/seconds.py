"""Stamps of unknown unit as seconds: by what their name says, by the year they would be in, by the rate they would give."""

from __future__ import annotations

import re

import numpy as np
from numpy.typing import NDArray

from kfgen.core.errors import InputError
from kfgen.core.units import parse_unit

Array = NDArray[np.float64]

UNITS_S = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
"""Units of stamps [s]."""
YEARS_S = (3e8, 5e9)
"""Seconds since 1970 between which a stamp is a date: 1979 to 2128."""
LONGEST_STEP_S = 2.0
"""Median step up to which stamps are assumed to be seconds."""
USUAL_HZ = 100.0
"""Rate nearest to which that of stamps is assumed to be, where nothing else says their unit."""
_NAMED = re.compile(r"(?:[_\s(]|stamp|time)(ns|us|ms|sec|s)\)?$", re.I)


def stamp_unit(name: str, values: Array) -> str:
    """The unit of stamps: ``s``, ``ms``, ``us`` or ``ns``.

    Parameters
    ----------
    name : str
        Of the array or column.
    values : ndarray, shape (n,)
        Stamps as stored.

    Returns
    -------
    str
    """
    named = _NAMED.search(name.strip())
    if named:
        return "s" if named.group(1).lower() == "sec" else named.group(1).lower()
    finite = values[np.isfinite(values)]
    if finite.size < 2:
        return "s"
    step, first = float(np.median(np.abs(np.diff(finite)))), abs(float(finite[0]))
    dates = [u for u, s in UNITS_S.items() if YEARS_S[0] < first * s < YEARS_S[1] and _is_step(step * s)]
    if dates:
        return dates[0]
    if step <= LONGEST_STEP_S:
        return "s"
    return min(UNITS_S, key=lambda u: abs(np.log(step * UNITS_S[u] * USUAL_HZ)))


def seconds_per(unit: str) -> float | None:
    """How many seconds a unit of time is; None where the text is none."""
    try:
        parsed = parse_unit(unit)
    except InputError:
        return None
    return parsed.factor if parsed.same_dimension(parse_unit("s")) else None


def _is_step(step_s: float) -> bool:
    return 1e-5 < step_s < 100.0
