"""What follows something with a first-order lag."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

EVEN = 1e-6
"""Relative difference of steps of time that is none."""


def behind(t: Array, h: Array, tau: Any, start: Array) -> Array:
    """Values behind a first-order lag, shape (n, batch), exact for values linear between the samples.

    Over a step ``dt`` of slope ``s`` the distance ``d`` from the value goes to ``e d - (1 - e) tau s``, where
    ``e = exp(-dt / tau)``.

    Parameters
    ----------
    t : ndarray, shape (n,)
        Times [s].
    h : ndarray, shape (n, batch)
    tau : float or ndarray, shape (batch,)
        Time constant [s]; positive.
    start : ndarray, shape (batch,)
        The first value.
    """
    from scipy.signal import lfilter

    tau = np.atleast_1d(np.asarray(tau, dtype=np.float64))
    dt = np.diff(t)[:, None]
    stay = np.exp(-dt / tau)
    d = np.empty((h.shape[0], max(h.shape[1], tau.size)))
    d[0] = start - h[0]
    d[1:] = -(1.0 - stay) * tau * np.diff(h, axis=0) / dt
    if dt.size and np.ptp(dt) <= EVEN * float(dt.mean()):
        for j in range(d.shape[1]):
            d[:, j] = lfilter([1.0], [1.0, -stay[0, min(j, tau.size - 1)]], d[:, j])
    else:
        for k in range(dt.size):
            d[k + 1] += stay[k] * d[k]
    return h + d
