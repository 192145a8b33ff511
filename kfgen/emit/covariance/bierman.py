"""Bierman's update of the factors ``P = U D U'``, scalar by scalar.

A gain that is zero for held states adds a rank-one term, by Agee and Turner.

References
----------
.. [1] G. J. Bierman, Factorization Methods for Discrete Sequential Estimation, 1977, sec. V.3 (update),
   III.4 (Agee-Turner).
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

from kfgen.emit.covariance.correction import GAIN, corrected, gathered
from kfgen.emit.covariance.forms import (
    ANY_HELD,
    HEALTH,
    HEALTH_TEXT,
    HELD,
    INFLATE_TEXT,
    CovarianceForm,
    Fusion,
    inflate_arguments,
    smaller,
)
from kfgen.emit.covariance.packed import Row, cell, total
from kfgen.emit.covariance.state_range import StateRange
from kfgen.emit.ir.ir import (
    Argument,
    Bin,
    Compare,
    Expr,
    For,
    FunctionCall,
    Let,
    Num,
    Ref,
    Routine,
    Scratch,
    Stmt,
    Store,
    Una,
    When,
    add,
    mul,
    sub,
)

ARRAY = "UD"


def U(i: int | str, j: int | str) -> Ref:
    """An element of the factors.

    Parameters
    ----------
    i : int or str
        Row, or a loop's variable.
    j : int or str
        Column, not before the row.
    """
    return cell(i, j, ARRAY)


def let(body: list[Stmt], name: str, value: Expr) -> Expr:
    """A new local, unless it is one already; appended to the body.

    Parameters
    ----------
    body : list of Stmt
        To which the local is appended.
    name : str
    value : Expr
    """
    core = value.a if isinstance(value, Una) and value.op == "neg" else value
    if isinstance(core, Num) or (isinstance(core, Ref) and core.index is None):
        return value
    body.append(Let(name, value))
    return Ref(name)


def agee_turner(size: int) -> list[Stmt]:
    """``P + c a a'`` for the arrays a and c, of which only the first `size` places of a are not zero."""
    a, c = Ref("a_", "j"), Ref("c_", 0)
    inner: tuple[Stmt, ...] = (
        Store(Ref("a_", "i"), sub(Ref("a_", "i"), mul(Ref("s_"), U("i", "j")))),
        Store(U("i", "j"), add(U("i", "j"), mul(Ref("beta_"), Ref("a_", "i")))),
    )
    column: tuple[Stmt, ...] = (
        Let("s_", a),
        Let("old_", U("j", "j")),
        Let("new_", add(Ref("old_"), mul(mul(c, Ref("s_")), Ref("s_")))),
        Let("share_", Bin("/", c, Ref("new_"))),
        Let("beta_", mul(Ref("s_"), Ref("share_"))),
        Store(c, mul(Ref("share_"), Ref("old_"))),
        Store(U("j", "j"), Ref("new_")),
        For("i", 0, "j", inner),
    )
    return [For("j", 0, size, column, down=True)]


