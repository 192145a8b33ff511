"""Sums of products: so that what cancels is gone, and nothing else is touched."""

from __future__ import annotations

import math
from collections.abc import Set

import sympy as sp

LONGEST = 16
"""Products of one term beyond which it stays factored: it is a function of the place, and cancels with nothing."""


def expanded(M: sp.Matrix) -> sp.Matrix:
    """A matrix whose entries are sums of products; what is no polynomial stays as it is."""
    return M.applyfunc(lambda e: e if e.is_Atom else sp.Add(*map(_spread, sp.Add.make_args(e))))


def part_without(e: sp.Expr, symbols: Set[sp.Symbol]) -> sp.Expr:
    """The products of a sum that have none of some symbols in them, without multiplying it out.

    Parameters
    ----------
    e : sympy expression
    symbols : set of Symbol
    """
    if not e.free_symbols & symbols:
        return e
    if e.is_Add or e.is_Mul:
        return e.func(*(part_without(a, symbols) for a in e.args))
    return part_without(e.base, symbols) ** e.exp if _whole(e) else sp.Integer(0)


def _whole(e: sp.Expr) -> bool:
    return bool(e.is_Pow and e.exp.is_Integer and e.exp > 0)


def products(e: sp.Expr) -> int:
    """How many products an expression has once expanded."""
    if e.is_Add:
        return sum(map(products, e.args))
    if e.is_Mul:
        return math.prod(map(products, e.args))
    return products(e.base) ** int(e.exp) if _whole(e) else 1


def _opaque(e: sp.Expr) -> set[sp.Expr]:
    """The largest parts that are no polynomials."""
    if e.is_Atom:
        return set()
    if e.is_Add or e.is_Mul:
        return set().union(*map(_opaque, e.args))
    return _opaque(e.base) if _whole(e) else {e}


def _spread(term: sp.Expr) -> sp.Expr:
    if not 1 < products(term) <= LONGEST:
        return term
    held = {part: sp.Dummy(real=True) for part in sorted(_opaque(term), key=sp.default_sort_key)}
    return sp.expand(term.xreplace(held)).xreplace({d: part for part, d in held.items()})
