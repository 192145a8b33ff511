"""The loop of the simulation, compiled by numba (the extra ``kfgen[fast]``); import this file late.

It runs a tape, so that it is compiled once for every model; the machine code is kept on disk where that can be
written.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numba
import numpy as np

from kfgen.core.straight_line import UNARY
from kfgen.core.tape import CODES

if numba.config.DISABLE_JIT:
    raise ImportError("numba is told not to compile: vectors of numpy are faster than loops of Python")

NEG, SIN, COS, TAN = CODES["neg"], CODES["sin"], CODES["cos"], CODES["tan"]
ASIN, ACOS, ATAN, EXP = CODES["asin"], CODES["acos"], CODES["atan"], CODES["exp"]
LOG, SQRT, ABS, SIGN = CODES["log"], CODES["sqrt"], CODES["abs"], CODES["sign"]
TANH, INV, ADD, MUL = CODES["tanh"], CODES["inv"], CODES["add"], CODES["mul"]
SUB, DIV, POW, ATAN2 = CODES["sub"], CODES["div"], CODES["pow"], CODES["atan2"]
MIN = CODES["min"]
FIRST_BINARY = len(UNARY)


def compiled(signature: str) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """A decorator: the function as machine code, kept on disk where possible."""

    def make(function: Callable[..., Any]) -> Callable[..., Any]:
        try:
            made = numba.njit(signature, cache=True, nogil=True, error_model="numpy")(function)
        except (RuntimeError, OSError):  # no folder can be written
            made = numba.njit(signature, nogil=True, error_model="numpy")(function)
        return made  # type: ignore[no-any-return]

    return make


@compiled("float64(int64, float64)")
def _one(code: int, a: float) -> float:
    if code == SIN:
        return math.sin(a)
    if code == COS:
        return math.cos(a)
    if code == TAN:
        return math.tan(a)
    if code == ASIN:
        return math.asin(a) if abs(a) <= 1.0 else math.nan
    if code == ACOS:
        return math.acos(a) if abs(a) <= 1.0 else math.nan
    if code == ATAN:
        return math.atan(a)
    if code == EXP:
        return math.exp(a) if a < 709.0 else math.inf
    if code == LOG:
        return math.log(a) if a > 0.0 else math.nan
    if code == SQRT:
        return math.sqrt(a) if a >= 0.0 else math.nan
    if code == ABS:
        return abs(a)
    if code == SIGN:
        return 1.0 if a > 0.0 else (-1.0 if a < 0.0 else 0.0)
    return math.tanh(a)


@compiled("float64(int64, float64, float64)")
def _two(code: int, a: float, b: float) -> float:
    if code == POW:
        return math.pow(a, b)
    if code == ATAN2:
        return math.atan2(a, b)
    if code == MIN:
        return min(a, b)
    return max(a, b)


@compiled("void(int64[:,::1], int64, float64[:,::1])")
def run_tape(operations: Any, first: int, r: Any) -> None:
    """All operations on all columns; rows are indexed where they lie, for a view of a row costs more than a sum."""
    columns = r.shape[1]
    for i in range(operations.shape[0]):
        code, a, b, out = operations[i, 0], operations[i, 1], operations[i, 2], first + i
        if code == ADD:
            for j in range(columns):
                r[out, j] = r[a, j] + r[b, j]
        elif code == MUL:
            for j in range(columns):
                r[out, j] = r[a, j] * r[b, j]
        elif code == SUB:
            for j in range(columns):
                r[out, j] = r[a, j] - r[b, j]
        elif code == NEG:
            for j in range(columns):
                r[out, j] = -r[a, j]
        elif code == DIV:
            for j in range(columns):
                r[out, j] = r[a, j] / r[b, j]
        elif code == INV:
            for j in range(columns):
                r[out, j] = 1.0 / r[a, j]
        elif code < FIRST_BINARY:
            for j in range(columns):
                r[out, j] = _one(code, r[a, j])
        else:
            for j in range(columns):
                r[out, j] = _two(code, r[a, j], r[b, j])


@compiled(
    "void(int64[:,::1], int64[::1], int64, float64[:,::1], float64[:,:,:,:,::1], float64[::1], int64,"
    " int64[::1], float64[:,:,::1], float64[:,:,::1])"
)
def integrate(  # noqa: PLR0913, PLR0917
    operations: Any,
    outputs: Any,
    first: int,
    r: Any,
    U: Any,
    dt: Any,
    substeps: int,
    starts: Any,
    X0: Any,
    out: Any,
) -> None:
    """The classical Runge-Kutta method; see `kfgen.model.plant.runge_kutta.Steps`.

    Parameters
    ----------
    operations : ndarray of int64, shape (m, 3)
        As of `kfgen.core.tape.Tape`.
    outputs : ndarray of int64, shape (k,)
        Registers of the rates of the states.
    first : int
        Register of the first operation's result.
    r : ndarray, shape (registers, batch)
        Registers, of which constants and what is given are filled in; states and inputs are filled in here.
    U, dt, substeps
        As of `Steps`.
    starts, X0 : ndarray of int64, shape (segments,), ndarray, shape (segments, k, batch)
        Samples at which the states are set, and to what [SI].
    out : ndarray, shape (n, k, batch)
        The states [SI]; written.
    """
    n, k, batch = out.shape
    u0, inputs, M, N, B = k, U.shape[0], U.shape[2], U.shape[3], U.shape[4]
    x, total, slope = np.zeros((k, batch)), np.zeros((k, batch)), np.zeros((k, batch))
    segment = 0
    for step in range(n):
        if segment < starts.size and starts[segment] == step:
            x[:] = X0[segment]
            segment += 1
        out[step] = x
        if step == n - 1:
            break
        h = dt[step] / substeps
        for sub in range(substeps):
            m = min(sub, M - 1)
            for stage in range(4):
                node = min((stage + 1) // 2, N - 1)
                for i in range(inputs):
                    for j in range(batch):
                        r[u0 + i, j] = U[i, step, m, node, min(j, B - 1)]
                if stage == 0:
                    for i in range(k):
                        for j in range(batch):
                            r[i, j] = x[i, j]
                            total[i, j] = 0.0
                else:
                    ahead = h if stage == 3 else 0.5 * h
                    for i in range(k):
                        for j in range(batch):
                            r[i, j] = x[i, j] + ahead * slope[i, j]
                run_tape(operations, first, r)
                weight = h / 6.0 if stage in (0, 3) else h / 3.0
                for i in range(k):
                    for j in range(batch):
                        slope[i, j] = r[outputs[i], j]
                        total[i, j] += weight * slope[i, j]
            for i in range(k):
                for j in range(batch):
                    x[i, j] += total[i, j]
