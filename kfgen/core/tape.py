"""`Tape`: expressions as a list of operations on registers, run by numpy or by the compiled loop.

Nothing is generated as code: a tape is data. The first registers hold the variables, then come
the constants, then results in order.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import sympy as sp
from numpy.typing import NDArray

from kfgen.core.errors import InputError

Array = NDArray[np.float64]

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
BINARY = ("add", "mul", "div", "pow", "atan2", "min", "max")
CODES = {name: k for k, name in enumerate(UNARY + BINARY)}

_FUNCTIONS: dict[Any, str] = {
    sp.sin: "sin",
    sp.cos: "cos",
    sp.tan: "tan",
    sp.asin: "asin",
    sp.acos: "acos",
    sp.atan: "atan",
    sp.exp: "exp",
    sp.log: "log",
    sp.Abs: "abs",
    sp.sign: "sign",
    sp.tanh: "tanh",
    sp.atan2: "atan2",
    sp.Min: "min",
    sp.Max: "max",
}
_NUMPY: dict[str, Any] = {
    "neg": np.negative,
    "asin": np.arcsin,
    "acos": np.arccos,
    "atan": np.arctan,
    "inv": np.reciprocal,
    "mul": np.multiply,
    "div": np.divide,
    "pow": np.power,
    "atan2": np.arctan2,
    "min": np.minimum,
    "max": np.maximum,
}


def _numpy(name: str) -> Any:
    return _NUMPY[name] if name in _NUMPY else getattr(np, name)


_OPERATIONS = tuple(_numpy(name) for name in UNARY + BINARY)


@dataclass(frozen=True)
class Tape:
    """Operations on registers.

    Parameters
    ----------
    variables : int
        Registers that are given.
    constants : ndarray, shape (c,)
        The registers after them.
    operations : ndarray of int64, shape (m, 3)
        Code, first and second operand; the result of operation i is in register ``variables + c + i``.
    outputs : ndarray of int64, shape (o,)
        Where the values of the expressions are.
    """

    variables: int
    constants: Array
    operations: NDArray[np.int64]
    outputs: NDArray[np.int64]

    @property
    def registers(self) -> int:
        """How many there are."""
        return self.variables + int(self.constants.size) + int(self.operations.shape[0])

    def values(self, given: Sequence[Any]) -> list[Any]:
        """The expressions for values of the variables, which broadcast against each other."""
        r: list[Any] = [*given, *self.constants]
        for code, a, b in self.operations.tolist():
            f = _OPERATIONS[code]
            r.append(f(r[a]) if code < len(UNARY) else f(r[a], r[b]))
        return [r[k] for k in self.outputs.tolist()]


def tape(expressions: Sequence[sp.Expr], variables: Sequence[sp.Symbol]) -> Tape:
    """Write expressions as a tape, what they have in common once.

    Raises
    ------
    InputError
        A function that no tape has, or a symbol that is no variable.
    """
    shared, reduced = sp.cse(list(expressions), symbols=sp.numbered_symbols("__cse"), order="none")
    writer = _Writer({s: k for k, s in enumerate(variables)})
    for name, value in shared:
        writer.known[name] = writer.place(value)
    outputs = [writer.place(e) for e in reduced]
    return writer.finished(len(variables), outputs)


class _Writer:
    """Collects operations; constants get negative places until their number is known."""

    def __init__(self, known: dict[sp.Expr, int]) -> None:
        self.known = known
        self.variables = len(known)
        self.constants: list[float] = []
        self.rows: list[tuple[int, int, int]] = []
        self._numbers: dict[float, int] = {}

    def finished(self, variables: int, outputs: list[int]) -> Tape:
        """The tape: variables, constants, results."""
        c = len(self.constants)

        def real(k: int) -> int:
            if k < 0:
                return variables - k - 1
            return k if k < variables else k + c

        rows = [(code, real(a), real(b)) for code, a, b in self.rows]
        return Tape(
            variables,
            np.array(self.constants, dtype=np.float64),
            np.array(rows, dtype=np.int64).reshape(-1, 3),
            np.array([real(k) for k in outputs], dtype=np.int64),
        )

    def number(self, value: float) -> int:
        """The place of a constant."""
        if value not in self._numbers:
            self.constants.append(value)
            self._numbers[value] = -len(self.constants)
        return self._numbers[value]

    def do(self, name: str, a: int, b: int = 0) -> int:
        """The place of a result."""
        self.rows.append((CODES[name], a, b))
        return self.variables + len(self.rows) - 1

    def place(self, e: sp.Expr) -> int:
        """The place of an expression's value."""
        if e in self.known:
            return int(self.known[e])
        if e.is_Symbol:
            raise InputError(f"the symbol {e.name} has no value")
        if e.is_number:
            return self.number(float(e))
        if e.is_Add:
            return self._all("add", e.args)
        if e.is_Mul:
            return self._product(e)
        if e.is_Pow:
            return self._power(e.base, e.exp)
        name = _FUNCTIONS.get(e.func)
        if name is None:
            raise InputError(f"the function {e.func} has no numbers")
        return self.do(name, self.place(e.args[0])) if name in UNARY else self._all(name, e.args)

    def _all(self, name: str, expressions: Sequence[sp.Expr]) -> int:
        """The place of what a binary operation makes of several expressions, from the left."""
        value, *others = [self.place(x) for x in expressions]
        for other in others:
            value = self.do(name, value, other)
        return value

    def _product(self, e: sp.Mul) -> int:
        below = [f for f in e.args if f.is_Pow and f.exp.is_number and float(f.exp) < 0]
        above = [f for f in e.args if f not in below and f != -1]
        value = self._all("mul", above or [sp.Integer(1)])
        for f in below:
            value = self.do("div", value, self._power(f.base, -f.exp))
        return self.do("neg", value) if -1 in e.args else value

    def _power(self, base: sp.Expr, exponent: sp.Expr) -> int:
        b = self.place(base)
        if exponent == sp.Rational(1, 2):
            return self.do("sqrt", b)
        if exponent.is_Integer:
            value, power = b, abs(int(exponent))
            for bit in bin(power)[3:]:
                value = self.do("mul", value, value)
                value = self.do("mul", value, b) if bit == "1" else value
            return self.do("inv", value) if exponent < 0 else value if power else self.number(1.0)
        return self.do("pow", b, self.place(exponent))
