"""Overlapping Allan deviation with confidence bands.

References
----------
.. [1] W. J. Riley, Handbook of Frequency Stability Analysis, NIST SP 1065, 2008,
   eqs (11)-(12) and, for the degrees of freedom, table 5 (Howe, Allan and Barnes 1981).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kfgen.errors import InputError

Array = NDArray[np.float64]


@dataclass(frozen=True)
class AllanCurve:
    """An Allan deviation.

    Parameters
    ----------
    tau : ndarray, shape (m,)
        Averaging times [s].
    deviation, lo, hi : ndarray, shape (m,)
        Deviation [U] and its 95 % band.
    edf : ndarray, shape (m,)
        Equivalent degrees of freedom of each point.
    """

    tau: Array
    deviation: Array
    lo: Array
    hi: Array
    edf: Array


def log_factors(n: int, per_decade: int = 12) -> NDArray[np.int64]:
    """Averaging factors up to a third of the record, evenly spaced in the logarithm."""
    top = max(1, n // 3)
    count = max(2, int(np.ceil(np.log10(top) * per_decade)) + 1) if top > 1 else 1
    return np.unique(np.round(np.geomspace(1, top, count)).astype(np.int64))


def overlapping_variance(y: Array, m: NDArray[np.int64]) -> Array:
    """Overlapping Allan variance of `y` at averaging factors `m` (eq. (11) of [1]_).

    Parameters
    ----------
    y : ndarray, shape (n,)
        Samples of the rate.
    m : ndarray of int, shape (k,)
        Averaging factors, ``2 m <= n``.
    """
    x = np.concatenate([[0.0], np.cumsum(y - y.mean())])
    out = np.empty(m.size)
    for i, k in enumerate(m.tolist()):
        d = x[2 * k :] - 2.0 * x[k:-k] + x[: -2 * k]
        out[i] = float(d @ d) / (2.0 * k * k * d.size)
    return out


def degrees_of_freedom(n: int, m: Array, slope: Array) -> Array:
    """Equivalent degrees of freedom, by the kind of noise that the slope of the curve shows.

    Parameters
    ----------
    n : int
        Number of samples.
    m : ndarray, shape (k,)
        Averaging factors.
    slope : ndarray, shape (k,)
        Local slope of ``log AVAR`` against ``log tau``: -2 phase noise, -1 white, 0 flicker, +1 walk.
    """
    m = np.asarray(m, dtype=np.float64)
    white = (3.0 * (n - 1) / (2 * m) - 2.0 * (n - 2) / n) * 4 * m**2 / (4 * m**2 + 5)
    flicker = np.where(m == 1, 2.0 * (n - 2) / (2.3 * n - 4.9), 5.0 * n**2 / (4 * m * (n + 3 * m)))
    flicker = np.where(m == 1, flicker * n / 2.0, flicker)
    walk = (n - 2) / m * ((n - 1) ** 2 - 3 * m * (n - 1) + 4 * m**2) / max(n - 3, 1) ** 2
    edf = np.where(slope < -0.5, white, np.where(slope < 0.5, flicker, walk))
    return np.asarray(np.maximum(edf, 1.0))


def allan_curve(y: Array, dt: float, factors: NDArray[np.int64] | None = None) -> AllanCurve:
    """The overlapping Allan deviation of a record.

    Parameters
    ----------
    y : ndarray, shape (n,)
        Samples [U].
    dt : float
        Sampling period [s].
    factors : ndarray of int, optional
        Averaging factors.

    Raises
    ------
    InputError
        Fewer than 9 samples.
    """
    from scipy.stats import chi2

    if y.size < 9:
        raise InputError(f"{y.size} samples give no Allan deviation", remedy="Log at least 9 samples")
    m = log_factors(y.size) if factors is None else factors
    avar = np.maximum(overlapping_variance(y, m), np.finfo(float).tiny)
    tau = m * dt
    slope = np.gradient(np.log(avar), np.log(tau)) if m.size > 1 else np.full(1, -1.0)
    edf = degrees_of_freedom(y.size, m.astype(float), slope)
    ends = [np.asarray(np.sqrt(avar * edf / chi2.ppf(p, edf)), dtype=np.float64) for p in (0.975, 0.025)]
    return AllanCurve(np.asarray(tau, dtype=np.float64), np.sqrt(avar), ends[0], ends[1], edf)
