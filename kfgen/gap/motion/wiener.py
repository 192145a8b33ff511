"""A recorded quantity without its own noise, by Wiener's filter: what stands above a white floor.

A regressor with noise in it explains less than the quantity that it stands for, so that another effect of nearly
the same shape explains more.

References
----------
.. [1] W. A. Fuller, Measurement Error Models, 1987, eq. (1.1.7): the attenuation.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

AVERAGED_ORDINATES = 9
"""Ordinates over which power is averaged: a line keeps the noise of so many."""
MIN_SIGNAL_POWER_RATIO = 4.0
"""Power over the floor from which on there is more than noise: one in 20 000 such averages of white noise is above."""
MEDIAN_OF_SQUARES = 0.4549
"""Median of the square of a unit normal deviate."""
MIN_SPECTRUM_SAMPLES = 256
"""Samples below which a spectrum says nothing."""


def noiseless(x: Array) -> Array:
    """Columns, shape (n, k), as far as they stand above the noise of most of their frequencies."""
    from scipy.fft import dct, idct
    from scipy.ndimage import uniform_filter1d

    if x.shape[0] < MIN_SPECTRUM_SAMPLES:
        return x
    X = dct(x, type=2, axis=0, norm="ortho")
    floor = np.median(X**2, axis=0) / MEDIAN_OF_SQUARES
    power = uniform_filter1d(X**2, AVERAGED_ORDINATES, axis=0, mode="nearest")
    with np.errstate(divide="ignore", invalid="ignore"):
        kept = np.where(power > MIN_SIGNAL_POWER_RATIO * floor, 1.0 - floor / power, 0.0)
    kept[0] = 1.0  # the mean
    return np.asarray(idct(X * kept, type=2, axis=0, norm="ortho"))
