"""The loops of a flight, compiled by numba (the extra ``kfgen[fast]``); import this file late.

One forward pass is the filter about a path; one more carries any number of columns through its gains, by which effects
are judged after the states have absorbed what they can [1]_, [2]_; one backward pass gives the smoothed path [3]_.

A pass goes over blocks of steps: every loop begins at step ``first`` and reading ``at``, changes what is carried from
one block to the next, and returns the reading at which the next block begins.

References
----------
.. [1] B. Friedland, Treatment of bias in recursive filtering, IEEE Trans. Automatic Control 14(4), 1969.
.. [2] A. S. Willsky and H. L. Jones, A generalized likelihood ratio approach to the detection and estimation of jumps in
   linear systems, IEEE Trans. Automatic Control 21(1), 1976.
.. [3] P. de Jong and J. Penzer, Diagnosing shocks in time series, J. Amer. Statist. Assoc. 93(442), 1998.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from kfgen.model.plant.compiled import compiled


@compiled(
    "void(float64[:,::1], float64[:,::1], float64[:,::1], float64[::1], int64[::1], int64[::1], float64[::1], int64[::1],"
    " int64[::1])"
)
def propagated(  # noqa: PLR0913, PLR0917
    P: Any, T: Any, turned: Any, Phi: Any, Pi: Any, Pj: Any, Qd: Any, Qi: Any, Qj: Any
) -> None:
    """``Phi P Phi' + Qd`` in place, by the entries that are not zero, shape (entries,); of a symmetric product the upper half."""
    n = P.shape[0]
    T[:] = 0.0
    for z in range(Pi.size):
        v, a, b = Phi[z], Pi[z], Pj[z]
        for j in range(n):
            T[a, j] += v * P[b, j]
    for i in range(n):
        for j in range(n):
            turned[j, i] = T[i, j]
    P[:] = 0.0
    for z in range(Pi.size):
        v, a, b = Phi[z], Pi[z], Pj[z]
        for j in range(a, n):
            P[a, j] += v * turned[b, j]
    for z in range(Qi.size):
        if Qi[z] <= Qj[z]:
            P[Qi[z], Qj[z]] += Qd[z]
    for i in range(n):
        for j in range(i):
            P[i, j] = P[j, i]


@compiled("void(float64[::1], float64[::1], float64[::1], int64[::1], int64[::1], float64[::1])")
def _moved(fresh: Any, c: Any, Phi: Any, Pi: Any, Pj: Any, x: Any) -> None:
    """``c + Phi x`` into `fresh`, shape (states,), by the entries that are not zero."""
    fresh[:] = c
    for z in range(Pi.size):
        fresh[Pi[z]] += Phi[z] * x[Pj[z]]


@compiled(
    "int64(int64, int64, float64[:,::1], int64[::1], int64[::1], float64[:,::1], int64[::1], int64[::1],"
    " float64[:,::1], float64[:,::1], float64[::1], int64[::1], float64[:,::1], float64[::1], float64[::1],"
    " float64[::1], float64[::1], float64[:,::1])"
)
def forward(  # noqa: PLR0913, PLR0917
    first: int, at: int, Phi: Any, Pi: Any, Pj: Any, Qd: Any, Qi: Any, Qj: Any, c: Any, P: Any, x: Any, row_at: Any,
    H: Any, y: Any, R: Any, e: Any, S: Any, K: Any,
) -> int:  # fmt: skip
    """The filter about a path.

    Parameters
    ----------
    Phi, Qd : ndarray, shape (steps, entries)
        Entries of the transition and the process noise of each step of the block, at rows and columns ``Pi, Pj`` and
        ``Qi, Qj``.
    c : ndarray, shape (n, states)
        By how much the path misses its own equations in each step.
    P, x : ndarray, shape (states, states), ndarray, shape (states,)
        At the first step, about the path; carried.
    row_at, H, y, R : ndarray, shape (rows,), (rows, states), (rows,), (rows,)
        Scalar readings less what the path says, in the order of time.
    e, S, K : ndarray, shape (rows,), (rows,), (rows, states)
        Innovations, their variances, gains; written.
    """
    n, last = x.size, c.shape[0] - 1
    T, turned, fresh = np.zeros((n, n)), np.zeros((n, n)), np.zeros(n)
    for step in range(Phi.shape[0]):
        k = first + step
        while at < row_at.size and row_at[at] == k:
            s, innovation = R[at], y[at]
            gain = K[at]
            gain[:] = 0.0
            for j in range(n):
                h = H[at, j]
                if h != 0.0:
                    for i in range(n):
                        gain[i] += h * P[j, i]
            for i in range(n):
                s += H[at, i] * gain[i]
                innovation -= H[at, i] * x[i]
            for i in range(n):
                v = gain[i]
                gain[i] = v / s
                x[i] += gain[i] * innovation
                T[0, i] = v
            for i in range(n):
                v = gain[i]
                for j in range(n):
                    P[i, j] -= v * T[0, j]
            e[at], S[at] = innovation, s
            at += 1
        if k == last:
            break
        _moved(fresh, c[k], Phi[step], Pi, Pj, x)
        x[:] = fresh
        propagated(P, T, turned, Phi[step], Pi, Pj, Qd[step], Qi, Qj)
    return at