class Bierman(CovarianceForm):
    """Factors, and how a scalar measurement corrects them."""

    ARRAY = ARRAY
    TAKES_EXACT = False

    @cached_property
    def at(self) -> dict[int, int]:
        """The place of each state in the order."""
        return {state: k for k, state in enumerate(self.order)}

    def _projected(self, body: list[Stmt], tag: str, H: Row) -> tuple[dict[int, Expr], dict[int, Expr]]:
        """``f = U'h`` and ``v = D f`` by column, appended to the body."""
        h = {self.at[j]: c for j, c in H.items()}
        f: dict[int, Expr] = {}
        v: dict[int, Expr] = {}
        for j in range(min(h), self.n):
            terms = [c if k == j else mul(c, U(k, j)) for k, c in sorted(h.items()) if k <= j]
            f[j] = let(body, f"f_{tag}_{j}", total(terms))
            v[j] = let(body, f"v_{tag}_{j}", mul(U(j, j), f[j]))
        return f, v

    def innovation_covariance(
        self, rows: Sequence[Row], R: Sequence[Expr]
    ) -> tuple[list[Stmt], dict[tuple[int, int], Expr]]:
        """``S_ij = v_i f_j``, summed over the columns that both have."""
        body: list[Stmt] = []
        S: dict[tuple[int, int], Expr] = {}
        projected = [self._projected(body, f"j{i}", H) for i, H in enumerate(rows)]
        for i, (f, v) in enumerate(projected):
            S[i, i] = R[i]
            for k in f:
                S[i, i] = let(body, f"Sj_{i}_{k}", add(S[i, i], mul(v[k], f[k])))
            for j in range(i + 1, len(rows)):
                g = projected[j][0]
                S[i, j] = let(body, f"Sj_{i}_{j}_", total([mul(v[k], g[k]) for k in f if k in g]))
        return body, S

    def fuse(self, row: int, H: Row, R: Expr) -> Fusion:
        """Bierman's update: ``f = U'h``, ``v = D f``, ``alpha_j = alpha_(j-1) + v_j f_j`` down to ``S``."""
        tag = str(row)
        before: list[Stmt] = []
        f, v = self._projected(before, tag, H)
        alpha: dict[int, Expr] = {min(f) - 1: R}
        for j in f:
            alpha[j] = let(before, f"S_{tag}_{j}", add(alpha[j - 1], mul(v[j], f[j])))
        S = alpha[self.n - 1]
        columns = self._columns_loops if self.loops else self._columns
        body, b = columns(tag, R, f, v, alpha)
        return Fusion(tuple(before), S, (*body, *self._correct(row, b, S)))

    def _columns(
        self, tag: str, R: Expr, f: dict[int, Expr], v: dict[int, Expr], alpha: dict[int, Expr]
    ) -> tuple[list[Stmt], list[Expr]]:
        """Each column of U and its D; returns the unscaled gain."""
        body: list[Stmt] = []
        b: dict[int, Expr] = {}
        over = let(body, f"over_{tag}", Bin("/", Num(1.0), R))
        for j, slope_of in f.items():
            inverse = (
                Ref(f"s_{tag}")
                if j == self.n - 1
                else let(body, f"i_{tag}_{j}", Bin("/", Num(1.0), alpha[j]))
            )
            slope = let(body, f"l_{tag}_{j}", mul(slope_of, over))
            body.append(Store(U(j, j), mul(U(j, j), mul(alpha[j - 1], inverse))))
            for i in range(j):
                old = let(body, f"o_{tag}_{i}_{j}", U(i, j))
                if i in b:
                    body.append(Store(U(i, j), sub(old, mul(slope, b[i]))))
                b[i] = let(body, f"b_{tag}_{i}_{j}", add(b.get(i, Num(0.0)), mul(v[j], old)))
            b[j], over = v[j], inverse
        return body, [b[k] for k in range(self.n)]

    def _columns_loops(
        self, tag: str, R: Expr, f: dict[int, Expr], v: dict[int, Expr], alpha: dict[int, Expr]
    ) -> tuple[list[Stmt], list[Expr]]:
        """The same in a loop over columns."""
        b, n, first = Ref("b_", "i"), self.n, min(f)
        body: list[Stmt] = [Store(Ref("f_", j), value) for j, value in f.items()]
        body += [Store(Ref("v_", j), value) for j, value in v.items()]
        body += [Store(Ref("b_", k), Num(0.0)) for k in range(n)]
        body.append(Store(Ref("c_", 0), R))
        inner: tuple[Stmt, ...] = (
            Let("old_", U("i", "j")),
            Store(U("i", "j"), sub(Ref("old_"), mul(Ref("slope_"), b))),
            Store(b, add(b, mul(Ref("v_", "j"), Ref("old_")))),
        )
        column: tuple[Stmt, ...] = (
            Let("before_", Ref("c_", 0)),
            Let("after_", add(Ref("before_"), mul(Ref("v_", "j"), Ref("f_", "j")))),
            Let("slope_", Bin("/", Ref("f_", "j"), Ref("before_"))),
            Store(U("j", "j"), Bin("/", mul(U("j", "j"), Ref("before_")), Ref("after_"))),
            For("i", 0, "j", inner),
            Store(Ref("b_", "j"), Ref("v_", "j")),
            Store(Ref("c_", 0), Ref("after_")),
        )
        return [*body, For("j", first, n, column)], [Ref("b_", k) for k in range(n)]

    def _correct(self, row: int, b: list[Expr], S: Expr) -> list[Stmt]:
        """The gain at work; held states give up theirs, and the covariance gets it back."""
        y, s = Ref(f"y_{row}"), Ref(f"s_{row}")
        body: list[Stmt] = []
        K = [let(body, f"K_{row}_{k}", mul(value, s)) for k, value in enumerate(b)]
        dx = [Ref("dx", self.order[k]) for k in range(self.n)]
        handed = [Store(Ref(GAIN, k), value) for k, value in enumerate(K)]
        plain = tuple(gathered(row, x, mul(value, y)) for x, value in zip(dx, K))
        held = (
            *handed,
            FunctionCall("hold", (Ref(GAIN), S)),
            *corrected(row, self.n, y, self.loops, self.order),
        )
        return [*body, When(Compare(">", ANY_HELD, Num(0.0)), held, plain)]

    def stored_range(self, a: StateRange, b: StateRange | None, factor: float) -> tuple[float, float]:
        """D as a variance, U as what follows of one state from another."""
        if b is None:
            return a.least**2, a.most**2
        return -factor * a.prior / b.prior, factor * a.prior / b.prior

    @property
    def scratch(self) -> tuple[Scratch, ...]:
        """Local arrays of an update."""
        more = [Scratch(a, size) for a, size in (("f_", self.n), ("v_", self.n), ("b_", self.n), ("c_", 1))]
        return (Scratch(GAIN, self.n), *(more if self.loops else ()))

    @property
    def internals(self) -> tuple[Routine, ...]:
        """What held states need."""
        n = self.n
        split: list[Stmt] = []
        for k, state in enumerate(self.order):
            split += [
                Store(Ref("a_", k), mul(Ref(HELD, state), Ref(GAIN, k))),
                Store(Ref(GAIN, k), sub(Ref(GAIN, k), Ref("a_", k))),
            ]
        body = (*split, Store(Ref("c_", 0), Ref("S")), *agee_turner(n))
        return (
            Routine(
                "hold",
                "Held states keep their estimate: P + S k k' with the part k of the gain that they give up.",
                (Argument(GAIN, n, "gain"), Argument("S", 0, "variance of the innovation")),
                body,
                (Scratch("a_", n), Scratch("c_", 1)),
                internal=True,
            ),
            self.inflate,
        )

    @property
    def inflate(self) -> Routine:
        """By Agee and Turner; the direction is in the order of the factors."""
        body = (
            *(Store(Ref("a_", k), Ref(GAIN, state)) for k, state in enumerate(self.order)),
            Store(Ref("c_", 0), Ref("c")),
            *agee_turner(self.n),
        )
        scratch = (Scratch("a_", self.n), Scratch("c_", 1))
        return Routine("inflate", INFLATE_TEXT, inflate_arguments(self.n), body, scratch, internal=True)

    @cached_property
    def health(self) -> Routine:
        """By D over the variances."""
        n, total_ = self.n, Ref("c_", 0)
        square = mul(mul(U("j", "m"), U("m", "m")), U("j", "m"))
        body: tuple[Stmt, ...] = (
            Store(HEALTH, Num(1.0)),
            For(
                "j",
                0,
                n,
                (
                    Store(total_, U("j", "j")),
                    For("m", "j", n, (Store(total_, add(total_, square)),), skip=1),
                    Let("ratio_", Bin("/", U("j", "j"), total_)),
                    *smaller(Ref("ratio_")),
                ),
            ),
        )
        return Routine("check", HEALTH_TEXT, (), body, (Scratch("c_", 1),))
