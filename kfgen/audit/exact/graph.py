"""`Graph`: expressions as a list of operations, for power series in a ring.

Numbers stay the fractions that they are written as; what expressions have in common is done once.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from fractions import Fraction
from typing import Any

import sympy as sp

from kfgen.core.errors import InputError


class Graph:
    """Collects operations; what expressions have in common is done once.

    Parameters
    ----------
    variables : sequence of Symbol
        Places 0, 1, ... in order.
    """

    def __init__(self, variables: Sequence[sp.Symbol]) -> None:
        self.variables = len(variables)
        self.operations: list[tuple[str, tuple[Any, ...]]] = [("given", ())] * len(variables)
        self.known: dict[sp.Expr, int] = {s: k for k, s in enumerate(variables)}

    def _do(self, name: str, *operands: Any) -> int:
        self.operations.append((name, operands))
        return len(self.operations) - 1

    def place(self, e: sp.Expr) -> int:
        """The place of an expression's value."""
        if e not in self.known:
            self.known[e] = self._placed(e)
        return self.known[e]

    def _placed(self, e: sp.Expr) -> int:
        if e.is_Symbol:
            raise InputError(f"the symbol {e.name} has no value")
        if e.is_Rational:
            return self._do("constant", Fraction(int(e.p), int(e.q)))
        if e.is_Float:
            return self._do("constant", decimal(e))
        if e.is_number and not e.args:
            return self._do("constant", decimal(sp.Float(e, 17)))
        if e.is_Add:
            return self._folded("add", e.args)
        if e.is_Mul:
            return self._folded("mul", e.args)
        if e.is_Pow:
            return self._power(e.base, e.exp)
        return self._function(e)

    def _folded(self, name: str, parts: Sequence[sp.Expr]) -> int:
        first, *others = [self.place(x) for x in parts]
        for other in others:
            first = self._do(name, first, other)
        return first

    def _power(self, base: sp.Expr, exponent: sp.Expr) -> int:
        if exponent.is_negative and exponent.is_number:
            return self._do("inv", self.place(base**-exponent))
        if exponent.is_Float and (2 * exponent) == int(2 * exponent):
            exponent = sp.Rational(int(2 * exponent), 2)
        if exponent.is_Integer:
            half = self.place(base ** (exponent // 2)) if exponent > 1 else self.place(base)
            square = self._do("mul", half, half) if exponent > 1 else half
            return self._do("mul", square, self.place(base)) if exponent > 2 and exponent % 2 else square
        if exponent.is_Rational and exponent.q == 2:
            root = self._do("sqrt", self.place(base))
            whole = int(exponent - sp.Rational(1, 2))
            return self._do("mul", root, self.place(base**whole)) if whole else root
        return self.place(sp.exp(exponent * sp.log(base), evaluate=False))

    def _function(self, e: sp.Expr) -> int:
        rewrite = _REWRITTEN.get(e.func)
        if rewrite is not None:
            return self.place(rewrite(*e.args))
        if e.func in (sp.sin, sp.cos):
            u = self.place(e.args[0])
            key = sp.Tuple(sp.Integer(u))  # sine and cosine of one place are a pair
            if key not in self.known:
                self.known[key] = self._do("sin", u)
                self._do("cos", u, self.known[key])
            return self.known[key] + (e.func is sp.cos)
        name = _FUNCTIONS.get(e.func)
        if name is None:
            raise InputError(f"the audit knows no power series of {e.func}")
        return self._do(name, *(self.place(a) for a in e.args))


def decimal(e: sp.Float) -> Fraction:
    """A float as the decimal fraction that it is written as: exactly, without a guess."""
    return Fraction(repr(float(e)))


# Absolute values and extrema are one of their smooth branches wherever they have a derivative.
_REWRITTEN: Mapping[Any, Callable[..., sp.Expr]] = {
    sp.tan: lambda u: sp.sin(u) / sp.cos(u),
    sp.Abs: lambda u: u,
    sp.sign: lambda u: sp.Integer(1),
    sp.Min: lambda a, *_: a,
    sp.Max: lambda a, *_: a,
    sp.atan2: lambda y, x: sp.atan(y / x),
    sp.acos: lambda u: -sp.asin(u),
}
_FUNCTIONS: Mapping[Any, str] = {
    sp.exp: "exp",
    sp.log: "log",
    sp.atan: "atan",
    sp.asin: "asin",
    sp.tanh: "tanh",
}
