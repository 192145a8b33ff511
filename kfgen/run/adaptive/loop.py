"""The one algorithm: a linear Kalman filter of one channel whose P, R and Q a rule scales.

References
----------
.. [1] M. Narasimhappa, Modeling of inertial rate sensor errors using ARMA models, 2019, secs 4-6.
.. [2] G. J. Bierman, Factorization Methods for Discrete Sequential Estimation, 1977 (Joseph's form).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kfgen.arma.loops import compiled
from kfgen.arma.process import Arma
from kfgen.core.errors import InputError
from kfgen.run.adaptive.rules import Bounds, Factors, Rule, Seen, bounded, by_chance

Array = NDArray[np.float64]

WINDOW = 15
"""Innovations of which the mean square is taken (sec. 7.1 of [1]_)."""
FORGETTING = 0.97
"""``b`` of Sage and Husa."""
FEW = 100_000
"""Samples up to which the loop runs as it stands: compiling it takes longer."""
RATIO = 980.0
"""R over Q: 0.098 over 0.0001 in sec. 7.1 of [1]_."""


@dataclass(frozen=True)
class ScalarModel:
    """``x' = A x + w``, ``z = H x + v``; w of covariance Q [U^2], v of variance R [U^2].

    Parameters
    ----------
    A, Q : ndarray, shape (m, m)
    H : ndarray, shape (m,)
    R : float

    Raises
    ------
    InputError
        R is not positive: the covariance of an innovation may be singular.
    """

    A: Array
    Q: Array
    H: Array
    R: float

    def __post_init__(self) -> None:
        if not (np.isfinite(self.R) and self.R > 0.0):
            raise InputError(
                f"a measurement noise of variance {self.R:g} leaves the innovation covariance singular",
                remedy="Give a positive R",
            )
        least = float(np.linalg.eigvalsh(self.Q)[0])
        if not np.isfinite(self.Q).all() or least < -1e-9 * float(np.trace(self.Q)):
            raise InputError("Q is no covariance", remedy="Give a positive semidefinite Q")

    @staticmethod
    def of(process: Arma, ratio: float = RATIO) -> ScalarModel:
        """An ARMA process as the state, measured with its own noise's variance as R and that over `ratio` as Q."""
        A, r, H = process.state_space()
        return ScalarModel(A, process.sigma**2 / ratio * np.outer(r, r), H, process.sigma**2)


@dataclass(frozen=True)
class Filtered:
    """A filtered channel.

    Parameters
    ----------
    estimate, nis, r, fade, q : ndarray, shape (n,)
        ``H x`` after each sample [U], the normalised squared innovation (zero where a sample was no number), and
        the factors on R, P and Q.
    gain : ndarray, shape (m,)
        Mean gain over the second half.
    least : float
        Smallest pivot of P over its largest entry, ever: P was positive definite all along if it is positive.
    """

    estimate: Array
    nis: Array
    r: Array
    fade: Array
    q: Array
    gain: Array
    least: float


def _least_pivot(P: Array) -> float:
    """The smallest pivot of ``L D L'`` over the largest entry: positive if and only if P is positive definite."""
    D = P / np.abs(P).max()
    least = 1.0
    for i in range(D.shape[0]):
        least = min(least, D[i, i])
        if least <= 0.0:
            return float(least)
        for j in range(i + 1, D.shape[0]):
            D[j, i + 1 :] -= D[j, i] / D[i, i] * D[i, i + 1 :]
    return float(least)


def _as_it_is(function: Callable[..., Any]) -> Callable[..., Any]:
    return function


def _loop(  # noqa: PLR0913, PLR0917 - compiled functions are arguments of their own
    z: Array,
    R: float,
    arrays: tuple[Array, Array, Array, Array, Array],
    memory: tuple[int, float, float, Bounds],
    adapt: Callable[..., Factors],
    within: Callable[..., Factors],
    pivot: Callable[..., float],
) -> tuple[Array, Array, float]:
    """The filter: five columns of `Filtered`, its gain and its smallest pivot."""
    A, Q, H, x, P = arrays
    window, forgetting, chance, bounds = memory
    m, n = x.size, z.size
    out, gains, least = np.zeros((n, 5)), np.zeros(m), 1.0
    recent, filled, total, count = np.zeros(window), 0, 0.0, 0.0
    f = Factors(1.0, 1.0, 1.0, 1.0)
    eye = np.eye(m)
    for k in range(n):
        x = A @ x
        P = A @ P @ A.T + f.q * Q
        if np.isfinite(z[k]):
            v = z[k] - H @ x
            now = v * v
            at = int(count) % window
            if filled == window:
                total -= recent[at]
            else:
                filled += 1
            recent[at] = now
            total += now
            if at == 0:
                total = recent.sum()  # sums of differences do not stay exact
            f = within(
                adapt(Seen(count, now, total / filled, float(H @ P @ H), R, chance), f, forgetting), bounds
            )
            P = f.fade * P
            PH = P @ H
            noise = f.r * f.once * R
            S = H @ PH + noise
            gain = PH / S
            x = x + gain * v
            kept = eye - np.outer(gain, H)
            P = kept @ P @ kept.T + noise * np.outer(gain, gain)
            P = 0.5 * (P + P.T)
            count += 1.0
            out[k, 1] = now / S
            if 2 * k >= n:
                gains += gain
        least = min(least, pivot(P))
        out[k, 0], out[k, 2], out[k, 3], out[k, 4] = H @ x, f.r * f.once, f.fade, f.q
    return out, gains / max(n - (n + 1) // 2, 1), least


def run_filter(
    z: Array,
    model: ScalarModel,
    rule: type[Rule],
    window: int = WINDOW,
    forgetting: float = FORGETTING,
    bounds: Bounds | None = None,
) -> Filtered:
    """Filter a channel.

    Parameters
    ----------
    z : ndarray, shape (n,)
        Samples [U] about zero; those that are no numbers are skipped.
    model : LinearModel
    rule : subclass of Rule
    window : int
        Innovations of which the mean square is taken.
    forgetting : float
        ``b`` of Sage and Husa, between 0 and 1.
    bounds : Bounds, optional
        Of the factors.

    Raises
    ------
    InputError
        A window longer than the record, a memory that is none, no sample at all, or numbers beyond all bounds.
    """
    known = int(np.isfinite(z).sum())
    if not 1 <= window <= known:
        raise InputError(
            f"a window of {window} samples does not fit into {known}", where="--window",
            remedy=f"Give one from 1 to {known}",
        )  # fmt: skip
    if not 0.0 < forgetting < 1.0:
        raise InputError(f"a forgetting factor of {forgetting:g} is none", remedy="Give one between 0 and 1")
    P = np.eye(model.H.size) * (float(np.trace(model.Q)) + model.R)
    arrays = (model.A, model.Q, model.H, np.zeros(model.H.size), P)
    given = tuple(np.ascontiguousarray(v, dtype=np.float64) for v in arrays)
    memory = (window, forgetting, by_chance(window), bounds or Bounds())
    prepare = compiled if z.size > FEW else _as_it_is
    functions = [prepare(f) for f in (rule.adapt, bounded, _least_pivot)]
    with np.errstate(over="ignore", invalid="ignore"):
        out, gain, least = prepare(_loop)(np.asarray(z, float), float(model.R), given, memory, *functions)
    if not np.isfinite(out).all():
        raise InputError(
            "the filter leaves all bounds on this record", remedy="Check the values and the model"
        )
    return Filtered(out[:, 0], out[:, 1], out[:, 2], out[:, 3], out[:, 4], gain, float(least))
