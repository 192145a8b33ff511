"""Overlapping Allan deviation with confidence bands.

References
----------
.. [1] W. J. Riley, Handbook of Frequency Stability Analysis, NIST SP 1065, 2008,
   eqs (11)-(12) and, for the degrees of freedom, table 5 (Howe, Allan and Barnes 1981).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kfgen.errors import InputError

Array = NDArray[np.float64]


EXACT = 2_000_000
"""Samples up to which every difference is taken at every factor."""
DECIMATE = 128
CHUNK = 1 << 13
"""Small enough for the cache, and for a dot product that no library splits over threads."""


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
    """Averaging factors up to a third of the record, evenly spaced in the logarithm.

    From `DECIMATE` on they are multiples of their stride, so that a long record can be thinned.
    """
    top = max(1, n // 3)
    count = max(2, int(np.ceil(np.log10(top) * per_decade)) + 1) if top > 1 else 1
    m = np.round(np.geomspace(1, top, count)).astype(np.int64)
    stride = np.array([_stride(k) for k in m.tolist()])
    return np.unique(m // stride * stride)


def octave_factors(n: int) -> NDArray[np.int64]:
    """Averaging factors at octaves up to a sixth of the record: beyond, a point says too little."""
    return 2 ** np.arange(max(1, int(np.log2(max(n, 12) / 6)) + 1), dtype=np.int64)


def _stride(m: int) -> int:
    """The power of two that leaves between half of `DECIMATE` and `DECIMATE` steps in m."""
    return 1 << max(0, m.bit_length() - DECIMATE.bit_length() + 1) if m >= DECIMATE else 1


def overlapping_variance(y: Array, m: NDArray[np.int64]) -> Array:
    """Overlapping Allan variance of `y` at averaging factors `m` (eq. (11) of [1]_).

    Records beyond `EXACT` samples are thinned at large factors: differences are then taken at every
    ``m / 64``-th sample or denser, which changes the variance by less than 1 % of itself, far below its
    statistical error.

    Parameters
    ----------
    y : ndarray, shape (n,)
        Samples of the rate.
    m : ndarray of int, shape (k,)
        Averaging factors, ``2 m <= n``.
    """
    x = np.concatenate([[0.0], np.cumsum(y - y.mean())])
    out, stride = np.empty(m.size), 1
    buffer = np.empty(CHUNK)
    for i, k in enumerate(m.tolist()):
        wanted = _stride(k)
        if y.size > EXACT and wanted > stride and k % wanted == 0:
            x, stride = x[:: wanted // stride].copy(), wanted
        step = k // stride if k % stride == 0 else 0
        source = x if step else np.concatenate([[0.0], np.cumsum(y - y.mean())])
        out[i] = _second_differences(source, step or k, buffer) / (2.0 * k * k)
    return out


def _second_differences(x: Array, m: int, buffer: Array) -> float:
    """Mean square of ``x[i + 2 m] - 2 x[i + m] + x[i]``, by chunks that stay in the cache."""
    count, total = x.size - 2 * m, 0.0
    for start in range(0, count, CHUNK):
        stop = min(start + CHUNK, count)
        d = buffer[: stop - start]
        np.subtract(x[start + 2 * m : stop + 2 * m], x[start + m : stop + m], out=d)
        d -= x[start + m : stop + m]
        d += x[start:stop]
        total += float(d @ d)
    return total / count


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
    flicker = np.where(m == 1, flicker * (n - 2), flicker)
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


def pooled(curves: Sequence[AllanCurve]) -> AllanCurve:
    """One curve from several of one sensor, each a beginning of the longest one's averaging times.

    Variances are weighted by their equivalent degrees of freedom, which add up.
    """
    from scipy.stats import chi2

    tau = max((c.tau for c in curves), key=len)
    edf, total = np.zeros(tau.size), np.zeros(tau.size)
    for c in curves:
        edf[: c.tau.size] += c.edf
        total[: c.tau.size] += c.edf * c.deviation**2
    avar = total / edf
    lo, hi = (np.asarray(np.sqrt(avar * edf / chi2.ppf(p, edf))) for p in (0.975, 0.025))
    return AllanCurve(tau, np.sqrt(avar), lo, hi, edf)
