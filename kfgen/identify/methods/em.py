"""The expectation-maximisation estimator of Saini on the state space of eqs (19)-(20) of [1]_.

``x1' = x1 + T x2``, ``x2' = (1 - beta T) x2 + w`` with ``var w = T``, ``y = c1 x1 + c2 x2 + v``. The E step is a Kalman
smoother, the M step three regressions: of y on x for ``c`` and ``R``, of x2' on x2 for beta [3]_. From them
``K = c1 / beta``, ``B^2 = (c2^2 - K^2) / beta^2``, ``N^2 = R T``. Every round raises the likelihood.

References
----------
.. [1] E. M. Hemerly, MEMS IMU stochastic error modelling, Systems Science & Control Engineering 5(1), 2017.
.. [2] V. Saini, S. C. Rana, M. M. Kuber, Online estimation of state space error model for MEMS IMU, J. Modelling
   and Simulation of Systems 1(4), 2010.
.. [3] R. H. Shumway and D. S. Stoffer, An approach to time series smoothing and forecasting using the EM
   algorithm, J. Time Series Analysis 3(4), 1982.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kfgen.arma.loops import compiled, fast
from kfgen.identify.evidence.record import Evidence
from kfgen.identify.evidence.whittle import block_means
from kfgen.identify.fit.estimate import Estimate
from kfgen.identify.methods.saini import Parameters, check_terms, first_guess
from kfgen.identify.methods.series import samples, stated

Array = NDArray[np.float64]

MAX_ITERATIONS = 1000
GAIN_TOLERANCE_NATS = 1e-4
"""Gain of log-likelihood [nats] in a round at which it ends."""
MAX_SAMPLES = 200_000
"""Samples that are smoothed: a longer record is averaged to so many."""
MAX_SAMPLES_UNCOMPILED = 4096
"""The same without numba."""


@dataclass(frozen=True)
class EmRun:
    """Where the rounds end.

    Parameters
    ----------
    end : Parameters
        ``B`` is zero where ``c2^2 < K^2``: then no Gauss-Markov process fits.
    values : tuple of float
        Log-likelihood of each round.
    """

    end: Parameters
    values: tuple[float, ...]


def _forward(y: Array, T: float, a: float, c: Array, R: float) -> tuple[float, Array]:
    """The Kalman filter.

    Returns
    -------
    value : float
        Log-likelihood, without its constant.
    known : ndarray, shape (n, 10)
        Of each sample ``x1, x2, P11, P12, P22`` before it and after it.
    """
    known = np.empty((y.size, 10))
    c1, c2 = c[0], c[1]
    x1, x2, P11, P12, P22 = 0.0, 0.0, 1.0 / c1**2, 0.0, T / (1.0 - a * a)
    value = 0.0
    for k in range(y.size):
        row = known[k]
        row[0], row[1], row[2], row[3], row[4] = x1, x2, P11, P12, P22
        g1, g2 = c1 * P11 + c2 * P12, c1 * P12 + c2 * P22
        S = c1 * g1 + c2 * g2 + R
        e = y[k] - c1 * x1 - c2 * x2
        value -= 0.5 * (np.log(S) + e * e / S)
        x1, x2 = x1 + g1 * e / S, x2 + g2 * e / S
        P11, P12, P22 = P11 - g1 * g1 / S, P12 - g1 * g2 / S, P22 - g2 * g2 / S
        row[5], row[6], row[7], row[8], row[9] = x1, x2, P11, P12, P22
        x1, x2 = x1 + T * x2, a * x2
        P11, P12, P22 = P11 + T * (2.0 * P12 + T * P22), a * (P12 + T * P22), a * a * P22 + T
    return value, known


def _backward(y: Array, T: float, a: float, known: Array) -> Array:
    """Rauch's smoother, backwards over what the filter knew.

    Returns
    -------
    ndarray, shape (7,)
        Sums of ``x1^2, x1 x2, x2^2, y x1, y x2``, of ``x2' x2``, and of ``x2^2`` without the last sample.
    """
    sums = np.zeros(7)
    last = known[y.size - 1]
    x1, x2, P11, P12, P22 = last[5], last[6], last[7], last[8], last[9]
    for k in range(y.size - 1, -1, -1):
        if k < y.size - 1:
            m, p = known[k], known[k + 1]
            # The gain J = P A' / P_before of the next sample.
            u1, u2, v1, v2 = m[7] + T * m[8], a * m[8], m[8] + T * m[9], a * m[9]
            det = p[2] * p[4] - p[3] * p[3]
            J11, J12 = (u1 * p[4] - u2 * p[3]) / det, (u2 * p[2] - u1 * p[3]) / det
            J21, J22 = (v1 * p[4] - v2 * p[3]) / det, (v2 * p[2] - v1 * p[3]) / det
            lag, after = J21 * P12 + J22 * P22, x2
            d1, d2 = x1 - p[0], x2 - p[1]
            D11, D12, D22 = P11 - p[2], P12 - p[3], P22 - p[4]
            x1, x2 = m[5] + J11 * d1 + J12 * d2, m[6] + J21 * d1 + J22 * d2
            P11 = m[7] + J11 * (J11 * D11 + 2.0 * J12 * D12) + J12 * J12 * D22
            P12 = m[8] + J11 * (J21 * D11 + J22 * D12) + J12 * (J21 * D12 + J22 * D22)
            P22 = m[9] + J21 * (J21 * D11 + 2.0 * J22 * D12) + J22 * J22 * D22
            sums[5] += lag + after * x2
            sums[6] += P22 + x2 * x2
        sums[0] += P11 + x1 * x1
        sums[1] += P12 + x1 * x2
        sums[2] += P22 + x2 * x2
        sums[3] += y[k] * x1
        sums[4] += y[k] * x2
    return sums


def run_em(y: Array, dt: float, start: Parameters, rounds: int = MAX_ITERATIONS) -> EmRun:
    """Rounds of smoothing and regression from start values.

    Parameters
    ----------
    y : ndarray, shape (n,)
        Samples [U], their mean removed.
    dt : float
        Sampling period [s].
    """
    scale = float(np.std(y))
    p, y = start.scaled(1.0 / scale), y / scale
    a, c, R = 1.0 - p.beta * dt, np.array([p.K * p.beta, np.hypot(p.K, p.beta * p.B)]), p.N**2 / dt
    power = float(y @ y)
    values: list[float] = []
    for _ in range(rounds):
        value, known = compiled(_forward)(y, dt, a, c, R)
        s = compiled(_backward)(y, dt, a, known)
        values.append(float(value))
        if len(values) > 1 and values[-1] - values[-2] < GAIN_TOLERANCE_NATS:
            break
        xx, yx = np.array([[s[0], s[1]], [s[1], s[2]]]), s[3:5]
        c = np.linalg.solve(xx, yx)
        R = max((power - float(c @ yx)) / y.size, 1e-12)
        a = float(np.clip(s[5] / s[6], 0.0, 1.0 - 1.0 / y.size))
    beta = (1.0 - a) / dt
    K = abs(float(c[0])) / beta
    B = float(np.sqrt(max(c[1] ** 2 - K**2, 0.0))) / beta
    return EmRun(Parameters(float(np.sqrt(R * dt)), B, K, beta).scaled(scale), tuple(values))


def by_em(record: Evidence, wanted: Sequence[str] | None) -> Estimate:
    """The estimator of Saini from the Allan plot's values, with intervals of maximum likelihood.

    Parameters
    ----------
    record : Evidence
        What is identified.
    wanted : sequence of str or None
        Exactly these effects; chosen by the data when None.
    """
    check_terms(wanted, "em")
    y = samples(record, "em")
    guess = first_guess(record, y)
    block = -(-y.size // (MAX_SAMPLES if fast() else MAX_SAMPLES_UNCOMPILED))
    found = run_em(block_means(y - y.mean(), block), record.dt * block, guess)
    said = [] if block == 1 else [f"the samples were averaged in blocks of {block} first"]
    if len(found.values) == MAX_ITERATIONS:
        said.append(f"{MAX_ITERATIONS} rounds have not ended the search: the likelihood is nearly flat")
    if not found.end.has_walk:
        said.append("no random walk fits beside the Gauss-Markov process (K ends at zero), left out")
    if not found.end.has_markov:
        said.append("no Gauss-Markov process fits beside the random walk (B^2 comes out negative), left out")
    return stated(record, found.end.effects(), said)
