"""Overlapping Allan deviation with confidence bands.

References
----------
.. [1] W. J. Riley, Handbook of Frequency Stability Analysis, NIST SP 1065, 2008,
   eqs (11)-(12) and, for the degrees of freedom, table 5 (Howe, Allan and Barnes 1981).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from kfgen.core.errors import InputError
from kfgen.identify.evidence.running_allan import (
    MAX_SAMPLES_EXACT,
    MAX_STEPS_IN_FACTOR,
    Array,
    Factors,
    Phase,
    Samples,
    stride,
    variance_of_chunks,
)

__all__ = [
    "MAX_SAMPLES_EXACT",
    "MAX_STEPS_IN_FACTOR",
    "AllanCurve",
    "allan_curve",
    "curve_from_variance",
    "curve_of_chunks",
    "degrees_of_freedom",
    "log_factors",
    "octave_factors",
    "overlapping_variance",
    "pooled",
    "variance_of_chunks",
]

MORE_SAMPLES_THAN_ANY_STREAM = 10**13
"""Samples that no stream has: a year at 300 kHz."""


@dataclass(frozen=True)
class AllanCurve:
    """An Allan deviation.

    Parameters
    ----------
    tau : ndarray, shape (m,)
        Averaging times [s].
    deviation, lo, hi : ndarray, shape (m,)
        Allan deviation [U] and its 95 % band.
    edf : ndarray, shape (m,)
        Equivalent degrees of freedom of each point.
    """

    tau: Array
    deviation: Array
    lo: Array
    hi: Array
    edf: Array


def log_factors(n: int, per_decade: int = 12) -> Factors:
    """Averaging factors up to a third of the record, evenly spaced in the logarithm.

    From `MAX_STEPS_IN_FACTOR` on they are multiples of their stride, so that a long record can be thinned.

    Parameters
    ----------
    n : int
        Samples of the record.
    per_decade : int
        Factors in a decade.

    Returns
    -------
    ndarray of int, shape (m,)
    """
    top = max(1, n // 3)
    count = max(2, int(np.ceil(np.log10(top) * per_decade)) + 1) if top > 1 else 1
    m = np.round(np.geomspace(1, top, count)).astype(np.int64)
    strides = np.array([stride(k) for k in m.tolist()])
    return np.unique(m // strides * strides)


def octave_factors(n: int) -> Factors:
    """Averaging factors at octaves up to a sixth of the record: beyond, a point says too little."""
    return 2 ** np.arange(max(1, int(np.log2(max(n, 12) / 6)) + 1), dtype=np.int64)


def overlapping_variance(y: Samples, m: Factors) -> Array:
    """Overlapping Allan variance of `y` at averaging factors `m` (eq. (11) of [1]_).

    Records beyond `MAX_SAMPLES_EXACT` samples are thinned at factors from `MAX_STEPS_IN_FACTOR` on: differences are then taken at every
    ``m / 64``-th sample or denser. In white noise and slower ones that changes the variance by less than a
    tenth of its statistical error (1 % of itself up to a fiftieth of the record); in quantisation noise,
    whose neighbouring differences are independent, by less than half of it.

    Parameters
    ----------
    y : ndarray, shape (n,)
        Samples of the rate [U].
    m : ndarray of int, shape (k,)
        Averaging factors, ``2 m <= n``.
    """
    return variance_of_chunks([y], m, y.size)


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


def allan_curve(y: Samples, dt: float, factors: Factors | None = None) -> AllanCurve:
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
        Fewer than 9 samples, or one that is not a number.
    """
    return curve_of_chunks([y], dt, y.size, factors)


def curve_of_chunks(
    chunks: Iterable[Samples], dt: float, n: int | None = None, factors: Factors | None = None
) -> AllanCurve:
    """The overlapping Allan deviation of a stream, in one pass and with bounded memory.

    Parameters
    ----------
    chunks : iterable of ndarray, shape (any,)
        Samples [U] one after the other, in pieces of any length.
    dt : float
        Sampling period [s].
    n : int, optional
        Samples in all. Not known: factors are then the spaced ones up to a third of those that came.
    factors : ndarray of int, optional
        Averaging factors; those beyond half of the record are left out.

    Raises
    ------
    InputError
        Fewer than 9 samples, another number than was said, or one that is not a number.
    """
    m = log_factors(MORE_SAMPLES_THAN_ANY_STREAM if n is None else n) if factors is None else factors
    phase = Phase(m, n)
    for chunk in chunks:
        phase.add(chunk)
    if phase.n < 9:
        raise InputError(f"{phase.n} samples give no Allan deviation", remedy="Log at least 9 samples")
    avar = phase.variance()
    fits = m <= phase.n // (3 if factors is None else 2)
    return curve_from_variance(avar[fits], phase.n, m[fits], dt)


def curve_from_variance(avar: Array, n: int, m: Factors, dt: float) -> AllanCurve:
    """Allan deviation and bands from the overlapping Allan variance.

    Parameters
    ----------
    avar : ndarray, shape (k,)
        Variance [U^2].
    n : int
        Number of samples.
    m : ndarray of int, shape (k,)
        Averaging factors.
    dt : float
        Sampling period [s].
    """
    from scipy.stats import chi2

    avar = np.maximum(avar, np.finfo(float).tiny)
    tau = m * dt
    slope = np.gradient(np.log(avar), np.log(tau)) if m.size > 1 else np.full(1, -1.0)
    edf = degrees_of_freedom(n, m.astype(float), slope)
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
