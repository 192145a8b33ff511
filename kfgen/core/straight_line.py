"""`StraightLine`: sympy expressions as a list of named operations of one or two operands, each done once.

All numbers that kfgen works out of expressions come from this one form: `kfgen.core.tape` runs it in floating point (numpy,
numba), `kfgen.audit.exact.power_series` on power series over a ring, `kfgen.emit.ir.lower` turns it into code. What a number is
(a float, an exact fraction) and which functions there are is theirs; how sums, products and powers are decomposed is decided here.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import reduce
from typing import Any, NamedTuple

import sympy as sp

from kfgen.core.errors import InputError

Number = float | Fraction
Numbers = Callable[[sp.Expr], Number | None]
"""The number of an expression without symbols; None where it is to be worked out by operations."""
Rewrites = Mapping[Any, Callable[..., sp.Expr]]
"""Functions (or `sympy.Pow`, of any exponent that is no multiple of a half) in terms of others."""

GIVEN, CONSTANT = "given", "constant"
UNARY = (
    "neg",
    "sin",
    "cos",
    "tan",
    "asin",
    "acos",
    "atan",
    "exp",
    "log",
    "sqrt",
    "abs",
    "sign",
    "tanh",
    "inv",
)
BINARY = ("add", "sub", "mul", "div", "pow", "atan2", "min", "max")
FUNCTIONS: Mapping[Any, str] = {
    getattr(sp, name): name.lower()
    for name in ("sin", "cos", "tan", "asin", "acos", "atan", "exp", "log", "Abs", "sign", "tanh")
} | {sp.atan2: "atan2", sp.Min: "min", sp.Max: "max"}
"""sympy's functions and the operations that they are."""

_COMMUTE = frozenset(("add", "mul", "min", "max"))


class Operation(NamedTuple):
    """One operation: ``given`` (a variable), ``constant`` (of `value`), or a name of `UNARY` or `BINARY`."""

    name: str
    operands: tuple[int, ...] = ()
    """Places of the operations that it reads; all come before it."""
    value: Number = 0.0


@dataclass(frozen=True)
class StraightLine:
    """Expressions as operations, in an order in which they can be done.

    Parameters
    ----------
    variables : tuple of Symbol
        What the first operations are given.
    operations : tuple of Operation
        An operation's place is its number in here.
    outputs : tuple of int
        Places of the values of the expressions.
    """

    variables: tuple[sp.Symbol, ...]
    operations: tuple[Operation, ...]
    outputs: tuple[int, ...]


def in_floating_point(e: sp.Expr) -> float | None:
    """Any number, as the nearest float."""
    return float(e) if e.is_number else None


def as_written(e: sp.Expr) -> Fraction | None:
    """A number as the fraction that it is written as, exactly; what roots and functions make of numbers stays operations."""
    if e.is_Rational:
        return Fraction(int(e.p), int(e.q))
    return decimal(float(e)) if not e.args and e.is_number else None


def decimal(value: float) -> Fraction:
    """A float as the decimal fraction that it is written as: exactly, without a guess."""
    return Fraction(repr(float(value)))


def straight_line(
    expressions: Sequence[sp.Expr],
    variables: Sequence[sp.Symbol],
    *,
    order: str = "none",
    numbers: Numbers = in_floating_point,
) -> StraightLine:
    """Write expressions down, what they have in common once.

    Parameters
    ----------
    expressions : sequence of sympy expression
    variables : sequence of Symbol
        Every symbol of the expressions, in the order in which values are given.
    order : str
        Of the operands of sums and products, as of `sympy.cse`: ``"canonical"`` (the same on every machine) or ``"none"`` (faster).
    numbers : callable
        `in_floating_point` or `as_written`.

    Returns
    -------
    StraightLine

    Raises
    ------
    InputError
        A function outside of `FUNCTIONS`, or a symbol that is no variable.
    """
    shared, reduced = sp.cse(list(expressions), symbols=sp.numbered_symbols("__cse"), order=order)
    writer = Writer(variables, numbers)
    for name, value in shared:
        writer.name(name, value)
    outputs = tuple(writer.place(e) for e in reduced)
    return StraightLine(tuple(variables), tuple(writer.operations), outputs)


