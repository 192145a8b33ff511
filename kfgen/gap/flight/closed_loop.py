"""The closed loop of the extended Kalman filter over a log, compiled by numba (the extra ``kfgen[fast]``); import late.

Equations come as tapes, see `kfgen.core.tape`, so that the loop is compiled once for every filter.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from kfgen.gap.flight.linear.compiled import propagated
from kfgen.model.plant.compiled import compiled, run_tape


@compiled("void(float64[::1], float64[:,::1], int64[::1], int64[::1])")
def _stored(x: Any, r: Any, out: Any, quaternions: Any) -> None:
    """The stored state out of the registers, its quaternions normalised."""
    for i in range(x.size):
        x[i] = r[out[i], 0]
    for s in range(quaternions.size):
        k = quaternions[s]
        size = np.sqrt(x[k] ** 2 + x[k + 1] ** 2 + x[k + 2] ** 2 + x[k + 3] ** 2)
        for i in range(4):
            x[k + i] /= size


@compiled("void(int64[:,::1], int64, float64[::1], float64[:,::1])")
def _tape(operations: Any, first: int, constants: Any, r: Any) -> None:
    """One evaluation: constants in their registers, which no operation writes."""
    given = first - constants.size
    for i in range(constants.size):
        r[given + i, 0] = constants[i]
    run_tape(operations, first, r)


@compiled("void(float64[:,::1], float64[::1], float64[::1], float64[::1])")
def _given(r: Any, x: Any, known: Any, fixed: Any) -> None:
    """Stored state, inputs and drivers, constants and step into the first registers."""
    for i in range(x.size):
        r[i, 0] = x[i]
    for i in range(known.size):
        r[x.size + i, 0] = known[i]
    for i in range(fixed.size):
        r[x.size + known.size + i, 0] = fixed[i]


@compiled("float64(float64[:,::1], float64[::1], float64, float64, float64[::1], float64[::1], float64)")
def _corrected(  # noqa: PLR0913, PLR0917
    P: Any, h: Any, e: float, R: float, K: Any, dx: Any, limit: float
) -> float:
    """The error `dx` and its covariance after one scalar reading with residual `e`; beyond the limit it counts less.

    Returns the reading's log-likelihood, of an outlier in proportion to its size (Huber).
    """
    n, S = dx.size, R
    for i in range(n):
        total = 0.0
        for j in range(n):
            total += P[i, j] * h[j]
        K[i] = total
    for i in range(n):
        S += h[i] * K[i]
        e -= h[i] * dx[i]
    weight = 1.0
    if e * e > limit * limit * S:
        weight = limit * np.sqrt(S) / abs(e)
    for i in range(n):
        dx[i] += K[i] * e * weight / S
        for j in range(n):
            P[i, j] -= weight * K[i] * K[j] / S
    size = abs(e) / math.sqrt(S)
    return -0.5 * math.log(S) - (0.5 * size * size if size < limit else limit * (size - 0.5 * limit))


@compiled("void(float64[:,::1], int64[::1], float64[::1])")
def _read(r: Any, outputs: Any, out: Any) -> None:
    """The first outputs of a tape, as many as there is room for."""
    for z in range(out.size):
        out[z] = r[outputs[z], 0]


@compiled(
    "void(int64[:,::1], int64, float64[::1], int64[::1], int64[::1], int64[::1], int64[::1], int64[::1],"
    " int64[:,::1], int64, float64[::1], int64[::1], int64[::1], int64[::1],"
    " int64[:,::1], int64, float64[::1], int64[::1], int64[::1],"
    " float64[:,::1], float64[::1], float64[:,::1], float64[::1],"
    " int64[::1], int64[::1], float64[::1], float64[::1], float64, float64, float64[:,::1], float64[::1])"
)
def fly(  # noqa: PLR0913, PLR0917
    o1: Any, first1: int, c1: Any, out1: Any, Pi: Any, Pj: Any, Qi: Any, Qj: Any,
    o2: Any, first2: int, c2: Any, out2: Any, Hi: Any, Hj: Any,
    o3: Any, first3: int, c3: Any, out3: Any, quaternions: Any,
    known: Any, x0: Any, P: Any, fixed: Any,
    row_at: Any, row_index: Any, row_z: Any, row_R: Any, limit: float, least: float, X: Any, score: Any,
) -> None:  # fmt: skip
    """The extended Kalman filter over a log; outliers count as if they lay at a limit.

    Parameters
    ----------
    o1, first1, c1, out1, Pi, Pj, Qi, Qj
        Tape of the step, the transition and the process noise, and where their entries go.
    o2, first2, c2, out2, Hi, Hj
        Tape of all readings and their Jacobians.
    o3, first3, c3, out3, quaternions
        Tape of the injection of errors.
    known : ndarray, shape (n, inputs + drivers)
        What acts from each time to the next.
    x0, P
        Stored state and covariance at the start, shapes (stored,) and (states, states); `P` is changed.
    fixed : ndarray, shape (constants + 1,)
        Constants and the step [s].
    row_at, row_index, row_z, row_R : ndarray, shape (rows,)
        Scalar readings in the order of time: at which sample, which row of the readings' tape, value, variance.
    limit, least : float
        Standard deviations of an innovation beyond which it is an outlier; score below which a flight ends early [nats].
    X : ndarray, shape (n, stored)
        The stored state after the updates of each sample; written.
    score : ndarray, shape (1,)
        Log-likelihood [nats]; written, minus infinity of a flight that ended.
    """
    n, N, stored = P.shape[0], known.shape[0], x0.size
    readings = out2.size - Hi.size
    r1, r2 = np.zeros((first1 + o1.shape[0], 1)), np.zeros((first2 + o2.shape[0], 1))
    r3 = np.zeros((first3 + o3.shape[0], 1))
    x, H = x0.copy(), np.zeros((readings, n))
    T, turned, Phi, Qd = np.zeros((n, n)), np.zeros((n, n)), np.zeros(Pi.size), np.zeros(Qi.size)
    dx, K = np.zeros(n), np.zeros(n)
    # No reading is likelier than one without an error of the prediction.
    at, most = 0, -0.5 * np.sum(np.log(row_R))
    for k in range(N):
        if score[0] + most < least:
            score[0] = -np.inf
            return
        if at < row_at.size and row_at[at] == k:
            _given(r2, x, known[k], fixed)
            _tape(o2, first2, c2, r2)
            H[:] = 0.0
            for i in range(Hi.size):
                H[Hi[i], Hj[i]] = r2[out2[readings + i], 0]
            dx[:] = 0.0
            while at < row_at.size and row_at[at] == k:
                m = row_index[at]
                score[0] += _corrected(P, H[m], row_z[at] - r2[out2[m], 0], row_R[at], K, dx, limit)
                most += 0.5 * np.log(row_R[at])
                at += 1
            _given(r3, x, known[k], fixed)
            r3[first3 - c3.size - n : first3 - c3.size, 0] = dx
            _tape(o3, first3, c3, r3)
            _stored(x, r3, out3, quaternions)
        X[k] = x
        if k == N - 1:
            break
        _given(r1, x, known[k], fixed)
        _tape(o1, first1, c1, r1)
        _stored(x, r1, out1, quaternions)
        _read(r1, out1[stored:], Phi)
        _read(r1, out1[stored + Pi.size :], Qd)
        propagated(P, T, turned, Phi, Pi, Pj, Qd, Qi, Qj)
