"""The unit of a gyro that no file states: gravity turns in a moving body as fast as the gyro says.

A slow specific force is gravity, whose direction u in the body obeys du/dt = u x w. The size of its changes over that of
u x w is therefore one where w is in rad/s, and pi/180 where it is in deg/s: a factor of 57 apart.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

BLOCK_S = 1.0
"""Interval over which the specific force is averaged [s]: what a body accelerates cancels, gravity stays."""
FEWEST_BLOCKS = 60
"""Intervals below which nothing is said."""
LEAST_CORRELATION = 0.35
"""Correlation of both changes below which the body hardly turns: of white noise, 3.8 standard deviations at the fewest blocks."""
SHORTEST_PERIOD_S = 1e-6
"""Sampling period up to which times are none [s]."""
UNITS = {"rad/s": 1.0, "deg/s": np.pi / 180.0}
"""Units that are distinguished [rad/s]."""
LARGEST_RATIO = 4.0
"""Factor between what is found and a unit, up to which it is that unit; accelerations of the body blur it."""


def gyro_unit(t: Array, accel: Array, gyro: Array) -> str:
    """The unit of a gyro by how gravity turns; empty where the body does not turn enough to know.

    Parameters
    ----------
    t : ndarray, shape (n,)
        Times [s].
    accel : ndarray, shape (n, 3)
        Specific force in any unit.
    gyro : ndarray, shape (n, 3)
        Angular rate in the unknown unit, along the same axes.

    Returns
    -------
    str
        ``rad/s``, ``deg/s`` or empty.
    """
    with np.errstate(all="ignore"):  # of the numbers of a damaged file
        return _unit(t, accel, gyro)


def _unit(t: Array, accel: Array, gyro: Array) -> str:
    good = np.isfinite(t) & np.isfinite(accel).all(axis=1) & np.isfinite(gyro).all(axis=1)
    t, accel, gyro = t[good], accel[good], gyro[good]
    period = float(np.median(np.diff(t))) if t.size > 1 else 0.0
    width = max(round(BLOCK_S / period), 1) if period > SHORTEST_PERIOD_S else t.size + 1
    blocks = t.size // width
    if blocks < FEWEST_BLOCKS:
        return ""
    mean = accel[: blocks * width].reshape(blocks, width, 3).mean(axis=1)
    length = np.linalg.norm(mean, axis=1)
    if not (length > 0.0).all():
        return ""
    u = mean / length[:, None]
    turned = np.diff(np.cumsum(gyro * period, axis=0)[width // 2 :: width][:blocks], axis=0)
    expected, seen = np.cross(0.5 * (u[:-1] + u[1:]), turned), np.diff(u, axis=0)
    sizes = np.sqrt(float(np.sum(seen**2))), np.sqrt(float(np.sum(expected**2)))
    if not min(sizes) > 0.0:
        return ""
    correlation = float(np.sum(expected * seen)) / (sizes[0] * sizes[1])
    unit = min(UNITS, key=lambda name: abs(np.log(sizes[0] / sizes[1] / UNITS[name])))
    near = abs(np.log(sizes[0] / sizes[1] / UNITS[unit])) < np.log(LARGEST_RATIO)
    return unit if abs(correlation) > LEAST_CORRELATION and near else ""
