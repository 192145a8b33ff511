"""A series without noise is no record of a sensor: a formula, a counter, a channel that a program filled in."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kfgen.core.errors import InputError

Array = NDArray[np.float64]

ORDER = 4
"""Of the differences: of a smooth series they vanish with the fourth power of the step."""
DIFFERENCE_GAIN = 70.0**0.5
"""Standard deviation of fourth differences of white noise over its own: the root of 1 + 16 + 36 + 16 + 1."""
MIN_NOISE_OF_RANGE = 1e-7
"""Noise over the range of a series, below which it is smooth to more digits than sensors have."""
MIN_SAMPLES_OF_SMOOTH_SERIES = 64
"""Samples of a series that is looked at."""


def refuse_noise_free(y: Array) -> None:
    """Refuse a series that changes and has no noise at all.

    Parameters
    ----------
    y : ndarray, shape (n,)
        Samples [SI]; what is not a number is skipped.

    Raises
    ------
    InputError
        Its fourth differences are beyond the digits of any sensor.
    """
    y = y[np.isfinite(y)]
    if y.size < MIN_SAMPLES_OF_SMOOTH_SERIES:
        return
    size = float(np.abs(y).max())
    scaled = y / size if size > 0.0 else y
    span = float(np.ptp(scaled))
    noise = float(np.median(np.abs(np.diff(scaled, ORDER)))) / DIFFERENCE_GAIN
    repeats = float(np.mean(np.diff(scaled) == 0.0))
    if span > 0.0 and noise < MIN_NOISE_OF_RANGE * span and repeats < 0.5:
        raise InputError(
            "it has no noise: its samples follow a smooth curve to more digits than a sensor has",
            remedy="Check the column: it may be a time, a counter or a computed quantity",
        )
