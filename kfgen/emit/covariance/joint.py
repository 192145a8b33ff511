"""The gate of a sample, all its rows together: ``y' S^-1 y`` by ``S = L D L'``, before any row is fused."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from kfgen.emit.ir.ir import (
    All,
    Bin,
    Compare,
    Expr,
    Let,
    Num,
    Ref,
    StatusFlag,
    Stmt,
    Store,
    When,
    add,
    mul,
    sub,
)

NIS = Ref("nis", 0)
"""Squared innovation of the last sample over its covariance, ``y' S^-1 y``."""
MAX_VARIANCE = 1e30
"""The variance of an innovation is less [SI^2]."""


def gated(
    S: Mapping[tuple[int, int], Expr],
    y: Sequence[Expr],
    gate: Expr,
    accepted: Sequence[Stmt],
    rejected: Sequence[Stmt],
) -> list[Stmt]:
    """Statements that accept or reject a sample whole.

    Parameters
    ----------
    S : mapping of (int, int) to Expr
        Covariance of the innovation, elements (i, j), i <= j.
    y : sequence of Expr
        Innovation.
    gate : Expr
        Largest ``y' S^-1 y``.
    accepted, rejected : sequence of Stmt
        What is then done; neither, and the status says so, where S is not positive.
    """
    inner: list[Stmt] = [
        Store(NIS, _sum_of_squares(len(y))),
        When(Compare("<=", NIS, gate), tuple(accepted), (StatusFlag("GATED"), *rejected)),
    ]
    for i in reversed(range(len(y))):
        pivot = Ref(f"pivot_{i}")
        positive = All((Compare(">", pivot, Num(0.0)), Compare("<=", pivot, Num(MAX_VARIANCE))))
        inverse = Let(f"inverse_{i}", Bin("/", Num(1.0), pivot))
        inner = [*_row(S, y, i), When(positive, (inverse, *inner), (StatusFlag("NOT_POSITIVE"),))]
    return inner


def _row(S: Mapping[tuple[int, int], Expr], y: Sequence[Expr], i: int) -> list[Stmt]:
    """Row i of the factors, once the rows before it are known: pivot, and innovation given those rows."""
    body: list[Stmt] = []
    pivot, white = S[i, i], y[i]
    for j in range(i):
        shared = S[j, i]
        for k in range(j):
            shared = sub(shared, mul(Ref(f"factor_{i}_{k}"), Ref(f"shared_{j}_{k}")))
        body.append(Let(f"shared_{i}_{j}", shared))
        body.append(Let(f"factor_{i}_{j}", mul(Ref(f"shared_{i}_{j}"), Ref(f"inverse_{j}"))))
        pivot = sub(pivot, mul(Ref(f"factor_{i}_{j}"), Ref(f"shared_{i}_{j}")))
        white = sub(white, mul(Ref(f"factor_{i}_{j}"), Ref(f"white_{j}")))
    return [*body, Let(f"pivot_{i}", pivot), Let(f"white_{i}", white)]


def _sum_of_squares(rows: int) -> Expr:
    total: Expr = Num(0.0)
    for i in range(rows):
        total = add(total, mul(mul(Ref(f"white_{i}"), Ref(f"white_{i}")), Ref(f"inverse_{i}")))
    return total
