"""Does the record disagree with the model, and where: tests with one family-wise rate.

Under the right model every ordinate of the sine transform over its expectation is an independent
chi-square of one degree of freedom, and the white series in time is normal and independent. So the power
in each band and in each cell of an atlas (a stretch of time, a band) is a chi-square, the regression on a
driver, on any other channel or on time a normal deviate, and so is that of the squares, the largest ordinate an
exponential; skewness, kurtosis and the correlation of squares have their own laws. All p values are held together by Holm's method [1]_.

References
----------
.. [1] S. Holm, A simple sequentially rejective multiple test procedure, Scand. J. Statist. 6, 1979.
.. [2] A. I. McLeod and W. K. Li, Diagnostic checking ARMA time series models using squared-residual
   autocorrelations, J. Time Series Analysis 4(4), 1983.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from kfgen.effects import Effect, catalogue
from kfgen.effects.driven.noise_level import followed
from kfgen.effects.driven.proportional import DRIVERS
from kfgen.effects.series import WhiteSeries
from kfgen.identify.evidence.record import Record
from kfgen.identify.evidence.whittle import Ordinates, residual_ratio

Array = NDArray[np.float64]

FALSE_ALARM_RATE = 0.001
"""Family-wise false alarm rate of the battery."""
BANDS_PER_DECADE = 3
ATLAS_STRETCHES = 8
"""Of the atlas."""
SQUARE_LAGS = 20
"""At which squares are correlated."""
BAND_POWER_SHARE = 0.9
"""Share of a regressor's power below the band that is said of it."""
MIN_CELL_ORDINATES = 24
"""Ordinates that a cell of the atlas has at least."""


@dataclass(frozen=True)
class Test:
    """One test: what it looked at, where, its adjusted p value and the ratio of powers found.

    Parameters
    ----------
    span : (float, float), optional
        Time [s] from the first sample on, where it is not the whole record.
    other : str
        The channel that it was held against, of which no effect is known.
    channel : str
        That was tested.
    """

    name: str
    p: float
    band_hz: tuple[float, float]
    ratio: float
    span: tuple[float, float] | None = None
    other: str = ""
    channel: str = ""

    @property
    def significant(self) -> bool:
        """At the family-wise rate."""
        return self.p < FALSE_ALARM_RATE


def battery(
    record: Record, effects: Sequence[Effect], coefficients: Array, series: WhiteSeries
) -> list[Test]:
    """All tests on what the model leaves of a record, by adjusted p value.

    Parameters
    ----------
    record : Record
    effects : sequence of Effect
        The model, with its deterministic effects' `coefficients` in order.
    series : Series
        What the model makes of the record.
    """
    data = record.ordinates(effects)
    ratio = residual_ratio(data, effects, coefficients)
    measured = (e.variance_of_measured(data.frequency, record.duration) for e in effects)
    variance = sum(measured, np.ones(data.omega.size))
    tests = [_band(data, ratio, variance, lo, hi) for lo, hi in bands(data)]
    for name, cls in catalogue().items():
        shown = cls.starts(record.look)
        if shown and cls.coefficients() and not any(e.name == name for e in effects):
            tests.append(_driven(record, effects, coefficients, shown[0]))
    tests += [_followed(series, name) for name in series.drive if name not in DRIVERS]
    tests += [_louder(series, name) for name in series.drive]
    return holm([*tests, *white_tests(series.z, series.dt, series.X)])


def bands(data: Ordinates) -> list[tuple[int, int]]:
    """Slices of the bins into bands evenly spaced in the logarithm of frequency."""
    decades = np.log10(data.omega[-1] / data.omega[0]) if data.omega.size > 1 else 0.0
    edges = np.geomspace(data.omega[0], data.omega[-1], max(2, int(decades * BANDS_PER_DECADE) + 1))
    at = np.unique(np.concatenate([[0], np.searchsorted(data.omega, edges[1:-1]), [data.omega.size]]))
    return list(zip(at[:-1].tolist(), at[1:].tolist()))


def _band(data: Ordinates, ratio: Array, variance: Array, lo: int, hi: int) -> Test:
    """Of a mean of ordinates, each of which counts the less the worse its expectation is known."""
    f, count = data.frequency, data.count[lo:hi]
    mean = float(count @ ratio[lo:hi] / count.sum())
    m = float(count.sum() ** 2 / (count @ variance[lo:hi]))
    return Test("power", chance_of(mean * m, m), (float(f[lo]), float(f[hi - 1])), mean)


def chance_of(total: float, m: float) -> float:
    """Two-sided p value of a chi-square of m degrees of freedom.

    Parameters
    ----------
    total : float
        Power found: a sum of squares of unit normal deviates.
    m : float
        Its degrees of freedom.
    """
    from scipy.stats import chi2

    return min(2.0 * min(float(chi2.sf(total, m)), float(chi2.cdf(total, m))), 1.0)