class Writer:
    """Writes operations one after the other; one that was done before is not done again.

    Parameters
    ----------
    variables : sequence of Symbol
        Places 0, 1, ... in order.
    numbers : callable
        As of `straight_line`.
    rewrites : mapping of function to callable, optional
        Functions that are written in terms of others.
    """

    def __init__(
        self,
        variables: Sequence[sp.Symbol],
        numbers: Numbers = in_floating_point,
        rewrites: Rewrites | None = None,
    ) -> None:
        self.variables = tuple(variables)
        self.operations: list[Operation] = [Operation(GIVEN)] * len(self.variables)
        self.numbers = numbers
        self.rewrites = rewrites or {}
        self._known: dict[sp.Expr, tuple[int, int]] = {s: (1, k) for k, s in enumerate(self.variables)}
        self._done: dict[Operation, int] = {}

    def name(self, symbol: sp.Symbol, value: sp.Expr) -> None:
        """Let a symbol stand for an expression from now on.

        Parameters
        ----------
        symbol : Symbol
        value : sympy expression
            Of variables and of symbols that were named before.
        """
        self._known[symbol] = self._signed(value)

    def place(self, e: sp.Expr) -> int:
        """The place of an expression's value; raises as `straight_line`."""
        sign, place = self._signed(e)
        return place if sign > 0 else self._do("neg", place)

    def _do(self, name: str, *operands: int, value: Number = 0.0) -> int:
        operation = Operation(name, operands, value)
        key = operation._replace(operands=tuple(sorted(operands))) if name in _COMMUTE else operation
        if key not in self._done:
            self.operations.append(operation)
            self._done[key] = len(self.operations) - 1
        return self._done[key]

    def _signed(self, e: sp.Expr) -> tuple[int, int]:
        """A sign and the place of what it stands before: signs move outwards, where sums become differences."""
        if e not in self._known:
            self._known[e] = self._written(e)
        return self._known[e]

    def _written(self, e: sp.Expr) -> tuple[int, int]:
        if e.is_Symbol:
            raise InputError(f"the symbol {e.name} has no value")
        number = self.numbers(e)
        if number is not None:
            return 1, self._do(CONSTANT, value=number)
        if e.is_Add:
            return 1, self._sum(e.args)
        if e.is_Mul:
            return self._product(e.args)
        if e.is_Pow:
            return self._power(e.base, e.exp)
        if e.func in self.rewrites:
            return self._signed(self.rewrites[e.func](*e.args))
        name = FUNCTIONS.get(e.func)
        if name is None:
            raise InputError(
                f"the function {e.func} has no numbers", remedy=f"Known are {', '.join(FUNCTIONS.values())}"
            )
        places = [self.place(a) for a in e.args]
        return 1, self._do(name, *places) if name in UNARY else self._folded(name, places)

    def _folded(self, name: str, places: Sequence[int]) -> int:
        """A binary operation over several operands, from the left."""
        return reduce(lambda a, b: self._do(name, a, b), places)

    def _sum(self, terms: Sequence[sp.Expr]) -> int:
        """Positive terms first, so that it does not begin with a minus where that can be helped."""
        (sign, value), *others = sorted(map(self._signed, terms), key=lambda t: -t[0])
        value = value if sign > 0 else self._do("neg", value)
        for sign, term in others:
            value = self._do("add" if sign > 0 else "sub", value, term)
        return value

    def _product(self, factors: Sequence[sp.Expr]) -> tuple[int, int]:
        """One product over another: a quotient is one division."""
        sign, above, below = 1, list[int](), list[int]()
        for f in factors:
            if f.is_Number and abs(f) == 1:
                sign *= int(f)
                continue
            under = f.is_Pow and not f.base.is_number and f.exp.is_number and f.exp.is_negative
            s, place = self._power(f.base, -f.exp) if under else self._signed(f)
            sign *= s
            (below if under else above).append(place)
        if not above:
            return sign, self._do("inv", self._folded("mul", below))
        value = self._folded("mul", above)
        return sign, self._do("div", value, self._folded("mul", below)) if below else value

    def _power(self, base: sp.Expr, exponent: sp.Expr) -> tuple[int, int]:
        """Whole powers by squaring, halves by a square root."""
        if exponent.is_number and exponent.is_negative:
            sign, value = self._power(base, -exponent)
            return sign, self._do("inv", value)
        if exponent.is_Float and 2 * exponent == int(2 * exponent):
            exponent = sp.Rational(int(2 * exponent), 2)
        if exponent.is_Integer:
            sign, value = self._signed(base)
            return sign ** int(exponent), self._whole_power(value, int(exponent))
        if exponent.is_Rational and exponent.q == 2:
            value = self.place(base)
            root, whole = self._do("sqrt", value), int(exponent.p) // 2
            return 1, self._do("mul", root, self._whole_power(value, whole)) if whole else root
        if sp.Pow in self.rewrites:
            return self._signed(self.rewrites[sp.Pow](base, exponent))
        return 1, self._do("pow", self.place(base), self.place(exponent))

    def _whole_power(self, value: int, n: int) -> int:
        if n == 1:
            return value
        half = self._whole_power(value, n // 2)
        square = self._do("mul", half, half)
        return self._do("mul", square, value) if n % 2 else square
