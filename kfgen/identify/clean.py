"""What is wrong with a record before any fit: outliers, and an internal low-pass.

Both are found with medians, which what they look for cannot move.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from kfgen.identify.fit import Record
from kfgen.identify.whittle import transform

Array = NDArray[np.float64]

FAR = 7.0
"""Robust deviations beyond which a sample is an outlier: a Gaussian one is in 4e11."""
MOST = 0.05
"""Share of outliers beyond which they are the noise."""
ROLLED_OFF = 0.7
"""Share of the plateau's power below which a band belongs to the low-pass."""
STAY_BELOW = 0.35
"""Of the frequency where that begins: there a second-order low-pass has taken 1 %."""


def without_outliers(record: Record) -> tuple[Record, float]:
    """The record with outliers interpolated, and their share.

    A sample is an outlier when it is far from the median of itself and its neighbours, by the scale of
    such distances in the record; a step or a drift is none.
    """
    from scipy.ndimage import median_filter

    distance = record.y - median_filter(record.y, size=7, mode="mirror")
    scale = 1.4826 * float(np.median(np.abs(distance - np.median(distance))))
    lattice = _smallest_step(record.y)
    bad = np.abs(distance) > FAR * max(scale, lattice, np.finfo(float).tiny)
    share = float(bad.mean())
    if not 0.0 < share <= MOST:
        return record, 0.0
    at = np.arange(record.y.size, dtype=float)
    return replace(record, y=np.interp(at, at[~bad], record.y[~bad])), share


def _smallest_step(y: Array) -> float:
    """The step of the lattice of values, zero where there is none to see."""
    values = np.unique(y[:20_000])
    return float(np.diff(values).min()) if 1 < values.size < y[:20_000].size // 2 else 0.0


def roll_off(record: Record) -> float | None:
    """The frequency [Hz] from which on an internal low-pass takes power away, None without one."""
    X = transform(record.y[:, None], record.block)[:, 0]
    n = X.size
    omega = np.arange(1, n + 1) * (np.pi / (n + 1))
    power = X**2 / (4.0 * np.sin(0.5 * omega) ** 2)
    edges = np.unique(np.linspace(n // 50, n, 50).astype(int))
    if edges.size < 20 or np.diff(edges).min() < 20:
        return None
    # The median of a chi-square of one degree of freedom is 0.4549.
    level = np.array([np.median(power[a:b]) for a, b in pairwise(edges)]) / 0.4549
    plateau = float(np.median(level[: level.size // 3]))
    low = level < ROLLED_OFF * plateau
    if not low[-5:].all():
        return None
    first = int(np.flatnonzero(~low)[-1]) + 1 if not low.all() else 1
    return float(STAY_BELOW * omega[edges[first]] / (2.0 * np.pi * record.dt * record.block))
