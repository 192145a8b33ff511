"""What follows something with a first-order lag."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from kfgen.effects.driven.composed import composed

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
    tau = np.atleast_1d(np.asarray(tau, dtype=np.float64))
    dt = np.diff(t)[:, None]
    stay = np.exp(-dt / tau)
    d = np.empty((h.shape[0], max(h.shape[1], tau.size)))
    d[0] = start - h[0]
    d[1:] = -(1.0 - stay) * tau * np.diff(h, axis=0) / dt
    return h + faded(t, stay, d)


def faded(t: Array, stay: Array, driven: Array) -> Array:
    """The recursion ``x[k + 1] = stay[k] x[k] + driven[k + 1]`` from ``x[0] = driven[0]``, shape (n, batch).

    Parameters
    ----------
    t : ndarray, shape (n,)
        Times [s].
    stay : ndarray, shape (n - 1, batch or 1)
        What is left after each step of time.
    driven : ndarray, shape (n, batch)
    """
    from scipy.signal import lfilter

    dt = np.diff(t)
    if not dt.size:
        return driven
    if np.ptp(dt) <= EVEN * float(dt.mean()):
        factors = np.broadcast_to(stay[0], driven.shape[1:])
        return np.column_stack([lfilter([1.0], [1.0, -a], x) for a, x in zip(factors, driven.T)])
    kept = np.vstack([np.zeros_like(stay[:1]), stay])
    return np.asarray(composed(np.array(np.broadcast_arrays(kept, driven)), _later)[1])


def _later(then: Array, before: Array) -> Array:
    """Straight lines of factor and constant, one after the other."""
    return np.array([then[0] * before[0], then[0] * before[1] + then[1]])
