"""Covariance arithmetic on packed symmetric storage, by structure.

Prediction, ``P <- Phi P Phi' + Qd``, in place: the rows of Phi are ordered so that each needs only
rows that are not yet new, and Phi is the product of one elementary matrix a row; rows that drive
one another in a circle go together. A row costs its non-zeros times the states; neither Phi nor P
is ever a dense matrix. Update: scalar by scalar, ``K = P H' / S``, ``P <- P - K (P H')'``.

References
----------
.. [1] G. J. Bierman, Factorization Methods for Discrete Sequential Estimation, 1977, ch. II (scalar
   processing); the elementary congruence is Gauss's.
"""

from __future__ import annotations

from functools import reduce
from typing import Any

from sympy.utilities.iterables import strongly_connected_components

from kfgen.emit.ir import Bin, Compare, Expr, Flag, Let, Note, Num, Ref, Stmt, Store, When, add, mul, sub
from kfgen.emit.lower import Lowering

Row = dict[int, Expr]
"""The non-zeros of a row by column, as atoms."""


def packed(n: int, i: int, j: int) -> Ref:
    """The element (i, j) of the covariance, upper triangle by rows."""
    i, j = min(i, j), max(i, j)
    return Ref("P", i * n - i * (i - 1) // 2 + (j - i))


def packed_size(n: int) -> int:
    """Number of stored elements."""
    return n * (n + 1) // 2


def groups(rows: dict[int, Row]) -> list[list[int]]:
    """The rows in groups that drive one another, each group before the rows that it needs."""
    edges = [(i, j) for i, row in rows.items() for j in row if j in rows and j != i]
    return [sorted(g) for g in reversed(strongly_connected_components((list(rows), edges)))]


def predict_covariance(
    n: int, Phi: dict[int, Row], Qd: dict[tuple[int, int], Expr], names: list[str]
) -> list[Stmt]:
    """Statements of ``P <- Phi P Phi' + Qd``.

    Parameters
    ----------
    n : int
        States.
    Phi : dict
        Rows that differ from the identity's, all their non-zeros with the diagonal.
    Qd : dict
        Non-zeros of the upper triangle.
    names : list of str
        Of the states, for comments.
    """
    body: list[Stmt] = []
    for group in groups(Phi):
        body.append(Note("rows of " + ", ".join(names[i] for i in group)))
        body += _congruence(n, group, Phi)
    body.append(Note("process noise"))
    body += [Store(packed(n, i, j), add(packed(n, i, j), q)) for (i, j), q in Qd.items()]
    return body


def _congruence(n: int, group: list[int], Phi: dict[int, Row]) -> list[Stmt]:
    """The rows and columns of a group become new; all the rows that they need are still old.

    With ``U = Phi_G P``, taken before anything is stored, the group's own block is
    ``U_GG Phi_GG' + P'_Go Phi_Go'``: its second part takes the new off-group elements.
    """
    body: list[Stmt] = []
    inner = {(i, m): Ref(f"u_{i}_{m}") for i in group for m in group}
    body += [Let(u.name, _row_times(n, i, Phi[i], m)) for (i, m), u in inner.items()]
    for k in (k for k in range(n) if k not in group):
        new = [(i, _row_times(n, i, Phi[i], k)) for i in group]
        if len(group) > 1:
            body += [Let(f"v_{i}_{k}", value) for i, value in new]
            new = [(i, Ref(f"v_{i}_{k}")) for i, _ in new]
        body += [Store(packed(n, i, k), value) for i, value in new if value != packed(n, i, k)]
    for a, i in enumerate(group):
        for l in group[a:]:
            terms = [
                mul(c, inner[i, m] if m in group else packed(n, i, m)) for m, c in _diagonal_first(l, Phi[l])
            ]
            body.append(Store(packed(n, i, l), _sum(terms)))
    return body


def _row_times(n: int, i: int, row: Row, k: int) -> Expr:
    """Row i of Phi times column k of P."""
    return _sum([mul(c, packed(n, j, k)) for j, c in _diagonal_first(i, row)])


def _diagonal_first(i: int, row: Row) -> list[tuple[int, Expr]]:
    return sorted(row.items(), key=lambda item: item[0] != i)


def _sum(terms: list[Expr]) -> Expr:
    return reduce(add, terms)


def update_scalar(lower: Lowering, n: int, tag: str, *, H: Row, residual: Expr, variance: Expr) -> list[Stmt]:
    """Statements that fuse one scalar measurement.

    The correction gathers in ``dx``; the residual of a later scalar is taken at the state
    corrected by the earlier ones. A residual beyond the gate, or an innovation variance that is
    not positive, changes nothing but the status.

    Parameters
    ----------
    tag : str
        Suffix of its local names.
    H : Row
        Non-zeros of its Jacobian.
    residual : Expr
        ``z - h`` at the uncorrected state.
    variance : Expr
        ``R``.
    """
    y, S, s = Ref(f"y_{tag}"), Ref(f"S_{tag}"), Ref(f"s_{tag}")
    corrected = reduce(sub, (mul(h, Ref("dx", j)) for j, h in H.items()), residual)
    body: list[Stmt] = [Let(y.name, corrected)]
    b = []
    for k in range(n):
        value, statements = lower.let(_sum([mul(h, packed(n, k, j)) for j, h in H.items()]), "b")
        body += statements
        b.append(value)
    if any(v == packed(n, k, j) for k, v in enumerate(b) for j in range(n)):
        body, b = _copied(body, b, lower)
    body.append(Let(S.name, _sum([variance, *(mul(h, b[j]) for j, h in H.items())])))
    body += [Store(Ref("innovation", _row_index(tag)), y), Store(Ref("variance", _row_index(tag)), S)]
    apply: list[Stmt] = [Let(s.name, Bin("/", Num(1.0), S))]
    for k in range(n):
        gain = Ref(f"K_{tag}_{k}")
        apply += [Let(gain.name, mul(b[k], s)), Store(Ref("dx", k), add(Ref("dx", k), mul(gain, y)))]
        apply += [Store(packed(n, k, l), sub(packed(n, k, l), mul(gain, b[l]))) for l in range(k, n)]
    apply.append(Store(Ref("fused", 0), Num(1.0)))
    gated = When(Compare("<=", mul(y, y), mul(lower.places["gate"], S)), tuple(apply), (Flag("GATED"),))
    return [*body, When(Compare(">", S, Num(0.0)), (gated,), (Flag("NOT_POSITIVE"),))]


def _row_index(tag: str) -> int:
    return int(tag.rsplit("_", 1)[-1])


def _copied(body: list[Stmt], b: list[Expr], lower: Lowering) -> tuple[list[Stmt], list[Expr]]:
    """Elements of P that stand for themselves, copied before the update overwrites them."""
    out: list[Any] = []
    for value in b:
        stored = isinstance(value, Ref) and value.name == "P"
        out.append(Ref(lower.fresh("b")) if stored else value)
        if stored:
            body.append(Let(out[-1].name, value))
    return body, out
