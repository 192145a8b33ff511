"""Exact null directions of a linear(ised) model along an operating point.

The rows ``h_0 = H``, ``h_(k+1) = dh_k/dt + h_k F`` are the derivatives of the output with respect to the
initial error; a direction that all of them map to zero changes no measurement, ever. Arithmetic is
rational: numbers are taken as the fractions that they are written as, drivers and their derivatives as
free symbols, so a rank is a fact and not a tolerance.

References
----------
.. [1] R. Hermann and A. J. Krener, Nonlinear controllability and observability, IEEE TAC 22(5), 1977.
.. [2] L. M. Silverman and H. E. Meadows, Controllability and observability in time-variable linear
   systems, SIAM J. Control 5(1), 1967, eq. (2.9).
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import sympy as sp

from kfgen.model.filter import FilterModel


def operating_point(model: FilterModel) -> dict[sp.Symbol, sp.Expr]:
    """At rest, level, body axes along north, east and down: what the symbols of F and H are there."""
    point: dict[sp.Symbol, sp.Expr] = {s.symbol: sp.Integer(0) for s in model.states}
    for triad in model.motion.inputs:
        for channel in triad.channels:
            point[sp.Symbol(channel, real=True)] = sp.Integer(0)
    if "accel_z" in {c for i in model.motion.inputs for c in i.channels}:
        point[sp.Symbol("accel_z", real=True)] = -sp.Symbol("g", real=True)
    if model.attitude is not None:
        identity = sp.eye(3)
        point |= dict(zip(model.attitude.nominal, identity))
    return point


def rational(expression: sp.Expr) -> sp.Expr:
    """Floats as the decimal fractions that they are written as: exactly, without a guess."""
    return expression.xreplace({f: sp.Rational(repr(float(f))) for f in expression.atoms(sp.Float)})


def observability_rows(F: sp.Matrix, H: sp.Matrix, drivers: Sequence[sp.Symbol]) -> sp.Matrix:
    """All derivatives of the output up to the number of states, shape (m n, n).

    Parameters
    ----------
    F : Matrix, shape (n, n)
    H : Matrix, shape (m, n)
    drivers : sequence of Symbol
        Symbols that change with time; their derivatives are free symbols.
    """
    chain = {d: [d, *(sp.Symbol(f"{d.name}__{k}", real=True) for k in range(1, F.rows + 1))] for d in drivers}
    rows, block = [H], H
    for _ in range(F.rows - 1):
        change = sp.zeros(*block.shape)
        for symbols in chain.values():
            for now, then in pairwise(symbols):
                change += block.diff(now) * then
        block = change + block * F
        rows.append(block)
    return sp.Matrix.vstack(*rows)


def null_directions(model: FilterModel, sensors: Sequence[str] = ()) -> tuple[sp.Matrix, ...]:
    """The hidden directions of a model at its operating point.

    Parameters
    ----------
    model : FilterModel
    sensors : sequence of str, optional
        Names of the sensors in use; all when left out.

    Returns
    -------
    tuple of Matrix, shape (n, 1)
        A basis with rational entries and parameters, each scaled to one in its leading state.
    """
    point = operating_point(model)
    used = [model.sensor(n) for n in sensors] if sensors else list(model.sensors)
    F = model.F.subs(point).applyfunc(rational)
    H = sp.Matrix.vstack(*(model.H(s) for s in used)).subs(point).applyfunc(rational)
    drivers = [sp.Symbol(d, real=True) for d in model.drivers]
    O = observability_rows(F, H, drivers)
    keep = [i for i in range(O.rows) if any(e != 0 for e in O.row(i))]
    return tuple(_leading(v) for v in _sparse(O.extract(keep, list(range(O.cols)))))


def _sparse(O: sp.Matrix) -> list[sp.Matrix]:
    """A null basis in which the first states lead: eliminated from the last column backwards."""
    n = O.cols
    if O.rows == 0:
        return [sp.eye(n).col(i) for i in range(n)]
    flipped = O.extract(list(range(O.rows)), list(range(n - 1, -1, -1)))
    basis = flipped.nullspace(simplify=True)
    return [sp.Matrix(list(reversed(list(v)))) for v in reversed(basis)]


def _leading(v: sp.Matrix) -> sp.Matrix:
    first = next(e for e in v if e != 0)
    return (v / first).applyfunc(sp.simplify)
