"""A sample of a small filter, fused row by row on the way to its gate: beyond it, or not positive, all is undone.

The squared innovations over their variances, each given the rows before it, add up to ``y' S^-1 y`` of the whole
sample. Of few states a copy of the covariance costs less than that of the sample, which
`kfgen.emit.covariance.joint` works out first for larger filters.
"""

from __future__ import annotations

from collections.abc import Sequence

from kfgen.emit.covariance.forms import CovarianceForm
from kfgen.emit.covariance.joint import MAX_VARIANCE, NIS
from kfgen.emit.covariance.packed import Row
from kfgen.emit.covariance.scalars import at_corrected
from kfgen.emit.ir.ir import (
    All,
    Bin,
    Compare,
    Expr,
    For,
    Let,
    Note,
    Num,
    Ref,
    Scratch,
    StatusFlag,
    Stmt,
    Store,
    When,
    add,
    mul,
)

KEPT = "kept"
"""Scratch of an update: the stored covariance before its first row."""


def kept(form: CovarianceForm, rows: int) -> tuple[Scratch, ...]:
    """The memory that an update of so many rows needs to take itself back."""
    return (Scratch(KEPT, form.size),) if rows > 1 and not form.gates_first else ()


def _keep(form: CovarianceForm) -> list[Stmt]:
    """Number by number: cores load and store pairs of them."""
    places: Sequence[int | str] = ["i"] if form.loops else range(form.size)
    moves = tuple(Store(Ref(KEPT, i), Ref(form.ARRAY, i)) for i in places)
    return [For("i", 0, form.size, moves)] if form.loops else list(moves)


def _back(form: CovarianceForm) -> Stmt:
    """What was kept, in a loop: it is rare."""
    return For("i", 0, form.size, (Store(Ref(form.ARRAY, "i"), Ref(KEPT, "i")),))


def fused_with_rollback(
    form: CovarianceForm,
    rows: Sequence[tuple[str, Row, Expr, Expr]],
    gate: Expr,
    accepted: Sequence[Stmt],
    rejected: Sequence[Stmt],
) -> list[Stmt]:
    """Statements that fuse a sample, or leave all as it was.

    The correction gathers in ``dx``; the residual of a later row is taken at the state corrected by the earlier ones.

    Parameters
    ----------
    form : CovarianceForm
    rows : sequence of (str, Row, Expr, Expr)
        Of each row: its channel, the non-zeros of its Jacobian, ``z - h`` at the uncorrected state, the variance of
        its noise [SI^2].
    gate : Expr
        Largest ``y' S^-1 y``.
    accepted, rejected : sequence of Stmt
        What follows a sample within the gate, and one beyond it; neither, and the status says so, where the variance
        of an innovation is not positive.
    """
    several = len(rows) > 1
    back = (_back(form),) if several else ()
    body: list[Stmt] = list(accepted)
    for i, (channel, H, residual, R) in reversed(list(enumerate(rows))):
        y, s = Ref(f"y_{i}"), Ref(f"s_{i}")
        fusion = form.fuse(i, H, R)
        inner: tuple[Stmt, ...] = (*fusion.apply, *body)
        if i == len(rows) - 1:
            inner = (When(Compare("<=", NIS, gate), inner, (StatusFlag("GATED"), *back, *rejected)),)
        squared = mul(mul(y, y), s)
        apply: tuple[Stmt, ...] = (
            Let(s.name, Bin("/", Num(1.0), fusion.S)),
            Store(NIS, add(NIS, squared) if i else squared),
            *inner,
        )
        positive = All((Compare(">", fusion.S, Num(0.0)), Compare("<=", fusion.S, Num(MAX_VARIANCE))))
        body = [
            Note(channel),
            Let(y.name, at_corrected(i, H, residual)),
            *fusion.before,
            Store(Ref("innovation", i), y),
            Store(Ref("variance", i), fusion.S),
            When(positive, apply, (StatusFlag("NOT_POSITIVE"), *(back if i else ()))),
        ]
    return [*(_keep(form) if several else ()), *body]
