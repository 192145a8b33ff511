"""`Arma`: a stationary process ``y_k = sum phi_i y_(k-i) + w_k + sum theta_j w_(k-j)``, and spectral factors.

References
----------
.. [1] A. C. Harvey, Forecasting, Structural Time Series Models and the Kalman Filter, 1989, sec. 3.3.
.. [2] P. J. Brockwell and R. A. Davis, Time Series: Theory and Methods, 2nd ed., 1991, secs 3.1, 4.4.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kfgen.core.errors import InputError

Array = NDArray[np.float64]

UNIT_CIRCLE_MARGIN = 1e-6
"""Distance from the unit circle below which a root is on it."""
FACTOR_DIGITS = 60
"""Decimal digits of spectral factors: roots near one another and near one lose half of them."""
ZERO_RELATIVE_TOLERANCE = 1e-40
"""Relative size of a coefficient that is zero."""


@dataclass(frozen=True)
class Arma:
    """A process of order (p, q).

    Parameters
    ----------
    phi : tuple of float, (p,)
        Coefficients of the output's past.
    theta : tuple of float, (q,)
        Coefficients of the noise's past.
    sigma : float
        Standard deviation of the white noise `w` [U].

    Raises
    ------
    InputError
        A root of its autoregression is on the unit circle or outside: nothing stationary obeys it.
    """

    phi: tuple[float, ...]
    theta: tuple[float, ...]
    sigma: float

    def __post_init__(self) -> None:
        values = (*self.phi, *self.theta, self.sigma)
        if not np.isfinite(values).all() or not self.sigma > 0.0:
            raise InputError(
                "the series determines no ARMA process of this order", remedy="Give a lower order"
            )
        largest = self.largest_pole
        if largest >= 1.0 - UNIT_CIRCLE_MARGIN:
            raise InputError(
                f"the ARMA process has a root of size {largest:.6g}, on the unit circle or outside: it is not "
                "stationary",
                remedy="Difference the series, estimate by burg, or give a lower order",
            )

    @property
    def order(self) -> tuple[int, int]:
        """``(p, q)``."""
        return len(self.phi), len(self.theta)

    @property
    def ar(self) -> Array:
        """``1 - phi_1 z - ...``, lowest power first, shape (p + 1,)."""
        return np.array([1.0, *(-v for v in self.phi)])

    @property
    def ma(self) -> Array:
        """``1 + theta_1 z + ...``, lowest power first, shape (q + 1,)."""
        return np.array([1.0, *self.theta])

    @property
    def largest_pole(self) -> float:
        """Size of the largest root of the autoregression in ``1 / z``."""
        return float(np.abs(np.roots(self.ar)).max(initial=0.0))

    @property
    def invertible(self) -> bool:
        """Whether the noise can be had back from the output."""
        return bool(np.abs(np.roots(self.ma)).max(initial=0.0) < 1.0 - UNIT_CIRCLE_MARGIN)

    def density(self, omega: Array) -> Array:
        """Spectral density of the samples ``sigma^2 |ma / ar|^2`` [U^2] at ``omega`` [rad/sample], shape (m,)."""
        z = np.exp(-1j * np.asarray(omega))
        ratio = np.polyval(self.ma[::-1], z) / np.polyval(self.ar[::-1], z)
        return np.asarray(self.sigma**2 * np.abs(ratio) ** 2)

    def state_space(self) -> tuple[Array, Array, Array]:
        """``x_(k+1) = A x_k + r w_(k+1)``, ``y_k = H x_k`` (eq. (3.3.4) of [1]_).

        Returns
        -------
        A : ndarray, shape (m, m)
        r : ndarray, shape (m,)
        H : ndarray, shape (m,)
            With ``m = max(p, q + 1)``.
        """
        m = max(len(self.phi), len(self.theta) + 1)
        A = np.diag(np.ones(m - 1), 1)
        A[: len(self.phi), 0] = self.phi
        r = np.zeros(m)
        r[: len(self.theta) + 1] = self.ma
        return A, r, np.eye(m)[0]


def autocovariance_of(coefficients: Sequence[Any], lags: int) -> list[Any]:
    """Autocovariance ``gamma_k = sum_i c_i c_(i+k)`` of a moving average on unit white noise.

    Parameters
    ----------
    coefficients : sequence of number or symbol, (q + 1,)
        ``c_0 ... c_q`` [U].
    lags : int
        The largest lag [samples].

    Returns
    -------
    list, (lags + 1,)
        At lags 0 to `lags` [U^2].
    """
    c = list(coefficients)
    return [sum((a * b for a, b in zip(c, c[k:])), 0 * c[0]) for k in range(lags + 1)]


def spectral_factor(gamma: Sequence[Any]) -> list[float]:
    """The moving average ``e`` of that autocovariance, with ``e_0 > 0`` and roots inside the unit circle [2]_.

    Parameters
    ----------
    gamma : sequence of number, (q + 1,)
        Autocovariance [U^2] at lags 0 to q; numbers of mpmath keep their digits.

    Returns
    -------
    list of float, (q + 1,)

    Raises
    ------
    InputError
        Roots on the unit circle, or no positive spectrum.
    """
    return [float(v) for v in exact_factor(gamma)]


def exact_factor(gamma: Sequence[Any]) -> list[Any]:
    """As `spectral_factor`, in numbers of mpmath with `FACTOR_DIGITS`."""
    import mpmath

    with mpmath.workdps(FACTOR_DIGITS):
        g = [mpmath.mpf(v) for v in gamma]
        if not g[0] > 0:
            raise InputError("an autocovariance without variance has no spectral factor")
        used = max(k for k, v in enumerate(g) if abs(v) > ZERO_RELATIVE_TOLERANCE * g[0])
        c = [mpmath.mpf(1)]
        if used:
            roots = mpmath.polyroots(
                [*g[used:0:-1], *g[: used + 1]], maxsteps=500, extraprec=4 * FACTOR_DIGITS
            )
            inside = [z for z in roots if abs(z) < 1 - mpmath.mpf(UNIT_CIRCLE_MARGIN) ** 2]
            if len(inside) != used:
                raise InputError(
                    "the moving average has roots on the unit circle: it has no stable factor",
                    remedy="Check that the variances are positive, and that white noise is among the terms",
                )
            for z in inside:
                c = [a - z * b for a, b in zip([*c, mpmath.mpf(0)], [mpmath.mpf(0), *c])]
            c = [mpmath.re(v) for v in c]
        scale = mpmath.sqrt(g[0] / sum(v * v for v in c))
        return [scale * v for v in c] + [mpmath.mpf(0)] * (len(g) - 1 - used)
