"""How strong a vibration is: the running variance of the specific force."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

VARIANCE_WINDOW_S = 1.0
"""Length over which the variance of the vibration runs [s]."""
VIBRATION_PERIOD_S = 0.1
"""Length over which the specific force of motion does not change: what does is vibration [s]."""


def running_variance(x: Array, quick: float, samples: float) -> Array:
    """Variance of columns, shape (n, k), about their means over `quick` samples, over a window of `samples`."""
    from scipy.ndimage import uniform_filter1d

    short, size = (max(3, min(int(m), x.shape[0])) for m in (quick, samples))
    away = x - uniform_filter1d(x, short, axis=0, mode="nearest")
    square = uniform_filter1d(away * away, size, axis=0, mode="nearest")
    return np.asarray(square * short / (short - 1.0))


def vibration_power(f_b: Array, dt: float) -> Array:
    """Running variance of a specific force (n, 3) sampled every `dt` [s], shape (n, 3) [m^2/s^4]."""
    return running_variance(f_b, VIBRATION_PERIOD_S / dt, VARIANCE_WINDOW_S / dt)
