"""Which directions readings cover, and where more are needed."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kfgen.calibrate.words import how_to_turn
from kfgen.core.channel_names import AXES

Array = NDArray[np.float64]

DIRECTIONS = 200
"""Points on the sphere, evenly spread."""
NEAR_RAD = np.radians(30.0)
"""Angle within which a direction is covered by a reading."""


def sphere(count: int = DIRECTIONS) -> Array:
    """Unit vectors evenly spread by the golden angle, shape (count, 3)."""
    z = 1.0 - (2.0 * np.arange(count) + 1.0) / count
    turn = np.pi * (3.0 - np.sqrt(5.0)) * np.arange(count)
    r = np.sqrt(1.0 - z * z)
    return np.column_stack([r * np.cos(turn), r * np.sin(turn), z])


def covered_share(u: Array) -> float:
    """Share of the directions that lie within `NEAR_RAD` of a reading.

    Parameters
    ----------
    u : ndarray, shape (n, 3)
        Readings about their centre.
    """
    e = u / np.maximum(np.linalg.norm(u, axis=1, keepdims=True), 1e-300)
    nearest = (sphere() @ e[:: max(1, len(e) // 5000)].T).max(axis=1)
    return float(np.mean(nearest > np.cos(NEAR_RAD)))


def missing_turn(u: Array) -> str:
    """Along which axis readings vary least, and how the sensor should be turned, in words.

    Parameters
    ----------
    u : ndarray, shape (n, 3)
        Readings about their centre.
    """
    away = u - u.mean(axis=0)
    least = np.linalg.eigh(away.T @ away)[1][:, 0]
    axis = AXES[int(np.argmax(np.abs(least)))]
    return how_to_turn(axis)
