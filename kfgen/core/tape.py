"""`Tape`: a straight-line form in floating point, run by numpy or by the compiled loop.

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

from kfgen.core.straight_line import BINARY, CONSTANT, UNARY, straight_line

Array = NDArray[np.float64]

CODES = {name: k for k, name in enumerate(UNARY + BINARY)}
"""Numbers of the operations; those of one operand come first."""
_NUMPY: dict[str, str] = {
    "neg": "negative",
    "asin": "arcsin",
    "acos": "arccos",
    "atan": "arctan",
    "inv": "reciprocal",
    "sub": "subtract",
    "mul": "multiply",
    "div": "divide",
    "pow": "power",
    "atan2": "arctan2",
    "min": "minimum",
    "max": "maximum",
}
"""Operations that numpy calls otherwise."""
_OPERATIONS = tuple(getattr(np, _NUMPY.get(name, name)) for name in UNARY + BINARY)

ROWS_AT_ONCE = 8192
"""Values of a variable for which a table is computed at once."""


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

    def table(self, given: Sequence[Array]) -> Array:
        """The expressions for many values of the variables at once, shape (m, o).

        Block by block: of all the operations in between no more is held than those of a block.

        Parameters
        ----------
        given : sequence of ndarray, shape (m,) or (1,)
        """
        m = max((np.size(g) for g in given), default=1)
        out = np.empty((m, self.outputs.size))
        for begin in range(0, m, ROWS_AT_ONCE):
            block = slice(begin, begin + ROWS_AT_ONCE)
            for k, value in enumerate(self.values([g if np.size(g) == 1 else g[block] for g in given])):
                out[block, k] = value
        return out


def tape(expressions: Sequence[sp.Expr], variables: Sequence[sp.Symbol]) -> Tape:
    """Write expressions as a tape, what they have in common once.

    Parameters
    ----------
    expressions : sequence of sympy expression
    variables : sequence of Symbol
        Every symbol of the expressions, in the order in which `Tape.values` is given numbers.

    Returns
    -------
    Tape

    Raises
    ------
    InputError
        A function that no tape has, or a symbol that is no variable.
    """
    line, n = straight_line(expressions, variables), len(variables)
    rest = range(n, len(line.operations))
    constants = [k for k in rest if line.operations[k].name == CONSTANT]
    results = [k for k in rest if line.operations[k].name != CONSTANT]
    register = {k: i for i, k in enumerate((*range(n), *constants, *results))}
    rows = [
        (CODES[o.name], *(register[p] for p in (o.operands * 2)[:2]))
        for o in (line.operations[k] for k in results)
    ]
    return Tape(
        n,
        np.array([float(line.operations[k].value) for k in constants], dtype=np.float64),
        np.array(rows, dtype=np.int64).reshape(-1, 3),
        np.array([register[k] for k in line.outputs], dtype=np.int64),
    )
