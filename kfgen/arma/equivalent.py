"""The equivalent ARMA model of a sum of sensor noises, and the sizes of the noises from it.

It is the ARMA process on one white noise that has the same autocovariance as the sum.

Every noise of a sensor is a rational function of the backshift ``q^-1`` on a white noise of its own: white
noise 1, quantisation of the integral ``1 - q^-1``, a Gauss-Markov process ``q^-1 / (1 - alpha q^-1)``, a
random walk ``q^-1 / (1 - q^-1)``. Over their common denominator each becomes a moving average; the
autocovariance of the sum is linear in the variances, ``gamma = L(alpha) s``. The walk's pole is removed by a
difference of the samples, the Gauss-Markov pole is the autoregression. The moving average of the sum is the
spectral factor of gamma.

For white noise and quantisation that is eqs (3)-(6) of [1]_, for white noise, Gauss-Markov and walk its
eqs (12)-(15), without the walk eq. (17).

References
----------
.. [1] E. M. Hemerly, MEMS IMU stochastic error modelling, Systems Science & Control Engineering 5(1), 2017.
.. [2] S. M. Seong, J. G. Lee, C. G. Park, Equivalent ARMA model representation for RLG random errors, IEEE
   TAES 36(1), 2000.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kfgen.arma.process import autocovariance_of, exact_factor
from kfgen.core.errors import InputError

Array = NDArray[np.float64]
Poly = tuple[Any, ...]
"""Coefficients of powers of the backshift, lowest first: numbers or symbols."""


@dataclass(frozen=True)
class Source:
    """One noise as a rational function of the backshift on a white noise.

    Parameters
    ----------
    numerator : tuple
        Coefficients of powers of the backshift, lowest first.
    walk, markov : bool
        Whether it has the pole of a random walk, ``1 - q^-1``, or of a Gauss-Markov process, ``1 - alpha q^-1``.
    """

    numerator: Poly
    walk: bool = False
    markov: bool = False


SOURCES = {
    "white_noise": Source((1,)),
    "quantisation": Source((1, -1)),
    "gauss_markov": Source((0, 1), markov=True),
    "rate_random_walk": Source((0, 1), walk=True),
}
"""The noises by the names of their effects."""


def product(a: Poly, b: Poly) -> Poly:
    """The product of two polynomials in the backshift.

    Parameters
    ----------
    a, b : tuple of number or symbol
        Coefficients, lowest power first.

    Returns
    -------
    tuple, (len(a) + len(b) - 1,)
    """
    out: list[Any] = [0] * (len(a) + len(b) - 1)
    for i, x in enumerate(a):
        for j, y in enumerate(b):
            out[i + j] = out[i + j] + x * y
    return tuple(out)


@dataclass(frozen=True)
class Equivalent:
    """The equivalent ARMA model of a set of noises.

    Parameters
    ----------
    names : tuple of str
        Keys of `SOURCES`.

    Raises
    ------
    InputError
        A noise that is no rational one, or a set whose variances the autocovariance does not determine.
    """

    names: tuple[str, ...]

    def __post_init__(self) -> None:
        for name in self.names:
            if name not in SOURCES:
                raise InputError(
                    f"{name} has no equivalent ARMA model", remedy=f"Those have it: {', '.join(SOURCES)}"
                )
        if len(set(self.names)) < len(self.names) or len(self.names) != self.q + 1:
            raise InputError(
                f"the ARMA model of {', '.join(self.names)} does not tell their sizes",
                remedy="Name each once, and white_noise among them",
            )

    @property
    def differenced(self) -> bool:
        """Whether the samples are differenced first, eq. (12) of [1]_."""
        return any(SOURCES[n].walk for n in self.names)

    @property
    def p(self) -> int:
        """Order of the autoregression."""
        return int(any(SOURCES[n].markov for n in self.names))

    @property
    def q(self) -> int:
        """Order of the moving average."""
        averages = [self.average(n, 0.5) for n in self.names]
        return max(len(c) - 1 - next(i for i, v in enumerate(c) if v) for c in averages)

    def average(self, name: str, alpha: Any) -> Poly:
        """The moving average of one noise over the common denominator, as in eq. (13) of [1]_.

        Parameters
        ----------
        name : str
            One of `names`.
        alpha : number or symbol
            ``exp(-T / tau)`` of the Gauss-Markov process.

        Returns
        -------
        tuple
            Coefficients of powers of the backshift, lowest first.
        """
        source = SOURCES[name]
        out = source.numerator
        if self.p and not source.markov:
            out = product(out, (1, -alpha))
        if self.differenced and not source.walk:
            out = product(out, (1, -1))
        return out

    def rows(self, alpha: Any) -> list[list[Any]]:
        """``L`` with ``gamma = L s``: lags 0 to q down, noises across; of a number or a symbol alpha."""
        columns = [autocovariance_of(self.average(n, alpha), self.q) for n in self.names]
        return [[c[k] for c in columns] for k in range(self.q + 1)]

    def moving_average(self, alpha: Any, variances: Sequence[float]) -> list[Any]:
        """``e_0 ... e_q`` [U] of noises with these variances [U^2], in numbers of mpmath.

        Parameters
        ----------
        alpha : number
            ``exp(-T / tau)``; without a Gauss-Markov process of no effect.
        variances : sequence of float
            Of the white noise inside each of `names` [U^2].

        Returns
        -------
        list of number, (q + 1,)
        """
        import mpmath

        with mpmath.workdps(60):
            rows = self.rows(mpmath.mpf(alpha))
            gamma = [mpmath.fsum(a * mpmath.mpf(s) for a, s in zip(row, variances)) for row in rows]
        return exact_factor(gamma)

    def variances(self, alpha: float, e: Sequence[Any]) -> list[float]:
        """The variances of the noises from the moving average of their sum: eq. (16) of [1]_ with its sign corrected.

        Parameters
        ----------
        alpha : float
            ``exp(-T / tau)``.
        e : sequence of number, (q + 1,)
            Moving average of the sum [U].

        Returns
        -------
        list of float
            Variance [U^2] of the white noise inside each of `names`; a negative one means that there is none.
        """
        import mpmath

        with mpmath.workdps(60):
            gamma = autocovariance_of([mpmath.mpf(v) for v in e], self.q)
            s = mpmath.lu_solve(mpmath.matrix(self.rows(mpmath.mpf(alpha))), mpmath.matrix(gamma))
            return [float(v) for v in s]


MARKOV_WHITE_WALK = Equivalent(("gauss_markov", "white_noise", "rate_random_walk"))
"""B, N and K of [1]_, sec. 2.1, in the order of its sigma_1, sigma_2, sigma_3."""


def condition(tau: float, T: float) -> float:
    """Condition number of M in eq. (16) of [1]_.

    M is what is left of L for the Gauss-Markov process and the walk after the white noise is known.

    Parameters
    ----------
    tau : float
        Correlation time [s].
    T : float
        Sampling period [s].

    Returns
    -------
    float
    """
    L = np.array(MARKOV_WHITE_WALK.rows(float(np.exp(-T / tau))), dtype=np.float64)
    return float(np.linalg.cond(L[:2, [0, 2]]))
