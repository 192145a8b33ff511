"""Estimators of AR, MA and ARMA processes, by name: each one small class over a library.

To add one, write a subclass of `Estimator`; `estimators` finds it.

References
----------
.. [1] M. Narasimhappa, Modeling of inertial rate sensor errors using ARMA models, 2019, sec. 2.2.
.. [2] P. J. Brockwell and R. A. Davis, Time Series: Theory and Methods, 2nd ed., 1991, secs 8.1-8.7.
.. [3] S. M. Kay, Modern Spectral Estimation, 1988, sec. 10.4 (modified Yule-Walker).
"""

from __future__ import annotations

import warnings
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from kfgen.arma.library import statsmodels
from kfgen.arma.process import Arma, autocovariance_of, spectral_factor
from kfgen.core.errors import InputError

Array = NDArray[np.float64]

MIN_SAMPLES_PER_COEFFICIENT = 10
"""Samples for each coefficient."""
EQUATIONS_PER_COEFFICIENT = 4
"""Equations for each coefficient in the modified Yule-Walker method."""


@dataclass(frozen=True)
class Estimator(ABC):
    """A way to estimate a process from a series without mean.

    Attributes
    ----------
    name, title : str
    of : tuple of str
        What it can estimate: ``ar``, ``ma``, ``arma``.
    """

    name: ClassVar[str] = ""
    title: ClassVar[str] = ""
    of: ClassVar[tuple[str, ...]] = ("ar",)

    @abstractmethod
    def solve(self, y: Array, p: int, q: int) -> tuple[Array, Array, float]:
        """The process of a given order that fits a series.

        Parameters
        ----------
        y : ndarray, shape (n,)
            The series without its mean, of unit root mean square.
        p, q : int
            Orders of the autoregression and of the moving average.

        Returns
        -------
        phi : ndarray, shape (p,)
            Coefficients of the output's past.
        theta : ndarray, shape (q,)
            Coefficients of the noise's past.
        sigma : float
            Standard deviation of the white noise.
        """


def kind(p: int, q: int) -> str:
    """Which kind of process an order is.

    Parameters
    ----------
    p, q : int
        Orders of the autoregression and of the moving average.

    Returns
    -------
    str
        ``ar``, ``ma`` or ``arma``.
    """
    return "arma" if p and q else "ma" if q else "ar"


def sample_autocovariance(y: Array, lags: int) -> Array:
    """Biased sample autocovariance of a series without mean: positive semidefinite.

    Parameters
    ----------
    y : ndarray, shape (n,)
        Samples [U].
    lags : int
        The largest lag [samples].

    Returns
    -------
    ndarray, shape (lags + 1,)
        At lags 0 to `lags` [U^2].
    """
    return np.asarray(
        statsmodels("tsa.stattools").acovf(y, nlag=lags, fft=True, demean=False), dtype=np.float64
    )


@dataclass(frozen=True)
class YuleWalker(Estimator):
    """The autocovariances at lags 0 to p, eq. (8.1.3) of [2]_."""

    name: ClassVar[str] = "yule-walker"
    title: ClassVar[str] = "Yule-Walker equations"

    def solve(self, y: Array, p: int, q: int) -> tuple[Array, Array, float]:
        """By statsmodels."""
        phi, sigma = statsmodels("regression.linear_model").yule_walker(y, p, method="mle", demean=False)
        return np.asarray(phi), np.zeros(0), float(sigma)


@dataclass(frozen=True)
class LevinsonDurbin(Estimator):
    """The same equations by Levinson's recursion, eqs (8.2.2)-(8.2.5) of [2]_."""

    name: ClassVar[str] = "levinson-durbin"
    title: ClassVar[str] = "Levinson-Durbin recursion"

    def solve(self, y: Array, p: int, q: int) -> tuple[Array, Array, float]:
        """By statsmodels."""
        gamma = sample_autocovariance(y, p)
        variance, phi, *_ = statsmodels("tsa.stattools").levinson_durbin(gamma, nlags=p, isacov=True)
        return np.asarray(phi), np.zeros(0), float(np.sqrt(variance))


@dataclass(frozen=True)
class Burg(Estimator):
    """Forward and backward prediction errors, eqs (8.2.8)-(8.2.12) of [2]_."""

    name: ClassVar[str] = "burg"
    title: ClassVar[str] = "Burg's method"

    def solve(self, y: Array, p: int, q: int) -> tuple[Array, Array, float]:
        """By statsmodels."""
        phi, variance = statsmodels("regression.linear_model").burg(y, p, demean=False)
        return np.asarray(phi), np.zeros(0), float(np.sqrt(variance))


@dataclass(frozen=True)
class LeastSquares(Estimator):
    """Unconstrained least squares; of an ARMA on the residuals of a long AR (Hannan and Rissanen)."""

    name: ClassVar[str] = "least-squares"
    title: ClassVar[str] = "unconstrained least squares"
    of: ClassVar[tuple[str, ...]] = ("ar", "ma", "arma")

    def solve(self, y: Array, p: int, q: int) -> tuple[Array, Array, float]:
        """By statsmodels."""
        module = statsmodels("tsa.arima.estimators.hannan_rissanen")
        found, _ = module.hannan_rissanen(y, p, q, demean=False, unbiased=False)
        return np.asarray(found.ar_params), np.asarray(found.ma_params), float(np.sqrt(found.sigma2))


