"""From the straight-line form to the intermediate form: what is read once is written in place, what is read again is a local."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence

import sympy as sp

from kfgen.core.errors import InputError
from kfgen.core.straight_line import CONSTANT, Operation, straight_line
from kfgen.emit.ir import functions
from kfgen.emit.ir.ir import Bin, Expr, Let, Num, Ref, Stmt, Una, add, mul, neg, sub

ARITHMETIC: dict[str, Callable[..., Expr]] = {
    "neg": neg,
    "add": add,
    "sub": sub,
    "mul": mul,
    "div": lambda a, b: Bin("/", a, b),
    "inv": lambda a: Bin("/", Num(1.0), a),
    "sqrt": lambda a: Una("sqrt", a),
}
"""Operations that every core has."""
FUNCTIONS: dict[str, Callable[..., Expr]] = {
    "sin": functions.sine,
    "cos": functions.cosine,
    "tan": functions.tangent,
    "exp": functions.exponential,
    "tanh": functions.hyperbolic_tangent,
    "atan": functions.arctangent,
    "atan2": functions.arctangent2,
    "abs": lambda x, _: Una("abs", x),
    "sign": lambda x, _: Una("sign", x),
}
"""Operations on locals that make locals of their own."""


class Lowering:
    """Turns expressions into statements; local names are unique over its life.

    Parameters
    ----------
    places : mapping of str to Expr
        What stands for each symbol: an element, or a local.
    prefix : str
        Begins every local name, so that two lowerings can share a routine.
    """

    def __init__(self, places: Mapping[str, Expr], prefix: str = "") -> None:
        self.places: dict[str, Expr] = dict(places)
        self.prefix = prefix
        self._next = 0

    def fresh(self, stem: str = "t") -> str:
        """A new local name."""
        name = f"{self.prefix}{stem}{self._next}"
        self._next += 1
        return name

    def let(self, value: Expr, stem: str = "t") -> tuple[Expr, list[Stmt]]:
        """The value as an atom, and the statement that makes it.

        Parameters
        ----------
        value : Expr
            An atom, or the negative of one, stays as it is and needs no statement.
        stem : str
            Begins the local's name.
        """
        core = value.a if isinstance(value, Una) and value.op == "neg" else value
        if isinstance(core, Num | Ref):
            return value, []
        name = self.fresh(stem)
        if core is not value:
            return neg(Ref(name)), [Let(name, core)]
        return Ref(name), [Let(name, value)]

    def many(self, expressions: Sequence[sp.Expr]) -> tuple[list[Expr], list[Stmt]]:
        """Lower several expressions together, sharing what they have in common.

        Returns
        -------
        values : list of Expr
            One for each expression.
        body : list of Stmt
            The locals that they read.

        Raises
        ------
        InputError
            A function that emitted code lacks, or a symbol that lives nowhere.
        """
        symbols = sorted(set().union(*(e.free_symbols for e in expressions)), key=lambda s: str(s.name))
        missing = [s.name for s in symbols if s.name not in self.places]
        if missing:
            raise InputError(f"the symbol {missing[0]} has no place in the emitted filter")
        line = straight_line(expressions, symbols, order="canonical")
        reads = Counter((*line.outputs, *(p for o in line.operations for p in o.operands)))
        body: list[Stmt] = []

        def local(value: Expr, stem: str = "u") -> Expr:
            atom, statements = self.let(value, stem)
            body.extend(statements)
            return atom

        values = [self.places[s.name] for s in line.variables]
        for place, operation in enumerate(line.operations[len(values) :], len(values)):
            value = _value(operation, [values[p] for p in operation.operands], local)
            values.append(local(value, "t") if reads[place] > 1 else value)
        return [values[p] for p in line.outputs], body


def _value(operation: Operation, operands: Sequence[Expr], local: Callable[[Expr], Expr]) -> Expr:
    """An operation as an expression on its operands."""
    if operation.name == CONSTANT:
        return Num(float(operation.value))
    if operation.name in ARITHMETIC:
        return ARITHMETIC[operation.name](*operands)
    if operation.name in FUNCTIONS:
        return local(FUNCTIONS[operation.name](*map(local, operands), local))
    raise InputError(
        f"the function {operation.name} cannot be emitted",
        remedy=f"Can be: + - * /, whole powers and their halves, sqrt, {', '.join(FUNCTIONS)}",
    )