def _driven(record: Record, effects: Sequence[Effect], coefficients: Array, effect: Effect) -> Test:
    """Regression of the residual on a deterministic effect."""
    from scipy.stats import norm

    data = record.ordinates([*effects, effect])
    held = np.append(coefficients, 0.0)
    base = data.log_likelihood(effects, held).value
    best = data.log_likelihood(effects).value
    z = np.sqrt(max(2.0 * (best - base), 0.0))
    f = data.frequency
    return Test(effect.title, float(2.0 * norm.sf(z)), (0.0, float(f[min(5, f.size - 1)])), 1.0 + z**2)


def _followed(series: WhiteSeries, name: str) -> Test:
    """Regression of the white series on another channel, of which no effect is known."""
    from scipy.stats import norm

    z, u = series.regression(series.drive[name])
    share = np.cumsum(u**2) / max(float(u @ u), 1e-300)
    last = int(np.searchsorted(share, BAND_POWER_SHARE))
    p = float(2.0 * norm.sf(abs(z)))
    band = (0.0, 0.5 * last / (series.n * series.dt))
    return Test(f"regression on {name}", p, band, 1.0 + z**2, other=name)


def _louder(series: WhiteSeries, name: str) -> Test:
    """Regression of the squares of the white series on a channel: noise whose level follows it."""
    from scipy.stats import norm

    z = followed(series, series.drive[name])
    return Test(f"noise level on {name}", float(2.0 * norm.sf(abs(z))), (0.0, 0.5 / series.dt), 1.0 + z**2)


def white_tests(z: Array, dt: float, X: Array) -> list[Test]:
    """Tests of a series that should be white and normal, shape (n,), with its cosine ordinates.

    Parameters
    ----------
    z : ndarray, shape (n,)
        White series in time, of unit variance.
    dt : float
        Sampling period [s].
    X : ndarray, shape (n,)
        Its cosine transform.
    """
    whole = (0.0, 0.5 / dt)
    return [*_atlas(z, dt), _line(X, dt), _tails(z, whole), _skewed(z, whole), _squares(z, whole)]


def _atlas(z: Array, dt: float) -> list[Test]:
    """Power in stretches of time and octaves of frequency."""
    from scipy.fft import dct

    size, tests = z.size // ATLAS_STRETCHES, []
    if size < 2 * MIN_CELL_ORDINATES:
        return []
    edges = [1]
    while edges[-1] < size:
        edges.append(min(max(2 * edges[-1], edges[-1] + MIN_CELL_ORDINATES), size))
    for k in range(ATLAS_STRETCHES):
        X2 = dct(z[k * size : (k + 1) * size], type=2, norm="ortho") ** 2
        span = (k * size * dt, (k + 1) * size * dt)
        for lo, hi in pairwise(edges):
            total, m = float(X2[lo:hi].sum()), float(hi - lo)
            band = (0.5 * lo / (size * dt), 0.5 * hi / (size * dt))
            tests.append(Test("power in a stretch", chance_of(total, m), band, total / m, span))
    return tests


def _line(X: Array, dt: float) -> Test:
    """The largest ordinate, of a chi-square of one degree of freedom each."""
    from scipy.stats import chi2

    k = int(np.argmax(X**2))
    top = float(X[k] ** 2)
    p = -float(np.expm1(X.size * np.log1p(-min(float(chi2.sf(top, 1)), 0.5))))
    f = 0.5 * k / (X.size * dt)
    return Test("periodic line" if k else "constant offset", p, (f, f), top)


def _tails(z: Array, whole: tuple[float, float]) -> Test:
    from scipy.stats import kurtosis, kurtosistest

    p = float(kurtosistest(z).pvalue) if z.size >= 20 else 1.0
    return Test("tails", p, whole, 1.0 + float(kurtosis(z)) / 3.0)


def _skewed(z: Array, whole: tuple[float, float]) -> Test:
    from scipy.stats import skew, skewtest

    p = float(skewtest(z).pvalue) if z.size >= 20 else 1.0
    return Test("skewness", p, whole, 1.0 + abs(float(skew(z))))


def _squares(z: Array, whole: tuple[float, float]) -> Test:
    """Correlation of neighbouring squares [2]_."""
    from scipy.stats import chi2

    q = z**2 - np.mean(z**2)
    power = max(float(q @ q), 1e-300)
    r = np.array([float(q[k:] @ q[:-k]) / power for k in range(1, min(SQUARE_LAGS, z.size // 4) + 1)])
    n = z.size
    total = float(n * (n + 2) * np.sum(r**2 / (n - np.arange(1, r.size + 1))))
    return Test("correlated squares", float(chi2.sf(total, r.size)), whole, 1.0 + float(r.max(initial=0.0)))


def holm(tests: Sequence[Test]) -> list[Test]:
    """The tests by adjusted p value [1]_."""
    ordered = sorted(tests, key=lambda t: t.p)
    adjusted, floor = [], 0.0
    for i, test in enumerate(ordered):
        floor = max(floor, min(1.0, test.p * (len(ordered) - i)))
        adjusted.append(replace(test, p=floor))
    return adjusted