@compiled(
    "int64(int64, int64, float64[:,::1], int64[::1], int64[::1], float64[:,::1], int64[::1], int64[::1],"
    " float64[:,:,::1], float64[:,::1], int64[::1], float64[:,::1], float64[::1], float64[:,::1], float64[:,::1])"
)
def columns(  # noqa: PLR0913, PLR0917
    first: int, at: int, Phi: Any, Pi: Any, Pj: Any, B: Any, Bi: Any, Bj: Any, du: Any, U: Any, row_at: Any, H: Any,
    S: Any, K: Any, out: Any,
) -> int:  # fmt: skip
    """What errors of readings do to the normalised innovations.

    Parameters
    ----------
    Phi, Pi, Pj, row_at, H, S, K
        As of `forward`.
    B : ndarray, shape (steps, entries)
        By how much errors of inputs move the error state, at rows and columns ``Bi, Bj``.
    du : ndarray, shape (n, inputs, m)
        Errors of the inputs [SI].
    U : ndarray, shape (states, m)
        What they do to the states; zero at the start, carried.
    out : ndarray, shape (rows, m)
        Errors of the other readings [SI]; written over by what the innovations lose.
    """
    n, last, m = H.shape[1], du.shape[0] - 1, out.shape[1]
    fresh, V = np.zeros((n, m)), np.zeros(m)
    for step in range(Phi.shape[0]):
        k = first + step
        while at < row_at.size and row_at[at] == k:
            for j in range(m):
                V[j] = out[at, j]
            for i in range(n):
                h = H[at, i]
                if h != 0.0:
                    for j in range(m):
                        V[j] += h * U[i, j]
            for i in range(n):
                g = K[at, i]
                for j in range(m):
                    U[i, j] -= g * V[j]
            scale = 1.0 / np.sqrt(S[at])
            for j in range(m):
                out[at, j] = V[j] * scale
            at += 1
        if k == last:
            break
        fresh[:] = 0.0
        for z in range(Pi.size):
            v, a, b = Phi[step, z], Pi[z], Pj[z]
            for j in range(m):
                fresh[a, j] += v * U[b, j]
        for z in range(Bi.size):
            v, a, b = B[step, z], Bi[z], Bj[z]
            for j in range(m):
                fresh[a, j] += v * du[k, b, j]
        U[:] = fresh
    return at


@compiled(
    "int64(int64, int64, float64[:,::1], int64[::1], int64[::1], float64[:,::1], int64[::1], int64[::1],"
    " float64[::1], int64[::1], float64[:,::1], float64[::1], float64[:,::1], float64[::1], float64[:,::1],"
    " float64[::1])"
)
def products(  # noqa: PLR0913, PLR0917
    first: int, at: int, Phi: Any, Pi: Any, Pj: Any, B: Any, Bi: Any, Bj: Any, lam: Any, row_at: Any, H: Any, S: Any,
    K: Any, w: Any, of_inputs: Any, of_readings: Any,
) -> int:  # fmt: skip
    """Products of a series with the columns of unit errors of each single reading: `columns` backwards, see [3]_.

    Parameters
    ----------
    Phi, Pi, Pj, B, Bi, Bj, row_at, H, S, K
        As of `columns`.
    lam : ndarray, shape (states,)
        Zero at the end, carried.
    w : ndarray, shape (rows,)
        The series.
    of_inputs : ndarray, shape (n, inputs)
        Written over: of an error of an input at one time.
    of_readings : ndarray, shape (rows,)
        Written over: of an error of one other reading.
    """
    n, last = H.shape[1], of_inputs.shape[0] - 1
    fresh = np.zeros(n)
    for step in range(Phi.shape[0] - 1, -1, -1):
        k = first + step
        if k < last:
            for z in range(Bi.size):
                of_inputs[k, Bj[z]] += B[step, z] * lam[Bi[z]]
            fresh[:] = 0.0
            for z in range(Pi.size):
                fresh[Pj[z]] += Phi[step, z] * lam[Pi[z]]
            lam[:] = fresh
        while at >= 0 and row_at[at] == k:
            v = w[at] / np.sqrt(S[at])
            for i in range(n):
                v -= K[at, i] * lam[i]
            of_readings[at] = v
            for i in range(n):
                lam[i] += H[at, i] * v
            at -= 1
    return at


