"""The augmented extended Kalman filter of Hemerly: states and parameters estimated together.

Step 1 takes N from a short variance, step 2 filters ``x_a = [x1 x2 B K beta]`` (eq. (21) of [1]_) with the Jacobians
of `kfgen.arma.state_space`.

The output sees three combinations of the five states: what B and K are is decided by where the filter starts
(``kfgen audit hemerly-ekf`` says which directions are hidden). The answer is given because the paper gives it, with that
warning.

References
----------
.. [1] E. M. Hemerly, MEMS IMU stochastic error modelling, Systems Science & Control Engineering 5(1), 2017,
   sec. 3.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kfgen.arma.loops import compiled
from kfgen.core.errors import InputError
from kfgen.identify.evidence.record import Evidence
from kfgen.identify.fit.estimate import Estimate
from kfgen.identify.methods.saini import Parameters, check_terms, first_guess
from kfgen.identify.methods.series import samples, stated

Array = NDArray[np.float64]

PRIOR = 1.0
"""Relative standard deviation of B, K and beta before the first sample."""
SLOWEST, FASTEST = 1.0, 0.1
"""beta stays between this over the record's length and that over the sampling period."""


@dataclass(frozen=True)
class EkfRun:
    """Where the filter begins and ends.

    Parameters
    ----------
    start, end : Parameters
    covariance : ndarray, shape (5, 5)
        Of ``[x1 x2 B K beta]`` at the end, output of unit size.
    """

    start: Parameters
    end: Parameters
    covariance: Array


def _filter(y: Array, T: float, R: float, box: tuple[float, float], start: tuple[Array, Array],
            numbers: Callable[..., Any]) -> tuple[Array, Array]:  # fmt: skip
    """Measurement update and Euler's step for every sample; beta stays inside its box."""
    x, P = start[0].copy(), start[1].copy()
    A, C = np.zeros((5, 5)), np.zeros((1, 5))
    eye = np.eye(5)
    for k in range(y.size):
        at = numbers(x[0], x[1], x[2], x[3], x[4], T)
        for i in range(5):
            C[0, i] = at[31 + i]
        PC = P @ C.T
        S = (C @ PC)[0, 0] + R
        gain = PC / S
        x = x + gain[:, 0] * (y[k] - at[30])
        x[4] = min(max(x[4], box[0]), box[1])
        kept = eye - gain @ C
        P = kept @ P @ kept.T + R * (gain @ gain.T)
        at = numbers(x[0], x[1], x[2], x[3], x[4], T)
        for i in range(5):
            x[i] = at[i]
            for j in range(5):
                A[i, j] = at[5 + 5 * i + j]
        P = A @ P @ A.T
        P[1, 1] += T
        P = 0.5 * (P + P.T)
    return x, P


def run_ekf(y: Array, dt: float, start: Parameters) -> EkfRun:
    """Filter samples from start values.

    Parameters
    ----------
    y : ndarray, shape (n,)
        Samples [U], their mean removed.
    dt : float
        Sampling period [s].

    Raises
    ------
    InputError
        The filter diverges.
    """
    from kfgen.arma import state_space

    scale = float(np.std(y))
    p = start.scaled(1.0 / scale)
    box = (SLOWEST / (dt * y.size), FASTEST / dt)
    x = np.array([0.0, 0.0, p.B, p.K, p.beta])
    row = np.array(compiled(state_space.numbers())(0.0, 1.0, p.B, p.K, p.beta, dt)[31:])
    # Nothing is known of where the output's two states stand.
    P = np.diag([1.0 / row[0] ** 2, 0.5 / p.beta, *(PRIOR * x[2:]) ** 2])
    x, P = compiled(_filter)(y / scale, dt, p.N**2 / dt, box, (x, P), compiled(state_space.numbers()))
    if not (np.isfinite(x).all() and np.isfinite(P).all()):
        raise InputError("the extended Kalman filter diverges on this log", remedy="Use --method ml")
    end = Parameters(p.N, abs(float(x[2])), abs(float(x[3])), float(x[4])).scaled(scale)
    return EkfRun(start, end, P)


def by_ekf(record: Evidence, wanted: Sequence[str] | None) -> Estimate:
    """The augmented filter from the Allan plot's values, with intervals from its own covariance.

    Parameters
    ----------
    record : Evidence
        What is identified.
    wanted : sequence of str or None
        Exactly these effects; chosen by the data when None.
    """
    check_terms(wanted, "ekf")
    y = samples(record, "ekf")
    found = run_ekf(y - y.mean(), record.dt, first_guess(record, y))
    scale = float(np.std(y))
    size = np.maximum([found.end.B / scale, found.end.K / scale, found.end.beta], 1e-300)
    D = found.covariance[2:, 2:] / np.outer(size, size)  # of ln B, ln K, ln beta
    # N, sigma = B sqrt(beta / 2), tau = 1 / beta, K
    J = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.5], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
    C = J @ D @ J.T
    C[0, 0] = 0.5 / min(y.size, 6000)
    said = (
        "B, K and beta follow the values at which the filter starts: of its five states the output shows three "
        "(kfgen audit hemerly-ekf); the intervals are the filter's own",
    )
    kept = [0, *((1, 2) if found.end.has_markov else ()), *((3,) if found.end.has_walk else ())]
    return stated(record, found.end.effects(), said, C[np.ix_(kept, kept)])
