"""The reference: the intermediate form run by numpy in a chosen precision, operation by operation.

It interprets the same routines that the targets print, so a value that differs on a core is a
difference of printing, compiling or arithmetic, never of derivation.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kfgen.emit.covariance.packed import place
from kfgen.emit.geodetic.origin import Border
from kfgen.emit.ir.ir import (
    STATUS,
    Bin,
    Cell,
    Condition,
    Cursor,
    Expr,
    For,
    FunctionCall,
    Let,
    Num,
    Ref,
    Routine,
    StatusFlag,
    Stmt,
    Store,
    Una,
    When,
    comparisons,
    turns,
)
from kfgen.emit.routines import Program


class Machine:
    """The arrays of one filter, and its routines.

    Parameters
    ----------
    program : Program
    real : type, optional
        ``np.float32`` or ``np.float64``; the program's own where left out.
    """

    def __init__(self, program: Program | Border, real: type[np.floating[Any]] | None = None) -> None:
        self.program = program
        self.real = real or program.type
        self.arrays: dict[str, NDArray[np.floating[Any]]] = {
            a: np.zeros(size, self.real) for a, (size, _) in program.arrays.items()
        }
        self.routines: dict[str, Routine] = {r.name: r for r in (*program.routines, *program.helpers)}
        self._rows = [place(program.n, i, 0) for i in range(program.n)]
        self._numbers: dict[float, Any] = {}

    def call(self, name: str, values: Sequence[Sequence[float] | float] = ()) -> str:
        """Run a routine; returns its status.

        Parameters
        ----------
        name : str
        values : sequence
            One per argument, arrays as sequences.
        """
        routine = self.routines[name]
        env: dict[str, Any] = dict(self.arrays)
        defaults = [
            [float(self._value(n, {})) for n in a.default]
            for a in routine.arguments[len(values) :]
            if a.default
        ]
        for argument, value in zip(routine.arguments, [*values, *defaults], strict=True):
            env[argument.name] = np.asarray(value, self.real) if argument.size else self.real(value)  # type: ignore[arg-type]
        with np.errstate(all="ignore"):
            return self._enter(routine, env)

    def _enter(self, routine: Routine, env: dict[str, Any]) -> str:
        env |= {s.name: np.zeros(s.size, self.real) for s in routine.scratch}
        env["status"] = STATUS[0]
        self._run(routine.body, env)
        return str(env["status"])

    def words(self) -> NDArray[np.floating[Any]]:
        """State, covariance and the supervisor's counts, one after the other."""
        return np.concatenate([self.arrays[name] for name in self.program.compared])

    def covariance(self) -> NDArray[np.float64]:
        """The covariance, shape (n, n)."""
        assert isinstance(self.program, Program)
        form = self.program.covariance
        return np.array(form.matrix(self.arrays[form.ARRAY].tolist()))

    def _run(self, body: tuple[Stmt, ...], env: dict[str, Any]) -> None:
        for s in body:
            if isinstance(s, Let):
                env[s.name] = self._value(s.value, env)
            elif isinstance(s, Store):
                env[s.target.name][self._index(s.target, env)] = self._value(s.value, env)
            elif isinstance(s, When):
                self._run(s.body if self._holds(s.condition, env) else s.orelse, env)
            elif isinstance(s, StatusFlag):
                env["status"] = max(env["status"], s.status, key=STATUS.index)
            elif isinstance(s, For):
                for k in turns(s, env):
                    env[s.var] = k
                    self._run(s.body, env)
            elif isinstance(s, FunctionCall):
                said = self._called(s, env)
                env["status"] = max(env["status"], said, key=STATUS.index) if s.merged else env["status"]
            elif isinstance(s, Cursor):
                env[s.name] = int(self._value(s.value, env))

    def _called(self, s: FunctionCall, env: dict[str, Any]) -> str:
        routine = self.routines[s.routine]
        given = {a.name: self._value(e, env) for a, e in zip(routine.arguments, s.arguments, strict=True)}
        return self._enter(routine, self.arrays | given)

    def _index(self, ref: Ref, env: Mapping[str, Any]) -> int:
        if isinstance(ref.index, Cell):
            row, column = (env[k] if isinstance(k, str) else k for k in (ref.index.row, ref.index.column))
            return int(row * ref.index.width + column)
        if isinstance(ref.index, tuple):
            i, j = (env[k] if isinstance(k, str) else k for k in ref.index)
            return int(self._rows[i] + j)
        return int(env[ref.index] if isinstance(ref.index, str) else ref.index or 0)

    def _holds(self, condition: Condition, env: Mapping[str, Any]) -> bool:
        for c in comparisons(condition):
            a, b = self._value(c.a, env), self._value(c.b, env)
            if not {"<": a < b, "<=": a <= b, ">": a > b, ">=": a >= b}[c.op]:
                return False
        return True

    def _value(self, e: Expr, env: Mapping[str, Any]) -> Any:
        if isinstance(e, Ref):
            return env[e.name] if e.index is None else env[e.name][self._index(e, env)]
        if isinstance(e, Bin):
            a, b = self._value(e.a, env), self._value(e.b, env)
            if e.op == "*":
                return a * b
            if e.op == "+":
                return a + b
            return a - b if e.op == "-" else a / b
        if isinstance(e, Num):
            if e.value not in self._numbers:
                self._numbers[e.value] = self.real(e.value)
            return self._numbers[e.value]
        assert isinstance(e, Una)
        a = self._value(e.a, env)
        if e.op == "sqrt":
            return np.sqrt(a)
        if e.op == "rint":
            return np.rint(a)
        if e.op == "sign":
            return self.real(int(a > 0) - int(a < 0))
        return -a if e.op == "neg" or a < 0 else a
