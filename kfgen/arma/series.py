"""Tests of a series, its correlations, and the order of its model by Akaike's criterion.

References
----------
.. [1] M. Narasimhappa, Modeling of inertial rate sensor errors using ARMA models, 2019, sec. 2 (where a normal
   series is given the kurtosis 1; it has 3).
.. [2] J. S. Bendat and A. G. Piersol, Random Data, 4th ed., 2010, secs 4.5.2, 10.3.1.
.. [3] H. Akaike, A new look at the statistical model identification, IEEE TAC 19(6), 1974.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kfgen.arma.estimate import estimate, sample_autocovariance
from kfgen.arma.library import statsmodels
from kfgen.arma.process import Arma
from kfgen.core.errors import InputError
from kfgen.core.units import MAX_QUANTITY

Array = NDArray[np.float64]

MIN_TEST_SAMPLES = 200
"""Samples that the tests need."""
POWER_SEGMENTS = 40
"""Segments of a series whose mean squares are compared [2]_."""
FALSE_ALARM_RATE = 0.01
"""False-alarm rate of each test."""
CORRELATION_LAGS = 20
"""Lags of the correlation tests [samples]."""
MAX_ORDER_SAMPLES = 100_000
"""Samples on which the order is chosen; of a longer series the first so many."""


@dataclass(frozen=True)
class SeriesVerdict:
    """One test.

    Parameters
    ----------
    name : str
    null : str
        What holds unless it is rejected.
    statistic, p : float
    rejected : bool
        At `FALSE_ALARM_RATE`.
    """

    name: str
    null: str
    statistic: float
    p: float

    @property
    def rejected(self) -> bool:
        """Whether the null is rejected."""
        return self.p < FALSE_ALARM_RATE


@dataclass(frozen=True)
class SeriesTests:
    """All tests of a series.

    Parameters
    ----------
    verdicts : tuple of Verdict
    skewness, kurtosis : float
        Zero and 3 of a normal series.
    """

    verdicts: tuple[SeriesVerdict, ...]
    skewness: float
    kurtosis: float

    def named(self, name: str) -> SeriesVerdict:
        """The test of that name."""
        return next(v for v in self.verdicts if v.name == name)

    @property
    def unit_root(self) -> bool:
        """Whether a unit root is not rejected: the series may wander."""
        return not self.named("unit root").rejected

    @property
    def stationary(self) -> bool:
        """Whether nothing speaks against it."""
        return not (
            self.unit_root
            or self.named("reverse arrangements").rejected
            or self.named("runs of power").rejected
        )


def series_tests(y: Array) -> SeriesTests:
    """Test a series for randomness, zero mean, normality and stationarity.

    Parameters
    ----------
    y : ndarray, shape (n,)

    Raises
    ------
    InputError
        It is too short, never changes, is no number, or has a size whose square is none.
    """
    from scipy import stats

    if y.size < MIN_TEST_SAMPLES:
        raise InputError(
            f"{y.size} samples are too few for tests", remedy=f"Give at least {MIN_TEST_SAMPLES}"
        )
    if not np.isfinite(y).all() or not np.ptp(y) > 0.0:
        raise InputError("the series never changes, or is no number", remedy="Check the channel")
    if np.abs(y).max() > MAX_QUANTITY:
        raise InputError("the series is beyond anything that is measured", remedy="Check its unit")
    runs = statsmodels("sandbox.stats.runs")
    segments = np.array_split(y, POWER_SEGMENTS)
    means = np.array([s.mean() for s in segments])
    power = np.array([np.mean((s - y.mean()) ** 2) for s in segments])
    z, p_runs = runs.runstest_1samp(y, cutoff="median", correction=False)
    z_power, p_power = runs.runstest_1samp(power, cutoff="median", correction=False)
    zero, normal = stats.ttest_1samp(means, 0.0), stats.jarque_bera(y)
    trend = stats.kendalltau(np.arange(POWER_SEGMENTS), power)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FutureWarning)  # of what a later release returns
        root = statsmodels("tsa.stattools").adfuller(y, maxlag=CORRELATION_LAGS, autolag=None)
        _, q, p_q = statsmodels("tsa.stattools").acf(y, nlags=CORRELATION_LAGS, fft=True, qstat=True)
    return SeriesTests(
        (
            SeriesVerdict("runs", "the samples are independent", float(z), float(p_runs)),
            SeriesVerdict(
                "Ljung-Box",
                f"no correlation up to lag {CORRELATION_LAGS}",
                float(q[-1]),
                float(p_q[-1]),
            ),
            SeriesVerdict("zero mean", "the mean is zero", float(zero.statistic), float(zero.pvalue)),
            SeriesVerdict(
                "normality", "the samples are normal", float(normal.statistic), float(normal.pvalue)
            ),
            SeriesVerdict("unit root", "the series has a unit root", float(root[0]), float(root[1])),
            SeriesVerdict(
                "reverse arrangements", "its power has no trend", float(trend.statistic), float(trend.pvalue)
            ),
            SeriesVerdict("runs of power", "its power is even", float(z_power), float(p_power)),
        ),
        float(stats.skew(y)),
        float(stats.kurtosis(y, fisher=False)),
    )


@dataclass(frozen=True)
class Correlations:
    """Autocorrelation and partial autocorrelation of a series.

    Parameters
    ----------
    acf, pacf : ndarray, shape (k + 1,)
        At lags 0 to k.
    band : float
        Half of the width of the 95 % band of white noise.
    """

    acf: Array
    pacf: Array
    band: float


def correlations(y: Array, lags: int = CORRELATION_LAGS) -> Correlations:
    """The sample correlations of a series, with the 95 % band ``+-1.96 / sqrt(n)`` of white noise.

    Parameters
    ----------
    y : ndarray, shape (n,)
        Samples [U].
    lags : int
        The largest lag [samples].

    Returns
    -------
    Correlations
    """
    tools = statsmodels("tsa.stattools")
    return Correlations(
        np.asarray(tools.acf(y, nlags=lags, fft=True)),
        np.asarray(
            tools.levinson_durbin(sample_autocovariance(y - y.mean(), lags), nlags=lags, isacov=True)[2]
        ),
        1.96 / float(np.sqrt(y.size)),
    )


@dataclass(frozen=True)
class Order:
    """A model that was tried.

    Parameters
    ----------
    model : Arma
    aic : float
        Akaike's criterion per sample, ``ln sigma^2 + 2 d / n`` [3]_.
    """

    model: Arma
    aic: float


def orders(y: Array, most: tuple[int, int] = (3, 2), method: str = "ml") -> list[Order]:
    """The stationary ARMA models up to an order by Akaike's criterion [3]_, the best first.

    Parameters
    ----------
    y : ndarray, shape (n,)
        The series [U], its mean removed; of a long one the first `MAX_ORDER_SAMPLES` are used.
    most : (int, int)
        The largest p and q.
    method : str
        A key of `kfgen.arma.estimate.estimators`.

    Returns
    -------
    list of Order

    Raises
    ------
    InputError
        None can be fitted.
    """
    y = y[:MAX_ORDER_SAMPLES]
    found = []
    for p in range(most[0] + 1):
        for q in range(most[1] + 1):
            if p + q == 0:
                continue
            try:
                model = estimate(y, p, q, method)
            except InputError:
                continue
            found.append(Order(model, float(np.log(model.sigma**2) + 2.0 * (p + q + 1) / y.size)))
    if not found:
        raise InputError(f"no ARMA model up to order {most} fits the series", remedy="Difference it first")
    return sorted(found, key=lambda o: o.aic)