@compiled(
    "int64(int64, int64, float64[:,::1], int64[::1], int64[::1], float64[::1], int64[::1], float64[:,::1],"
    " float64[::1], float64[::1], float64[:,::1], float64[:,::1])"
)
def disturbances(  # noqa: PLR0913, PLR0917
    first: int, at: int, Phi: Any, Pi: Any, Pj: Any, r: Any, row_at: Any, H: Any, e: Any, S: Any, K: Any, out: Any,
) -> int:  # fmt: skip
    """The smoothed disturbances of a path, one backward pass; `smoothed` makes its errors of them.

    Parameters
    ----------
    Phi, Pi, Pj, row_at, H, e, S, K
        As of `forward`.
    r : ndarray, shape (states,)
        Zero at the end, carried.
    out : ndarray, shape (n, states)
        Written.
    """
    n, last = H.shape[1], out.shape[0] - 1
    fresh = np.zeros(n)
    for step in range(Phi.shape[0] - 1, -1, -1):
        k = first + step
        if k < last:
            fresh[:] = 0.0
            for z in range(Pi.size):
                fresh[Pj[z]] += Phi[step, z] * r[Pi[z]]
            r[:] = fresh
        while at >= 0 and row_at[at] == k:
            u = e[at] / S[at]
            for i in range(n):
                u -= K[at, i] * r[i]
            for i in range(n):
                r[i] += H[at, i] * u
            at -= 1
        for i in range(n):
            out[k, i] = r[i]
    return at


@compiled(
    "void(int64, float64[:,::1], int64[::1], int64[::1], float64[:,::1], int64[::1], int64[::1], float64[:,::1],"
    " float64[::1], float64[:,::1])"
)
def smoothed(  # noqa: PLR0913, PLR0917
    first: int, Phi: Any, Pi: Any, Pj: Any, Qd: Any, Qi: Any, Qj: Any, c: Any, x: Any, out: Any
) -> None:
    """The errors of the path with all readings known, one forward pass.

    Parameters
    ----------
    Phi, Pi, Pj, Qd, Qi, Qj, c
        As of `forward`.
    x : ndarray, shape (states,)
        The error at the first step; carried.
    out : ndarray, shape (n, states)
        Of `disturbances`; written over.
    """
    n, last = x.size, out.shape[0] - 1
    fresh = np.zeros(n)
    for step in range(Phi.shape[0]):
        k = first + step
        for i in range(n):
            out[k, i] = x[i]
        if k == last:
            break
        _moved(fresh, c[k], Phi[step], Pi, Pj, x)
        for z in range(Qi.size):
            fresh[Qi[z]] += Qd[step, z] * out[k + 1, Qj[z]]
        x[:] = fresh


@compiled(
    "int64(int64, int64, int64, float64[:,::1], int64[::1], int64[::1], float64[:,:,::1], int64[::1], int64[::1],"
    " float64[::1], float64[:,::1], int64[::1], float64[:,::1], float64[::1], float64[::1], float64[:,::1],"
    " float64[::1], float64[::1])"
)
def scores(  # noqa: PLR0913, PLR0917
    first: int, at: int, last: int, Phi: Any, Pi: Any, Pj: Any, parts: Any, Qi: Any, Qj: Any, r: Any, N: Any,
    row_at: Any, H: Any, e: Any, S: Any, K: Any, of_rows: Any, of_parts: Any,
) -> int:  # fmt: skip
    """Derivatives of the log-likelihood in the logarithm of every noise's standard deviation, in one backward pass.

    With ``u = e/S - K'r`` and ``D = 1/S + K'NK`` of the disturbance smoother, that of a reading of variance R is
    ``R (u^2 - D)``, that of a process noise of covariance Q is ``r'Qr - tr(QN)``, see [3]_.

    Parameters
    ----------
    last : int
        The last step of the flight.
    Phi, Pi, Pj, Qi, Qj, row_at, H, e, S, K
        As of `forward`.
    parts : ndarray, shape (parts, steps, entries)
        Entries of the process noise of each input alone.
    r, N : ndarray, shape (states,), (states, states)
        Zero at the end, carried.
    of_rows : ndarray, shape (rows,)
        ``u^2 - D``; written.
    of_parts : ndarray, shape (parts,)
        ``r'Qr - tr(QN)``; added to.
    """
    n = H.shape[1]
    back, g, T = np.zeros(n), np.zeros(n), np.zeros((n, n))
    for step in range(Phi.shape[0] - 1, -1, -1):
        k = first + step
        if k < last:
            for p in range(parts.shape[0]):
                total = 0.0
                for z in range(Qi.size):
                    total += parts[p, step, z] * (r[Qi[z]] * r[Qj[z]] - N[Qi[z], Qj[z]])
                of_parts[p] += total
            back[:] = 0.0
            T[:] = 0.0
            for z in range(Pi.size):
                v = Phi[step, z]
                back[Pj[z]] += v * r[Pi[z]]
                for j in range(n):
                    T[Pj[z], j] += v * N[Pi[z], j]
            N[:] = 0.0
            for z in range(Pi.size):
                v = Phi[step, z]
                for i in range(n):
                    N[i, Pj[z]] += v * T[i, Pi[z]]
            r[:] = back
        while at >= 0 and row_at[at] == k:
            u, D = e[at] / S[at], 1.0 / S[at]
            for i in range(n):
                u -= K[at, i] * r[i]
                total = 0.0
                for j in range(n):
                    total += N[i, j] * K[at, j]
                g[i] = total
                D += K[at, i] * total
            of_rows[at] = u * u - D
            for i in range(n):
                r[i] += H[at, i] * u
                for j in range(n):
                    N[i, j] += H[at, i] * H[at, j] * D - H[at, i] * g[j] - g[i] * H[at, j]
            at -= 1
    return at
