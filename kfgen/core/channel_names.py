"""What the name of a channel says: the sensor that it belongs to, and the axis."""

from __future__ import annotations

AXES = "xyz"


def acts_on(where: str, channel: str) -> bool:
    """Whether a place, a channel or a sensor by the beginning of its channels' names, holds a channel.

    Parameters
    ----------
    where : str
        ``mag`` holds ``mag_x``; ``gnss`` holds ``gnss_p_N`` and ``gnss_v_N``.
    channel : str
        Name of a channel.

    Returns
    -------
    bool
    """
    return channel == where or channel.startswith(f"{where}_")


def sensor_and_axis(channel: str) -> tuple[str, int]:
    """The sensor and the axis of a channel: ``gyro_y`` is axis 1 of ``gyro``; one without axes is axis 0."""
    sensor, _, axis = channel.rpartition("_")
    return (sensor, AXES.index(axis)) if sensor and len(axis) == 1 and axis in AXES else (channel, 0)
