"""Steps of the classical Runge-Kutta method on a tape: compiled, or by numpy where numba is missing."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kfgen.core.tape import Tape

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Steps:
    """Steps over a part of a record.

    Parameters
    ----------
    rates : Tape
        Variables: states, inputs, `given`.
    given : sequence of ndarray, shape (batch,)
    U : ndarray, shape (inputs, n - 1, substeps or 1, 3 or 1, batch or 1)
        Inputs at the beginning, the middle and the end of each part of a step.
    dt : ndarray, shape (n - 1,)
        [s]
    substeps : int
        Parts of a step.
    """

    rates: Tape
    given: Sequence[Array]
    U: Array
    dt: Array
    substeps: int


def integrate(steps: Steps, starts: NDArray[np.int64], X0: Array) -> Array:
    """The states, shape (n, states, batch); at the samples `starts` they are set to `X0`.

    Parameters
    ----------
    steps : Steps
    starts, X0 : ndarray, shape (segments,), (segments, states, batch)
    """
    try:
        from kfgen.model.plant.compiled import integrate as compiled
    except ImportError:
        return _integrate(steps, starts, X0)
    return _run(compiled, steps, starts, X0)


def _run(compiled: Callable[..., None], steps: Steps, starts: NDArray[np.int64], X0: Array) -> Array:
    """The compiled loop over its columns."""
    rates, k, batch = steps.rates, X0.shape[1], X0.shape[2]
    out = np.zeros((steps.dt.size + 1, k, batch))
    registers = np.zeros((rates.registers, batch))
    for i, value in enumerate(steps.given):
        registers[k + steps.U.shape[0] + i] = value
    first = rates.variables + rates.constants.size
    registers[rates.variables : first] = rates.constants[:, None]
    compiled(
        rates.operations,
        rates.outputs,
        first,
        registers,
        np.ascontiguousarray(steps.U),
        np.ascontiguousarray(steps.dt),
        steps.substeps,
        np.asarray(starts, dtype=np.int64),
        np.ascontiguousarray(X0),
        out,
    )
    return out


def _integrate(steps: Steps, starts: NDArray[np.int64], X0: Array) -> Array:
    """The same by numpy, all columns at once."""
    begins = {int(s): X0[i] for i, s in enumerate(starts)}
    n, U = steps.dt.size + 1, steps.U
    x = np.zeros(X0.shape[1:])
    out = np.empty((n, *x.shape))

    def slope(x: Array, u: Array) -> Array:
        rates = steps.rates.values([*x, *u, *steps.given])
        return np.array([np.broadcast_to(v, x.shape[1:]) for v in rates])

    for step in range(n):
        x = begins.get(step, x)
        out[step] = x
        if step == n - 1:
            break
        h = steps.dt[step] / steps.substeps
        for sub in range(steps.substeps):
            u = [U[:, step, min(sub, U.shape[2] - 1), min(node, U.shape[3] - 1)] for node in range(3)]
            k1 = slope(x, u[0])
            k2 = slope(x + 0.5 * h * k1, u[1])
            k3 = slope(x + 0.5 * h * k2, u[1])
            k4 = slope(x + h * k3, u[2])
            x = x + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
    return out
