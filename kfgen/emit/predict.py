"""The prediction of a filter: guards, state and covariance over one step."""

from __future__ import annotations

from typing import TYPE_CHECKING

from kfgen.emit.covariance.packed import Row
from kfgen.emit.guards import every, possible_step, within
from kfgen.emit.ir.ir import Expr, Note, Routine, StatusFlag, Stmt, When
from kfgen.emit.ir.tidy import tidy
from kfgen.emit.state import normalised

if TYPE_CHECKING:
    from kfgen.emit.routines import Program


def propagated(program: Program, guarded: bool = True) -> list[Stmt]:
    """State and covariance over one step, of inputs that are known to be fit.

    Parameters
    ----------
    program : Program
    guarded : bool
        Only where the new state is finite, and with a look at the new covariance.
    """
    rows, noise = program.transition
    lower = program.lowering()
    flat = [e for row in rows.values() for e in row.values()] + list(noise.values())
    used = [*flat, *(program.atoms.of_corrected_inputs(e) for e in program.discrete.step)]
    body = program.atoms.make(lower, used)
    values, statements = lower.many(used)
    body += statements
    entries: list[Expr] = []
    for value in values[: len(flat)]:
        atom, made = lower.let(value, "f")
        entries.append(atom)
        body += made
    stream = iter(entries)
    Phi: dict[int, Row] = {i: {j: next(stream) for j in row} for i, row in rows.items()}
    Qd = {key: next(stream) for key in noise}
    then = [*program.covariance.predict(Phi, Qd), *(program.covariance_guard() if guarded else ())]
    return [*body, Note("state"), *normalised(program, values[len(flat) :], lower, guarded, then)]


def predict(program: Program) -> Routine:
    """State and covariance over one step."""
    raw = (list(program.discrete.Phi), list(program.discrete.named_noise[0]), program.discrete.step)
    arguments = program.motion_arguments([e for row in raw for e in row])
    body = [*program.supervisor.resynchronise(), *program.supervisor.changed(), *propagated(program)]
    looked = [c for a in arguments[:-1] for c in within(a, program.input_limit(a.name))]
    refused = (StatusFlag("BAD_INPUT"), *program.supervisor.missed())
    known = (When(every(looked), tuple(body), refused),) if looked else tuple(body)
    possible = possible_step(program.discrete.max_step)
    outer = When(possible, (*program.supervisor.elapsed(), *known), (StatusFlag("BAD_STEP"),))
    return Routine(
        "predict",
        "State and covariance over one step.",
        arguments,
        tidy((outer,)),
        program.covariance.predict_scratch,
    )
