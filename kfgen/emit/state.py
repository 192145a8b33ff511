"""The stored state: how a new one gets there, from a step or a correction."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import sympy as sp

from kfgen.emit.guards import finite
from kfgen.emit.ir.ir import Bin, Expr, Let, Note, Num, Ref, Routine, StatusFlag, Stmt, Store, Una, When, mul
from kfgen.emit.ir.lower import Lowering
from kfgen.emit.watch.supervisor import ARRAY as SUPERVISOR

if TYPE_CHECKING:
    from kfgen.emit.routines import Program


def normalised(
    program: Program, values: list[Expr], lower: Lowering, guarded: bool = False, then: Sequence[Stmt] = ()
) -> list[Stmt]:
    """Store the new state, its quaternion scaled to unit length.

    Parameters
    ----------
    program : Program
    values : list of Expr
        Of the stored state, in order.
    lower : Lowering
        Names the locals.
    guarded : bool
        Only where the new state is finite; else the old one stays, and the status says so.
    then : sequence of Stmt
        What follows, under the same guard.
    """
    quaternion = program.discrete.model.attitude.nominal_names if program.discrete.model.attitude else ()
    body: list[Stmt] = []
    locals_: list[Expr] = []
    for value in values:
        atom, statements = lower.let(value, "n")
        if isinstance(atom, Ref) and atom.name == "x":
            name = lower.fresh("n")
            atom, statements = Ref(name), [Let(name, atom)]
        locals_.append(atom)
        body += statements
    where = [i for i, n in enumerate(program.discrete.nominal_names) if n in quaternion]
    if where:
        q = sp.symbols(f"__n0:{len(where)}")
        inner = Lowering({s.name: Ref(f"q{i}") for i, s in enumerate(q)})
        body += [Let(f"q{i}", locals_[k]) for i, k in enumerate(where)]
        (square,), _ = inner.many([sum(s * s for s in q)])
        body += [Let("q_square", square), Let("q_scale", Bin("/", Num(1.0), Una("sqrt", Ref("q_square"))))]
        for i, k in enumerate(where):
            locals_[k] = mul(Ref(f"q{i}"), Ref("q_scale"))
    stores = [Store(Ref("x", i), v) for i, v in enumerate(locals_) if v != Ref("x", i)]
    if not guarded or not locals_:
        return [*body, *stores, *then]
    total, is_finite = finite(locals_, "sum_x")
    return [*body, total, When(is_finite, (*stores, *then), (StatusFlag("NOT_FINITE"),))]


def inject(program: Program, guarded: bool = False, then: Sequence[Stmt] = ()) -> list[Stmt]:
    """The correction ``dx`` moves into the state, and what follows; where that is guarded, only if the new one is finite."""
    model = program.discrete.model
    lower = program.lowering("c")
    lower.places |= {s.error.name: Ref("dx", i) for i, s in enumerate(model.states)}
    values, body = lower.many(list(model.corrected))
    return [Note("correct the state"), *body, *normalised(program, values, lower, guarded, then)]


def init(program: Program) -> Routine:
    """State, covariance and constants before the first measurement; what waits in a delayed horizon begins with it."""
    body: list[Stmt] = [Store(Ref("x", i), Num(v)) for i, v in enumerate(program.discrete.start)]
    body += program.covariance.init([program.prior(i) for i in range(program.n)])
    body += [Store(Ref("k", i), Num(c.value)) for i, c in enumerate(program.constants)]
    body += [Store(Ref(SUPERVISOR, i), Num(v)) for i, v in enumerate(program.supervisor.start)]
    waiting = program.delayed_memory.waiting if program.horizon else {}
    done = {"x", "k", program.covariance.ARRAY, SUPERVISOR, *waiting}
    for name, (size, _) in program.arrays.items():
        if name not in done:
            body += [Store(Ref(name, i), Num(0.0)) for i in range(size)]
    return Routine("init", "State, covariance and constants before the first measurement.", (), tuple(body))
