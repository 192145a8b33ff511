"""Drivers without their own noise, and their courses between the samples that they have."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kfgen.identify.evidence.whittle import block_means
from kfgen.log.course import between_samples
from kfgen.log.log import Log

Array = NDArray[np.float64]

MAX_PLAIN_WINDOW_SAMPLES = 51
"""Samples of a window that is smoothed as it is."""


def course_without_noise(log: Log, name: str) -> Array:
    """The smoothed course of a channel over all times of a log.

    Parameters
    ----------
    log : Log
    name : str
        With a number at least.

    Returns
    -------
    ndarray, shape (n,)
    """
    values = log.channel(name).values
    return between_samples(log, name, smoothed(values[np.isfinite(values)]))


def smoothed(values: Array) -> Array:
    """A driver without its own noise, as far as that leaves nothing of it behind: parabolas over windows.

    A noisy regressor explains less than the quantity that it stands for. In units of its size to a power of two, which
    changes no digit: squares of any number are numbers then.
    """
    _, size = np.frexp(np.abs(values).max(initial=0.0))
    return np.asarray(np.ldexp(_smoothed(np.ldexp(values, -size)), size))


def _smoothed(values: Array) -> Array:
    # The mean square of third differences of white noise is 20 times its variance.
    noise2 = float(np.mean(np.diff(values, 3) ** 2)) / 20.0 if values.size > 8 else 0.0
    best, window = values, 5
    while 8 * window < values.size:
        trial = _parabolas(values, window)
        # A parabola takes up about 2.25 / window of the noise.
        left = float(np.mean((values - trial) ** 2)) / max(1.0 - 2.25 / window, 0.1)
        if left > noise2 * (1.02 + 4.0 * float(np.sqrt(2.0 / values.size))):
            break
        best, window = trial, 2 * window + 1
    return np.asarray(best)


def _parabolas(values: Array, window: int) -> Array:
    """Local parabolas over windows, shape (n,); long ones on means of short blocks."""
    from scipy.signal import savgol_filter

    block = max(1, window // MAX_PLAIN_WINDOW_SAMPLES)
    if block == 1:
        return np.asarray(savgol_filter(values, window, 2, mode="interp"))
    smooth = savgol_filter(block_means(values, block), 2 * (window // block // 2) + 1, 2, mode="interp")
    middle = (np.arange(smooth.size) + 0.5) * block
    return np.asarray(np.interp(np.arange(values.size) + 0.5, middle, smooth))
