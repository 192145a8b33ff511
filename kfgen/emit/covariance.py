"""Covariance arithmetic on packed symmetric storage, by structure.

Prediction, ``P <- Phi P Phi' + Qd``, in place: Phi is the product of elementary matrices
``I + e_i n'``, one a row, when its rows can be ordered so that each needs only rows that are not
yet new. One such congruence costs the row's non-zeros times the states; neither Phi nor P is ever
a dense matrix. Update: scalar by scalar, ``K = P H' / S``, ``P <- P - K (P H')'``.

References
----------
.. [1] G. J. Bierman, Factorization Methods for Discrete Sequential Estimation, 1977, ch. II (scalar
   processing); the elementary congruence is Gauss's.
"""

from __future__ import annotations

from functools import reduce
from typing import Any

from kfgen.emit.ir import Bin, Compare, Expr, Flag, Let, Note, Num, Ref, Stmt, Store, When, add, mul, sub
from kfgen.emit.lower import Lowering
from kfgen.errors import InputError

Row = dict[int, Expr]
"""The non-zeros of a row by column, as atoms."""


def packed(n: int, i: int, j: int) -> Ref:
    """The element (i, j) of the covariance, upper triangle by rows."""
    i, j = min(i, j), max(i, j)
    return Ref("P", i * n - i * (i - 1) // 2 + (j - i))


def packed_size(n: int) -> int:
    """Number of stored elements."""
    return n * (n + 1) // 2


def row_order(rows: dict[int, Row], names: list[str]) -> list[int]:
    """An order in which every row comes before the rows that it needs.

    Raises
    ------
    InputError
        Rows need one another in a circle.
    """
    left, order = dict(rows), []
    while left:
        free = [i for i in left if not any(i in left[k] for k in left if k != i)]
        if not free:
            raise InputError(
                "the states "
                + ", ".join(names[i] for i in left)
                + " drive one another in a circle, which this form cannot order"
            )
        order.append(free[0])
        del left[free[0]]
    return order


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
    for i in row_order(Phi, names):
        body.append(Note(f"row of {names[i]}"))
        body += _congruence(n, i, Phi[i])
    body.append(Note("process noise"))
    body += [Store(packed(n, i, j), add(packed(n, i, j), q)) for (i, j), q in Qd.items()]
    return body


def _congruence(n: int, i: int, row: Row) -> list[Stmt]:
    """``P <- (I + e_i (row - e_i)') P (...)'``; the diagonal from its old and new neighbours."""
    diagonal = row.get(i, Num(1.0))
    others = [(j, c) for j, c in row.items() if j != i]
    half = f"h_{i}"
    body: list[Stmt] = [
        Let(half, _sum([mul(diagonal, packed(n, i, i)), *(mul(c, packed(n, i, j)) for j, c in others)]))
    ]
    for k in range(n):
        if k != i:
            new = _sum([mul(diagonal, packed(n, i, k)), *(mul(c, packed(n, j, k)) for j, c in others)])
            if new != packed(n, i, k):
                body.append(Store(packed(n, i, k), new))
    body.append(
        Store(
            packed(n, i, i), _sum([mul(diagonal, Ref(half)), *(mul(c, packed(n, i, j)) for j, c in others)])
        )
    )
    return body


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