@dataclass(frozen=True)
class Innovations(Estimator):
    """The innovations algorithm of a moving average, eq. (8.3.3) of [2]_."""

    name: ClassVar[str] = "innovations"
    title: ClassVar[str] = "innovations algorithm"
    of: ClassVar[tuple[str, ...]] = ("ma",)

    def solve(self, y: Array, p: int, q: int) -> tuple[Array, Array, float]:
        """By statsmodels."""
        found, _ = statsmodels("tsa.arima.estimators.innovations").innovations(y, q, demean=False)
        return np.zeros(0), np.asarray(found[-1].ma_params), float(np.sqrt(found[-1].sigma2))


@dataclass(frozen=True)
class ModifiedYuleWalker(Estimator):
    """Autocovariances beyond lag q give the autoregression, the remainder's spectral factor the average [3]_."""

    name: ClassVar[str] = "modified-yule-walker"
    title: ClassVar[str] = "modified Yule-Walker equations"
    of: ClassVar[tuple[str, ...]] = ("ar", "ma", "arma")

    def solve(self, y: Array, p: int, q: int) -> tuple[Array, Array, float]:
        """No library that is kept up has it: a Toeplitz system beyond lag q, then the factor."""
        from scipy.linalg import lstsq
        from scipy.signal import lfilter

        m = EQUATIONS_PER_COEFFICIENT * p
        gamma = sample_autocovariance(y, q + m + p)
        T = np.array([[gamma[abs(q + i - j)] for j in range(1, p + 1)] for i in range(1, m + 1)])
        phi = lstsq(T, gamma[q + 1 : q + m + 1])[0] if p else np.zeros(0)
        rest = np.asarray(lfilter([1.0, *(-phi)], [1.0], y))[p:]
        e = spectral_factor(sample_autocovariance(rest, q).tolist())
        return phi, np.array(e[1:]) / e[0], e[0]


@dataclass(frozen=True)
class MaximumLikelihood(Estimator):
    """The exact Gaussian likelihood through the innovations, eq. (8.7.4) of [2]_."""

    name: ClassVar[str] = "ml"
    title: ClassVar[str] = "maximum likelihood"
    of: ClassVar[tuple[str, ...]] = ("ar", "ma", "arma")

    def solve(self, y: Array, p: int, q: int) -> tuple[Array, Array, float]:
        """By statsmodels."""
        module = statsmodels("tsa.arima.estimators.innovations")
        found, _ = module.innovations_mle(y, order=(p, 0, q), demean=False)
        return np.asarray(found.ar_params), np.asarray(found.ma_params), float(np.sqrt(found.sigma2))


def estimators() -> dict[str, type[Estimator]]:
    """Every estimator by its name."""
    return {cls.name: cls for cls in Estimator.__subclasses__()}


def estimate(y: Array, p: int, q: int, method: str = "ml") -> Arma:
    """Estimate an ARMA process from a series.

    Parameters
    ----------
    y : ndarray, shape (n,)
        The series [U], its mean removed.
    p, q : int
        Orders of the autoregression and of the moving average.
    method : str
        A key of `estimators`.

    Returns
    -------
    Arma

    Raises
    ------
    InputError
        An unknown method or one for other processes, a series too short or constant, or coefficients that
        no stationary process has.
    """
    known = estimators()
    if method not in known:
        raise InputError(f"there is no estimator '{method}'", remedy=f"Known are {', '.join(known)}")
    if kind(p, q) not in known[method].of:
        able = [n for n, c in known.items() if kind(p, q) in c.of]
        raise InputError(
            f"{method} estimates no process of order ({p}, {q})", remedy=f"These do: {', '.join(able)}"
        )
    if y.size < MIN_SAMPLES_PER_COEFFICIENT * (p + q + 1):
        raise InputError(
            f"{y.size} samples are too few for a process of order ({p}, {q})",
            remedy=f"Give at least {MIN_SAMPLES_PER_COEFFICIENT * (p + q + 1)}",
        )
    scale = float(np.sqrt(np.mean(y**2)))
    if not (np.isfinite(scale) and scale > 0.0):
        raise InputError("the series never changes, or is no number", remedy="Check the channel")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of the search: what it ends at is checked
        try:
            phi, theta, sigma = known[method]().solve(y / scale, p, q)
        except (ValueError, np.linalg.LinAlgError) as error:
            raise InputError(f"{method} finds no process of order ({p}, {q}): {error}") from None
    return Arma(tuple(phi.tolist()), tuple(invertible(theta).tolist()), float(sigma * scale))


def invertible(theta: Array) -> Array:
    """The moving average with its roots mirrored into the unit circle, which leaves its autocorrelation as it is."""
    if not theta.size or np.abs(np.roots([1.0, *theta])).max() < 1.0 + 1e-9:
        return theta
    e = spectral_factor(autocovariance_of([1.0, *theta.tolist()], theta.size))
    return np.array(e[1:]) / e[0]
