"""What tests of readers share: the samples that a channel has, and the nearest stamp by brute force."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kfgen.log.log import Log

Array = NDArray[np.float64]


def placed(log: Log, channel: str) -> tuple[Array, Array]:
    """Times and values of the samples that a channel has."""
    values = log.channels[channel].values
    good = np.isfinite(values)
    return log.t[good], values[good]


def nearest(t: Array, stamps: Array) -> NDArray[np.int64]:
    """By brute force: the index of the stamp nearest each time."""
    return np.array([int(np.argmin(np.abs(stamps - s))) for s in t])
