"""Covariance arithmetic on packed symmetric storage, by structure.

Prediction, ``P <- Phi P Phi' + Qd``, in place: Phi is a product of elementary matrices, one a row, in an
order in which each needs only rows that are not yet new. Rows of one depth go together, column by column, so
that what they share is loaded once; rows that drive one another in a circle go through locals. A row costs its
non-zeros times the states; neither Phi nor P is ever a dense matrix. Update: scalar by scalar.

References
----------
.. [1] G. J. Bierman, Factorization Methods for Discrete Sequential Estimation, 1977, ch. II (scalar
   processing), eq. (II.2.12) (the covariance for any gain); the elementary congruence is Gauss's.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import reduce

from sympy.utilities.iterables import strongly_connected_components

from kfgen.emit.ir.ir import Expr, For, Let, Note, Num, Ref, Stmt, Store, Whole, add, mul

Row = dict[int, Expr]
"""The non-zeros of a row by column, as atoms."""
Noise = dict[tuple[int, int], Expr]
"""Upper non-zeros of the process noise, as atoms."""
MAX_ROWS_TOGETHER = 3
"""Rows that are updated together: with what they share they fit the registers of a small core."""
MIN_LOOP_COLUMNS = 3
"""Columns that are worth a loop."""


def cell(i: Whole, j: Whole, name: str = "P") -> Ref:
    """The element (i, j) of a packed triangle; of a loop's variable the order must be known to the caller.

    Parameters
    ----------
    i : int or str
        Row.
    j : int or str
        Column.
    name : str
        Of the array.
    """
    if isinstance(i, int) and isinstance(j, int):
        i, j = min(i, j), max(i, j)
    return Ref(name, (i, j))


def packed_size(n: int) -> int:
    """Number of stored elements."""
    return n * (n + 1) // 2


def place(n: int, i: int, j: int) -> int:
    """Where the element (i, j), i <= j, of an upper triangle by rows is stored.

    Parameters
    ----------
    n : int
        Rows of the triangle.
    i : int
        Row.
    j : int
        Column, not before the row.
    """
    return i * n - i * (i - 1) // 2 + (j - i)


def groups(rows: dict[int, Row]) -> list[list[int]]:
    """The rows in groups that drive one another, each group before the rows that it needs."""
    edges = [(i, j) for i, row in rows.items() for j in row if j in rows and j != i]
    return [sorted(g) for g in reversed(strongly_connected_components((sorted(rows), edges)))]


def batches(rows: dict[int, Row]) -> list[list[int]]:
    """The groups, those of one row and equal depth gathered to `MAX_ROWS_TOGETHER` rows."""
    depth: dict[int, int] = {}
    ordered = groups(rows)
    for group in ordered:
        above = [depth[i] for i in depth for j in rows[i] if j in group and i not in group]
        depth |= dict.fromkeys(group, max(above, default=-1) + 1)
    out: list[list[int]] = []
    for group in sorted(ordered, key=lambda g: (depth[g[0]], g)):
        last = out[-1] if out else []
        alone = len(group) == 1 and all(_acyclic(rows, i, last) for i in group)
        if last and alone and len(last) < MAX_ROWS_TOGETHER and depth[last[0]] == depth[group[0]]:
            last += group
        else:
            out.append(list(group))
    return out


def _acyclic(rows: dict[int, Row], i: int, batch: Sequence[int]) -> bool:
    """Whether a row and the rows of a batch do not drive one another."""
    return all(i not in rows[k] and k not in rows[i] and not set(rows[k]) & (set(batch) - {k}) for k in batch)


def predict_covariance(
    n: int, Phi: dict[int, Row], Qd: Noise, names: Sequence[str], loops: bool
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
    loops : bool
        Columns that are treated alike in a loop.
    """
    body: list[Stmt] = []
    for batch in batches(Phi):
        body.append(Note("rows of " + ", ".join(names[i] for i in batch)))
        cyclic = any(j in batch for i in batch for j in Phi[i] if j != i)
        body += (_circle if cyclic else _batch)(n, batch, Phi, loops)
    body.append(Note("process noise"))
    body += [Store(cell(i, j), add(cell(i, j), q)) for (i, j), q in Qd.items()]
    return body


