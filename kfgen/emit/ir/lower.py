"""From sympy to the intermediate form: common parts once, every operation binary."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import reduce
from typing import Any

import sympy as sp

from kfgen.core.errors import InputError
from kfgen.emit.ir import functions
from kfgen.emit.ir.ir import Bin, Expr, Let, Num, Ref, Stmt, Una, add, mul, neg

FUNCTIONS: dict[Any, Callable[[Expr, Callable[[Expr], Expr]], Expr]] = {
    sp.sin: functions.sine,
    sp.cos: functions.cosine,
    sp.tan: functions.tangent,
    sp.exp: functions.exponential,
    sp.tanh: functions.hyperbolic_tangent,
    sp.atan: functions.arctangent,
    sp.Abs: lambda x, _: Una("abs", x),
    sp.sign: lambda x, _: Una("sign", x),
}
LONGEST_POWER = 8
ONE: Expr = Num(1.0)


class Lowering:
    """Turns expressions into statements; local names are unique over its life.

    Parameters
    ----------
    places : mapping of str to Expr
        What stands for each symbol: an element, a local, or its negative.
    prefix : str
        Begins every local name, so that two lowerings can share a routine.
    """

    def __init__(self, places: Mapping[str, Expr], prefix: str = "") -> None:
        self.places: dict[str, Expr] = dict(places)
        self.prefix = prefix
        self._next = 0
        self._pending: list[Stmt] = []

    def fresh(self, stem: str = "t") -> str:
        """A new local name."""
        name = f"{self.prefix}{stem}{self._next}"
        self._next += 1
        return name

    def let(self, value: Expr, stem: str = "t") -> tuple[Expr, list[Stmt]]:
        """The value as an atom: itself, or a new local and the statement that makes it."""
        core = value.a if isinstance(value, Una) and value.op == "neg" else value
        if isinstance(core, Num | Ref):
            return value, []
        name = self.fresh(stem)
        if core is not value:
            return neg(Ref(name)), [Let(name, core)]
        return Ref(name), [Let(name, value)]

    def many(self, expressions: Sequence[sp.Expr]) -> tuple[list[Expr], list[Stmt]]:
        """Lower several expressions together, sharing what they have in common."""
        shared, reduced = sp.cse(list(expressions), symbols=sp.numbered_symbols("__cse"), order="canonical")
        body: list[Stmt] = []
        for symbol, value in shared:
            atom, statements = self.let(self.expression(value))
            body += [*self._made(), *statements]
            self.places[symbol.name] = atom
        values = [self.expression(e) for e in reduced]
        body += self._made()
        for symbol, _ in shared:
            del self.places[symbol.name]
        return values, body

    def expression(self, e: sp.Expr) -> Expr:
        """One expression, without sharing.

        Raises
        ------
        InputError
            It has a function that the intermediate form lacks, or a symbol that lives nowhere.
        """
        if e.is_Symbol:
            if e.name not in self.places:
                raise InputError(f"the symbol {e.name} has no place in the emitted filter")
            return self.places[e.name]
        if e.is_Number:
            return Num(float(e))
        if e.is_Add:
            return reduce(add, sorted(map(self.expression, e.args), key=_negative))
        if e.is_Mul:
            return self._product(e)
        if e.is_Pow:
            return self._power(e.base, e.exp)
        if e.func in FUNCTIONS:
            value = FUNCTIONS[e.func](self._local(self.expression(e.args[0])), self._local)
            return self._local(value)
        if e.func == sp.atan2:
            y, x = (self._local(self.expression(a)) for a in e.args)
            return self._local(functions.arctangent2(y, x, self._local))
        raise InputError(
            f"the function {e.func} cannot be emitted",
            remedy=f"Can be: + - * /, whole powers, sqrt, atan2, {', '.join(str(f) for f in FUNCTIONS)}",
        )

    def _local(self, value: Expr) -> Expr:
        """A value as an atom; the statement that makes it comes before the next one of `many`."""
        atom, statements = self.let(value, "u")
        self._pending += statements
        return atom

    def _made(self) -> list[Stmt]:
        """Statements of functions' values that are not yet in a body."""
        made, self._pending = self._pending, []
        return made

    def _product(self, e: sp.Mul) -> Expr:
        above, below = [], []
        for factor in e.args:
            if factor.is_Pow and factor.exp.is_Integer and factor.exp < 0:
                below.append(self._power(factor.base, -factor.exp))
            else:
                above.append(self.expression(factor))
        sign = [f for f in above if f == Num(-1.0)]
        above = [f for f in above if f != Num(-1.0)]
        value = reduce(mul, above, ONE)
        if below:
            value = Bin("/", value, reduce(mul, below))
        return neg(value) if len(sign) % 2 else value

    def _power(self, base: sp.Expr, exponent: sp.Expr) -> Expr:
        if (2 * exponent).is_Integer and not exponent.is_Integer and abs(exponent) < LONGEST_POWER:
            b, whole = self.expression(base), int(abs(exponent))
            b = self._local(b) if whole else b
            start: Expr = Una("sqrt", b)
            root = reduce(mul, [b] * whole, start)
            return root if exponent > 0 else Bin("/", Num(1.0), root)
        if not exponent.is_Integer or abs(int(exponent)) > LONGEST_POWER:
            raise InputError(f"the power {exponent} cannot be emitted")
        b = self.expression(base)
        value = reduce(mul, [b] * abs(int(exponent)), ONE)
        return Bin("/", Num(1.0), value) if exponent < 0 else value


def _negative(e: Expr) -> bool:
    """Negative terms last, so that a sum does not begin with a minus."""
    return isinstance(e, Una) and e.op == "neg"
