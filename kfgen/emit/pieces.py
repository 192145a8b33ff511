"""The pieces of a filter, for a target that has matrices of its own."""

from __future__ import annotations

from collections.abc import Sequence

import sympy as sp

from kfgen.emit.ir.ir import Argument, Ref, Routine, Store
from kfgen.emit.routines import Program
from kfgen.emit.state import inject, normalised


def pieces(program: Program) -> tuple[Routine, ...]:
    """``step``, ``transition``, ``noise``, ``expect_<sensor>`` and ``inject``."""
    discrete, n = program.discrete, program.n
    Phi, Qd, step = discrete.Phi, discrete.named_noise[0], discrete.step
    parts = [
        _piece(program, "transition", "Transition of the error.", _entries("Phi", Phi)),
        _piece(program, "noise", "Process noise of a step.", _entries("Qd", Qd)),
    ]
    for s in discrete.model.sensors:
        h, H = discrete.expected(s), discrete.H(s)
        stores = [(Ref("h", i), h[i]) for i in range(H.rows)] + _entries("H", H)
        arguments = program.sample_arguments([e for _, e in stores])
        text = f"Expected sample and Jacobian: {s.title}."
        parts.append(_piece(program, f"expect_{s.name}", text, stores, arguments))
        length, share = s.gated_length()
        if share > 0.0:
            said = f"Expected squared length: {s.title}."
            parts.append(_piece(program, f"length_{s.name}", said, [(Ref("length", 0), length)], ()))
    lower = program.lowering()
    body = program.atoms.make(lower, step)
    values, statements = lower.many(step)
    body += [*statements, *normalised(program, values, lower)]
    return (
        Routine("step", "The stored state over one step.", program.motion_arguments(step), tuple(body)),
        *parts,
        Routine(
            "inject",
            "The correction dx moves into the stored state.",
            (Argument("dx", n, "correction of the error state"),),
            tuple(inject(program)),
        ),
    )


def _entries(name: str, matrix: sp.Matrix) -> list[tuple[Ref, sp.Expr]]:
    """The non-zeros of a matrix with their places in a flat array."""
    return [(Ref(name, i), e) for i, e in enumerate(matrix) if e != 0]


def _piece(
    program: Program,
    name: str,
    text: str,
    stores: Sequence[tuple[Ref, sp.Expr]],
    arguments: tuple[Argument, ...] | None = None,
) -> Routine:
    used = [e for _, e in stores]
    lower = program.lowering()
    body = program.atoms.make(lower, used)
    values, statements = lower.many(used)
    body += [*statements, *(Store(ref, v) for (ref, _), v in zip(stores, values))]
    return Routine(
        name, text, program.motion_arguments(used) if arguments is None else arguments, tuple(body)
    )