def _batch(n: int, batch: list[int], Phi: dict[int, Row], loops: bool) -> list[Stmt]:
    """Rows that do not need one another: ``P_ik <- d_i P_ik + sum_j c_ij P_jk``, and their own block.

    Of that block, ``P_il <- d_i d_l P_il + d_l sum_j c_ij P_jl + sum_j c_lj P_ij'`` with old P_jl and new
    P_ij', its terms are gathered while column j passes by; on the diagonal they have one factor.
    """
    d = {i: Phi[i].get(i, Num(0.0)) for i in batch}
    coupled = sorted({j for i in batch for j in Phi[i] if j != i})
    body: list[Stmt] = []
    own = [(i, l) for a, i in enumerate(batch) for l in batch[a:]]
    inner: dict[tuple[int, int], Expr] = {(i, l): mul(mul(d[i], d[l]), cell(i, l)) for i, l in own}
    for j in coupled:
        new = {i: _name(body, f"w_{i}_{j}", _row_times(i, Phi[i], j)) for i in batch}
        for i, l in own:
            if i == l and j in Phi[i]:
                term = mul(Phi[i][j], add(mul(d[i], cell(i, j)), new[i]))
                inner[i, i] = _name(body, f"w_{i}_{i}_{j}", add(inner[i, i], term))
            elif i != l:
                value = inner[i, l]
                if j in Phi[i]:
                    value = add(value, mul(d[l], mul(Phi[i][j], cell(j, l))))
                if j in Phi[l]:
                    value = add(value, mul(Phi[l][j], new[i]))
                if value != inner[i, l]:
                    inner[i, l] = _name(body, f"w_{i}_{l}_{j}", value)
        body += [Store(cell(i, j), value) for i, value in new.items()]
    body += [Store(cell(i, l), value) for (i, l), value in inner.items() if value != cell(i, l)]
    rest = [k for k in range(n) if k not in batch and k not in coupled]
    return body + each(rest, {*batch, *coupled}, lambda k: _column(batch, Phi, k), loops)


def _name(body: list[Stmt], name: str, value: Expr) -> Expr:
    """A new local of that name; appended to the body."""
    body.append(Let(name, value))
    return Ref(name)


def _column(rows: Sequence[int], Phi: dict[int, Row], k: Place) -> list[Stmt]:
    new = [(i, _row_times(i, Phi[i], k)) for i in rows]
    return [Store(at(i, k), value) for i, value in new if value != at(i, k)]


@dataclass(frozen=True)
class PackedColumn:
    """A column of a loop: those after `after`, and before the next one that is treated on its own."""

    var: str
    after: int


Place = int | PackedColumn


def each(
    columns: Sequence[int], special: set[int], of: Callable[[Place], list[Stmt]], loops: bool
) -> list[Stmt]:
    """The statements of every column; in loops over those that lie on one side of every special one.

    Parameters
    ----------
    columns : sequence of int
        In rising order.
    special : set of int
        Columns that are treated on their own.
    of : callable
        The statements of a column.
    loops : bool
        Whether loops are wanted.
    """
    body: list[Stmt] = []
    runs: list[list[int]] = []
    for k in columns:
        if runs and runs[-1][-1] == k - 1:
            runs[-1].append(k)
        else:
            runs.append([k])
    for run in runs:
        if loops and len(run) >= MIN_LOOP_COLUMNS:
            column = PackedColumn("col", max((s for s in special if s < run[0]), default=-1))
            turn = tuple(of(column))
            body += [For("col", run[0], run[-1] + 1, turn)] if turn else []
        else:
            body += [s for k in run for s in of(k)]
    return body


def at(i: int, k: Place, name: str = "P") -> Ref:
    """The element of row i in a column, which may be a loop's.

    Parameters
    ----------
    i : int
        Row.
    k : int or PackedColumn
        Column.
    name : str
        Of the array.
    """
    if isinstance(k, int):
        return cell(i, k, name)
    return cell(i, k.var, name) if i <= k.after else cell(k.var, i, name)


def _row_times(i: int, row: Row, k: Place) -> Expr:
    """Row i of Phi times column k of P."""
    return total([mul(c, at(j, k)) for j, c in _diagonal_first(i, row)])


def _diagonal_first(i: int, row: Row) -> list[tuple[int, Expr]]:
    return sorted(row.items(), key=lambda item: item[0] != i)


def total(terms: Sequence[Expr]) -> Expr:
    """Their sum from the left."""
    return reduce(add, terms)


def _circle(n: int, group: list[int], Phi: dict[int, Row], loops: bool) -> list[Stmt]:
    """Rows that drive one another become new; all the rows that they need are still old.

    With ``U = Phi_G P``, taken before anything is stored, the group's own block is
    ``U_GG Phi_GG' + P'_Go Phi_Go'``: its second part takes the new off-group elements.
    """
    body: list[Stmt] = []
    inner = {(i, m): Ref(f"u_{i}_{m}") for i in group for m in group}
    body += [Let(u.name, _row_times(i, Phi[i], m)) for (i, m), u in inner.items()]
    coupled = {j for i in group for j in Phi[i]}

    def column(k: Place) -> list[Stmt]:
        new = [(i, Ref(f"v_{i}_{k if isinstance(k, int) else k.var}")) for i in group]
        lets: list[Stmt] = [Let(v.name, _row_times(i, Phi[i], k)) for i, v in new]
        return [*lets, *(Store(at(i, k), v) for i, v in new)]

    rest = [k for k in range(n) if k not in group]
    for k in (k for k in rest if k in coupled):
        body += column(k)
    body += each([k for k in rest if k not in coupled], {*group, *coupled}, column, loops)
    for a, i in enumerate(group):
        for l in group[a:]:
            terms = [mul(c, inner[i, m] if m in group else cell(i, m)) for m, c in _diagonal_first(l, Phi[l])]
            body.append(Store(cell(i, l), total(terms)))
    return body
