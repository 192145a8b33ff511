"""Null directions in the model's parameters: ``-g`` says more than -9.80665. Of systems that do not change with time.

The rows ``H F^k`` are the derivatives of the output with respect to the initial error. Only the states that the exact
engine has found in a direction are looked at, so the matrices stay small.

References
----------
.. [1] R. E. Kalman, On the general theory of control systems, 1960.
"""

from __future__ import annotations

from collections.abc import Sequence

import sympy as sp

from kfgen.manoeuvre.control import control
from kfgen.manoeuvre.manoeuvre import Manoeuvre
from kfgen.model.filter import FilterModel
from kfgen.model.parts.motion import NED
from kfgen.model.symbols.blocks import Vector


def rational(expression: sp.Expr) -> sp.Expr:
    """Floats as the decimal fractions that they are written as: exactly, without a guess."""
    return expression.xreplace({f: sp.Rational(repr(float(f))) for f in expression.atoms(sp.Float)})


def rows_of(F: sp.Matrix, H: sp.Matrix, columns: Sequence[int]) -> sp.Matrix:
    """The rows ``H F^k`` that are not zero, in some columns, shape (m, len(columns)).

    Parameters
    ----------
    F : Matrix, shape (n, n)
    H : Matrix, shape (m, n)
    columns : sequence of int
        States that are looked at.
    """
    V = sp.eye(F.rows).extract(list(range(F.rows)), list(columns))
    found: dict[tuple[sp.Expr, ...], None] = {}
    for _ in range(F.rows):
        for row in (H * V).tolist():
            if any(e != 0 for e in row):
                found[tuple(sp.expand(e) for e in row)] = None
        V = (F * V).applyfunc(sp.expand)
        if V.is_zero_matrix:
            break
    return sp.Matrix(list(found)) if found else sp.zeros(0, len(columns))


def null_of(F: sp.Matrix, H: sp.Matrix, columns: Sequence[int] | None = None) -> list[sp.Matrix]:
    """A basis of the directions in some states that a constant system hides, each one in its first state.

    Parameters
    ----------
    F : Matrix, shape (n, n)
    H : Matrix, shape (m, n)
    columns : sequence of int, optional
        The states that may take part; all when left out.

    Returns
    -------
    list of Matrix, shape (n, 1)
    """
    columns = list(range(F.rows)) if columns is None else list(columns)
    O = rows_of(F, H, columns)
    # Eliminated from the last state backwards, so that the first ones are pivots.
    back = O.extract(list(range(O.rows)), list(range(O.cols - 1, -1, -1)))
    basis = back.nullspace(simplify=True) if O.rows else [sp.eye(O.cols).col(i) for i in range(O.cols)]
    out = []
    for v in reversed(basis):
        entries = list(reversed(list(v)))
        first = next(e for e in entries if e != 0)
        full = sp.zeros(F.rows, 1)
        for c, e in zip(columns, entries):
            full[c] = sp.factor(sp.cancel(e / first))
        out.append(full)
    return out


def at_rest(model: FilterModel, manoeuvre: Manoeuvre) -> tuple[sp.Matrix, sp.Matrix] | None:
    """F and H in the parameters, at the declared start, where nothing changes with time; None where something does.

    Parameters
    ----------
    model : FilterModel
    manoeuvre : Manoeuvre
    """
    moves = any(f != 0 for s in manoeuvre.segments for f in s.formulas(manoeuvre.length))
    if moves or len(manoeuvre.segments) > 1 or any(manoeuvre.attitude[1:]) or any(manoeuvre.velocity):
        return None
    if model.drivers:
        return None
    point: dict[sp.Symbol, sp.Expr] = {}
    found = control(model)
    if model.attitude is not None:
        point |= dict(zip(model.attitude.nominal, sp.eye(3)))
    for b in model.blocks:
        if isinstance(b, Vector):
            placed = found is not None and b.name in ("p", "v")
            if placed and (any(b.start) or tuple(b.axes) != NED):
                return None
            if not placed and any(r != 0 for r in model.rates(False).get(b.name, ())):
                return None
            point |= {s: sp.Rational(repr(float(c))) for s, c in zip(b.nominal, b.start)}
    own = {s for b in model.blocks for s in b.nominal}
    point |= {s.symbol: sp.Integer(0) for s in model.states if s.symbol not in own}
    channels = [sp.Symbol(c, real=True) for i in model.motion.inputs for c in i.channels]
    if found is not None:
        J, b = found.J.subs(point), found.b.subs(point)
        point |= {sp.Symbol(c, real=True): u for c, u in zip(found.channels, J.LUsolve(-b))}
    if any(c not in point for c in channels):
        return None
    H = sp.Matrix.vstack(sp.zeros(0, len(model.states)), *(model.H(s) for s in model.sensors))
    return model.F.subs(point).applyfunc(rational), H.subs(point).applyfunc(rational)
