"""What is wrong with a record before any fit: outliers, and an internal low-pass.

Both are found with medians, which what they look for cannot move.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from kfgen.identify.record import Record
from kfgen.identify.whittle import frequencies

Array = NDArray[np.float64]

FAR = 7.0
"""Robust deviations beyond which a sample is an outlier: a Gaussian one is in 4e11."""
MOST = 0.05
"""Share of outliers beyond which they are the noise."""
ROLLED_OFF = 0.7
"""Share of the plateau's power below which a band belongs to the low-pass."""
STAY_BELOW = 0.35
"""Of the frequency where that begins: there a second-order low-pass has taken 1 %."""


def is_outlier(y: Array) -> NDArray[np.bool_]:
    """Which samples are outliers, shape (n,).

    A sample is an outlier when it is far from the median of itself and its neighbours, by the scale of
    such distances in the record; a step or a drift is none. More than `MOST` of them are the noise.
    """
    from scipy.ndimage import median_filter

    distance = y - median_filter(y, size=7, mode="mirror")
    scale = 1.4826 * float(np.median(np.abs(distance - np.median(distance))))
    lattice = _smallest_step(y)
    bad = np.abs(distance) > FAR * max(scale, lattice, np.finfo(float).tiny)
    return bad if bad.mean() <= MOST else np.zeros_like(bad)


def mended(y: Array, bad: NDArray[np.bool_]) -> Array:
    """The samples with the bad ones interpolated."""
    if not bad.any():
        return y
    at = np.arange(y.size, dtype=float)
    return np.asarray(np.interp(at, at[~bad], y[~bad]))


def _smallest_step(y: Array) -> float:
    """The step of the lattice of values, zero where there is none to see."""
    values = np.unique(y[:20_000])
    return float(np.diff(values).min()) if 1 < values.size < y[:20_000].size // 2 else 0.0


def roll_off(record: Record) -> float | None:
    """The frequency [Hz] from which on an internal low-pass takes power away, None without one."""
    X = record.sines
    n = X.size
    omega = frequencies(n)
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
