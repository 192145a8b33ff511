"""What the name of a channel says: the sensor that it belongs to, and the axis."""

from __future__ import annotations

from collections.abc import Iterable
from functools import lru_cache

AXES = "xyz"
GROUPS = {"imu": ("gyro", "accel")}
"""Places that hold several sensors: those of one board."""

MAX_NAMES_SAID = 20
"""Names that a message lists."""
MAX_KEPT_NAMES = 4096
"""Pairs of a place and a channel whose answer is kept: fits ask a million times."""


def some_of(names: Iterable[str]) -> str:
    """Names for a message: the first of many, and how many others there are."""
    every = list(names)
    others = len(every) - MAX_NAMES_SAID
    return ", ".join(every[:MAX_NAMES_SAID]) + (f" and {others} others" if others > 0 else "")


@lru_cache(MAX_KEPT_NAMES)
def acts_on(where: str, channel: str) -> bool:
    """Whether a place, a channel or a sensor by the beginning of its channels' names, holds a channel.

    Parameters
    ----------
    where : str
        ``mag`` holds ``mag_x``; ``gnss`` holds ``gnss_p_N`` and ``gnss_v_N``; ``imu`` holds gyros and accelerometers.
    channel : str
        Name of a channel.

    Returns
    -------
    bool
    """
    return any(channel == s or channel.startswith(f"{s}_") for s in (where, *GROUPS.get(where, ())))


def sensor_and_axis(channel: str) -> tuple[str, int]:
    """The sensor and the axis of a channel: ``gyro_y`` is axis 1 of ``gyro``; one without axes is axis 0."""
    sensor, _, axis = channel.rpartition("_")
    return (sensor, AXES.index(axis)) if sensor and len(axis) == 1 and axis in AXES else (channel, 0)
