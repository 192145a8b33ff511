"""GNSS outages cut into a flight: how far the filter drifts until the next fix, with and without what is known of effects."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from kfgen.gap.core.result import OutageDrift
from kfgen.gap.flight.linear.linear_flight import LinearFlight
from kfgen.gap.flight.path import FlownPath

Array = NDArray[np.float64]

RECEIVER = "gnss"
"""The sensors by the beginning of their names that an outage silences."""
POSITION = "gnss_p"
"""Those whose next reading shows the drift."""
OUTAGES_S = (10.0, 30.0)
"""Lengths of outages [s]."""
RECOVERY_SHARE = 1.0
"""Time between outages, over their length."""


def outage_drifts(path: FlownPath, share: float) -> tuple[OutageDrift, ...]:
    """The root mean square distance between the filter and the first fix after outages of each length.

    Parameters
    ----------
    path : FlownPath
        Smoothed with all readings.
    share : float
        Of the time with fixes, its end, in which outages are cut.
    """
    found = (_drift(path, share, seconds) for seconds in OUTAGES_S)
    return tuple(d for d in found if d is not None)


def _drift(path: FlownPath, share: float, seconds: float) -> OutageDrift | None:
    """None where the log has no fixes, or no room for an outage and the fix after it."""
    rows = path.rows
    silent = np.array([c.startswith(RECEIVER) for c in rows.channels])[rows.index]
    fix = np.array([c.startswith(POSITION) for c in rows.channels])[rows.index]
    if not fix.any():
        return None
    first, last = float(rows.t[fix][0]), float(rows.t[fix][-1])
    starts = np.arange(last - share * (last - first), last - seconds, (1.0 + RECOVERY_SHARE) * seconds)
    cut = np.zeros(rows.t.size, dtype=bool)
    for start in starts.tolist():
        cut |= silent & (rows.t >= start) & (rows.t < start + seconds)
    if not cut.any():
        return None
    linear = replace(path, silenced=cut).linear
    squares = [_square(linear, fix & (rows.t >= start + seconds)) for start in starts.tolist()]
    return OutageDrift(seconds, float(np.sqrt(np.mean(squares))), len(squares))


def _square(linear: LinearFlight, fix: NDArray[np.bool_]) -> float:
    """Squared distance to the first of some fixes, before any reading of its time is used [m^2]."""
    at, total, x = linear.rows.at, 0.0, np.zeros(linear.x0.size)
    for k in np.flatnonzero(at == at[np.argmax(fix)]).tolist():
        if fix[k]:
            total += float(linear.e[k] + linear.H[k] @ x) ** 2
        x += linear.K[k] * linear.e[k]
    return total
