"""Hemerly's augmented system in symbols: B, K and beta of a gyro as states of an extended Kalman filter.

The equivalent model of bias instability, white noise and random walk in continuous time is
``y'' + beta y' = sqrt(K^2 + beta^2 B^2) w' + K beta w`` (eq. (18) of [1]_) with a white noise w of unit
density; B is that of Saini: the Gauss-Markov process obeys ``g' = -beta g + beta B w``. In state space
``x1' = x2``, ``x2' = -beta x2 + w``, ``y = K beta x1 + r x2`` with ``r = sqrt(K^2 + beta^2 B^2)``; Euler's step
of T seconds gives eqs (19)-(20). With B, K and beta as constant states it is the augmented system of eq. (21), whose
Jacobians (eq. (22)) are derived here and nowhere written.

References
----------
.. [1] E. M. Hemerly, MEMS IMU stochastic error modelling, Systems Science & Control Engineering 5(1), 2017.
.. [2] V. Saini, S. C. Rana, M. M. Kuber, Online estimation of state space error model for MEMS IMU, J. Modelling
   and Simulation of Systems 1(4), 2010.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import sympy as sp

STATE_NAMES = ("x1", "x2", "B", "K", "beta")
"""The augmented state, eq. (21)."""
STATES = tuple(sp.Symbol(n, real=True) for n in STATE_NAMES)
SAMPLING_PERIOD = sp.Symbol("T", positive=True)
"""Sampling time [s]."""


def rates() -> sp.Matrix:
    """The derivative of the augmented state without its noise, which drives x2 alone; shape (5, 1)."""
    _, x2, _, _, beta = STATES
    return sp.Matrix([x2, -beta * x2, 0, 0, 0])


def output() -> sp.Expr:
    """What is measured, without its noise."""
    x1, x2, B, K, beta = STATES
    return K * beta * x1 + sp.sqrt(K**2 + beta**2 * B**2) * x2


def transition() -> sp.Matrix:
    """``A`` of eq. (22): the Jacobian of Euler's step, shape (5, 5)."""
    return step().jacobian(sp.Matrix(STATES))


def step() -> sp.Matrix:
    """Euler's step of the augmented state, eq. (19), shape (5, 1)."""
    return sp.Matrix(STATES) + SAMPLING_PERIOD * rates()


def output_row() -> sp.Matrix:
    """``C`` of eq. (22): the Jacobian of the output, shape (1, 5)."""
    return sp.Matrix([output()]).jacobian(sp.Matrix(STATES))


@cache
def numbers() -> Callable[..., Any]:
    """A function of ``(x1, x2, B, K, beta, T)``: the step (5), A by rows (25), the output (1), C (5), as a tuple."""
    everything = [
        sp.Float(e) if e.is_number else e for e in (*step(), *transition(), output(), *output_row())
    ]
    return sp.lambdify((*STATES, SAMPLING_PERIOD), tuple(everything), modules="math", cse=True)  # type: ignore[no-any-return]


def frozen_observability() -> sp.Matrix:
    """``[C; C A; ... C A^4]`` with A and C held at one state, of which the paper takes the condition number.

    Its rank is 3 for every state and every parameter: the condition number is infinite, and any finite one is
    rounding.
    """
    row, rows = output_row(), []
    for _ in STATES:
        rows.append(row)
        row = row * transition()
    return sp.Matrix.vstack(*rows)


def hidden_directions() -> tuple[sp.Matrix, ...]:
    """Two errors that `frozen_observability` does not see, one with B and one with K, each shape (5, 1).

    A leaves errors of x1, B and K where they are: a sum of them that C maps to zero is never seen, and two of
    three are.
    """
    x1, _, B, K, _ = (sp.eye(len(STATES)).col(i) for i in range(len(STATES)))
    C = output_row()
    return tuple((e - x1 * (C * e)[0] / C[0]).applyfunc(sp.simplify) for e in (B, K))
