"""The covariance as factors, ``P = U D U'`` with U unit upper triangular and D diagonal: never indefinite.

D lies on the diagonal of the packed triangle, in an order of the states in which the transition is upper
triangular, where there is one. Then ``U <- Phi U`` stays triangular and D as it is (a diagonal ``phi`` of
a Gauss-Markov state scales column and D); noise comes in as rank-one updates of Agee and Turner; a transition
that runs in circles goes through the weighted Gram-Schmidt orthogonalisation of Thornton.
The update is Bierman's (`kfgen.emit.covariance.bierman`).

References
----------
.. [1] G. J. Bierman, Factorization Methods for Discrete Sequential Estimation, 1977, sec. VI.4 (prediction;
   modified weighted Gram-Schmidt by Thornton).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cached_property

import numpy as np

from kfgen.core.errors import InputError
from kfgen.emit.covariance.bierman import Bierman, U, agee_turner, let
from kfgen.emit.covariance.forms import Array
from kfgen.emit.covariance.packed import Noise, Place, Row, at, each, place, total
from kfgen.emit.ir.ir import (
    Bin,
    Compare,
    Expr,
    For,
    FunctionCall,
    Let,
    Note,
    Num,
    Ref,
    Routine,
    Scratch,
    Stmt,
    Store,
    When,
    add,
    mul,
    neg,
    sub,
)

INVERSE_VARIANCE = Ref("o_", 0)
"""Scratch scalar 1/q of a noise variance q; exactly 0 where q is 0."""
WAITING_TIME = Ref("waiting", 0)
"""Time since the noise of slow states last came in [s]."""
MIN_D_ENTRY = 1e-24
"""Floor of an entry of D [SI^2]: where one is zero, the Agee-Turner update adds no noise to the states above it."""


def triangular(n: int, Phi: Mapping[int, Sequence[int]]) -> tuple[int, ...] | None:
    """An order in which every row needs only later ones, None where rows drive one another.

    Parameters
    ----------
    n : int
        States.
    Phi : mapping of int to sequence of int
        Non-zeros of the rows that differ from the identity's.
    """
    needed = {i: {j for j in row if j != i} for i, row in Phi.items()}
    left, out = list(range(n)), []
    while left:
        free = [k for k in left if not any(k in needed.get(i, ()) for i in left if i != k)]
        if not free:
            return None
        out.append(free[0])
        left.remove(free[0])
    return tuple(out)


class Factored(Bierman):
    """U and D."""

    NAME = "ud"
    TITLE = "factors of P = U D U', upper triangle by rows, D on its diagonal"
    HAS_Q_INTERVAL = True

    @cached_property
    def _triangular(self) -> tuple[int, ...] | None:
        return triangular(self.n, self.Phi)

    @property
    def order(self) -> tuple[int, ...]:
        """An order in which the transition is triangular, else their own."""
        return self._triangular or tuple(range(self.n))

    def init(self, priors: Sequence[Num]) -> list[Stmt]:
        """U is the identity, D the variances."""
        zero = For("i", 0, self.n, (For("j", "i", self.n, (Store(U("i", "j"), Num(0.0)),)),))
        ordered = [priors[s] for s in self.order]
        variances = [mul(sd, sd) if sd.value**2 >= MIN_D_ENTRY else Num(MIN_D_ENTRY) for sd in ordered]
        return [zero, *(Store(U(k, k), variance) for k, variance in enumerate(variances))]

    def predict(self, Phi: dict[int, Row], Qd: Noise) -> list[Stmt]:
        """Triangular where it can be, else by orthogonalisation."""
        rows = {self.at[i]: {self.at[j]: c for j, c in row.items()} for i, row in Phi.items()}
        noise: dict[tuple[int, ...], Expr] = {
            tuple(sorted((self.at[i], self.at[j]))): q for (i, j), q in Qd.items()
        }
        if self._triangular is None:
            return self._thornton(rows, noise) + self._waiting()
        body: list[Stmt] = []
        for i in sorted(rows):
            body += self._row(i, rows[i])
        for k in sorted(rows):
            body += self._rescale(k, rows[k].get(k, Num(0.0)))
        body.append(Note("process noise"))
        return body + factors(noise, self.n, self._rank_one) + self._waiting()

    def _waiting(self) -> list[Stmt]:
        """Slow noise waits, and comes in when it has waited long enough."""
        if not self.slow:
            return []
        due = When(Compare(">=", WAITING_TIME, Num(self.q_interval)), (FunctionCall("settle", ()),))
        return [Store(WAITING_TIME, add(WAITING_TIME, Ref("dt"))), due]

    @property
    def memory(self) -> dict[str, tuple[int, str]]:
        """How long slow noise has waited."""
        return {WAITING_TIME.name: (1, "time whose slow noise is still to come in [s]")} if self.slow else {}

    @property
    def internals(self) -> tuple[Routine, ...]:
        """What held states need, and slow noise."""
        if not self.slow:
            return super().internals
        body: list[Stmt] = []
        for state, density in sorted(self.slow.items(), key=lambda item: -self.at[item[0]]):
            top = self.at[state]
            body += [
                For("i", 0, top, (Store(Ref("a_", "i"), Num(0.0)),)),
                Store(Ref("a_", top), Num(1.0)),
                Store(Ref("c_", 0), mul(Num(density), WAITING_TIME)),
                *agee_turner(top + 1),
            ]
        body.append(Store(WAITING_TIME, Num(0.0)))
        settle = Routine(
            "settle",
            "The noise of slow states that has waited comes in.",
            (),
            tuple(body),
            (Scratch("a_", self.n), Scratch("c_", 1)),
            internal=True,
        )
        return (*super().internals, settle)

    def _row(self, i: int, row: Row) -> list[Stmt]:
        """Row i of ``Phi U``: of later rows, whose diagonal is one, still old."""
        d, body = row.get(i, Num(0.0)), []
        terms = {l: c for l, c in sorted(row.items()) if l != i}
        if not terms and d == Num(1.0):
            return []

        def column(k: Place) -> list[Stmt]:
            here = at(i, k, self.ARRAY)
            last = k if isinstance(k, int) else k.after
            value = mul(d, here)
            for l, c in terms.items():
                if l == k:
                    value = add(value, c)
                elif l <= last:
                    value = add(value, mul(c, at(l, k, self.ARRAY)))
            return [Store(here, value)] if value != here else []

        special = {i, *terms}
        for k in range(i + 1, self.n):
            if k in terms:
                body += column(k)
        # The columns that are special come first: a row's own element in them is read by no other column.
        return body + each([k for k in range(i + 1, self.n) if k not in terms], special, column, self.loops)

    def _rescale(self, k: int, d: Expr) -> list[Stmt]:
        """Column k of ``Phi U`` has d on its diagonal: it is divided by it, D takes its square."""
        if d == Num(1.0):
            return []
        over = Ref(f"over_{k}")
        body: list[Stmt] = [Let(over.name, Bin("/", Num(1.0), d))]
        body += [Store(U(i, k), mul(U(i, k), over)) for i in range(k)]
        return [*body, Store(U(k, k), mul(mul(d, d), U(k, k)))]

    def _rank_one(self, top: int, a: dict[int, Expr], c: Expr) -> list[Stmt]:
        """``P + c a a'`` with a one at its last place."""
        if self.loops:
            vector = [Store(Ref("a_", i), a.get(i, Num(0.0))) for i in range(top + 1)]
            return [*vector, Store(Ref("c_", 0), c), *agee_turner(top + 1)]
        body: list[Stmt] = []
        for j in range(top, -1, -1):
            s = a.get(j)
            if s is None:
                continue
            tag = f"{top}_{j}"
            D, weight = U(j, j), let(body, f"t_{tag}", mul(c, s))
            new = let(body, f"d_{tag}", add(D, mul(weight, s)))
            if j:
                share = let(body, f"o_{tag}", Bin("/", c, new))
                beta = let(body, f"e_{tag}", mul(s, share))
                c = let(body, f"c_{tag}", mul(share, D))
            body.append(Store(D, new))
            for i in range(j):
                a[i] = let(body, f"a_{tag}_{i}", sub(a.get(i, Num(0.0)), mul(s, U(i, j))))
                body.append(Store(U(i, j), add(U(i, j), mul(beta, a[i]))))
        return body

    def _thornton(self, Phi: dict[int, Row], noise: dict[tuple[int, ...], Expr]) -> list[Stmt]:
        """``W = [Phi U, A]`` with weights D and c, its rows made orthogonal from the last one up."""
        n = self.n
        body: list[Stmt] = []
        for i in range(n):
            row = Phi.get(i, {i: Num(1.0)})
            for k in range(n):
                terms = [c if l == k else mul(c, U(l, k)) for l, c in sorted(row.items()) if l <= k]
                if terms:
                    body.append(Store(Ref(f"W{i}", k), total(terms)))
        body += [Store(Ref("weight", k), U(k, k)) for k in range(n)]

        def weigh(top: int, a: dict[int, Expr], c: Expr) -> list[Stmt]:
            return [
                *(Store(Ref(f"W{i}", n + top), value) for i, value in a.items()),
                Store(Ref("weight", n + top), c),
            ]

        body += factors(noise, n, weigh)
        for j in range(n - 1, -1, -1):
            w = Ref(f"W{j}", "m")
            body += [
                For("m", 0, 2 * n, (Store(Ref("g_", "m"), mul(w, Ref("weight", "m"))),)),
                *_dot(U(j, j), w, 2 * n),
            ]
            if j:
                body.append(Let(f"over_{j}", Bin("/", Num(1.0), U(j, j))))
            for i in range(j):
                v = Ref(f"W{i}", "m")
                body += [*_dot(U(i, j), v, 2 * n), Store(U(i, j), mul(U(i, j), Ref(f"over_{j}")))]
                body.append(For("m", 0, 2 * n, (Store(v, sub(v, mul(U(i, j), w))),)))
        return body

    @property
    def predict_scratch(self) -> tuple[Scratch, ...]:
        """Local arrays of a prediction."""
        if self._triangular is None:
            rows = [Scratch(f"W{i}", 2 * self.n) for i in range(self.n)]
            return (*rows, Scratch("weight", 2 * self.n), Scratch("g_", 2 * self.n), Scratch("o_", 1))
        return (Scratch("o_", 1), *((Scratch("a_", self.n), Scratch("c_", 1)) if self.loops else ()))

    def variances(self, stored: Array) -> Array:
        """``sum U_ik^2 D_k``."""
        n = self.n
        U = np.zeros((len(stored), n, n))
        U[(slice(None), *np.triu_indices(n))] = stored
        D = np.diagonal(U, axis1=1, axis2=2).copy()
        U[:, range(n), range(n)] = 1.0
        ordered: Array = np.einsum("mik,mk->mi", U**2, D)
        return ordered[:, [self.at[i] for i in range(n)]]

    def matrix(self, values: Sequence[float]) -> list[list[float]]:
        """``U D U'``."""
        n = self.n
        stored = [[values[place(n, i, j)] if i <= j else 0.0 for j in range(n)] for i in range(n)]
        u = [[1.0 if i == j else float(stored[i][j]) for j in range(n)] for i in range(n)]
        P = [
            [sum(u[i][k] * float(stored[k][k]) * u[j][k] for k in range(max(i, j), n)) for j in range(n)]
            for i in range(n)
        ]
        return [[P[self.at[i]][self.at[j]] for j in range(n)] for i in range(n)]


def _dot(target: Ref, row: Ref, size: int) -> list[Stmt]:
    """A row times the weighted row ``g``."""
    return [
        Store(target, Num(0.0)),
        For("m", 0, size, (Store(target, add(target, mul(row, Ref("g_", "m")))),)),
    ]


def factors(
    noise: Mapping[tuple[int, ...], Expr], n: int, use: Callable[[int, dict[int, Expr], Expr], list[Stmt]]
) -> list[Stmt]:
    """Noise as a sum of rank-one terms ``c a a'``, a with a one at its last place: its own U and D, sparse.

    Parameters
    ----------
    noise : mapping
        Upper non-zeros.
    n : int
        States.
    use : callable
        Statements of one term: last place, the other places, c.
    """
    Q = {(min(k), max(k)): q for k, q in noise.items()}
    body: list[Stmt] = []
    for j in range(n - 1, -1, -1):
        if (j, j) not in Q:
            if any(j in k for k in Q):
                raise InputError("the process noise has a covariance without a variance")
            continue
        c = Q.pop((j, j))
        above = {i: Q.pop((i, j)) for i in range(j) if (i, j) in Q}
        if not above:
            body += use(j, {j: Num(1.0)}, c)
            continue
        c = let(body, f"q_{j}", c)
        positive = Compare(">", c, Num(0.0))
        body += [
            Store(INVERSE_VARIANCE, Num(0.0)),
            When(positive, (Store(INVERSE_VARIANCE, Bin("/", Num(1.0), c)),)),
        ]
        over = let(body, f"q_{j}_over", INVERSE_VARIANCE)
        a = {i: let(body, f"q_{i}_{j}", mul(q, over)) for i, q in above.items()}
        for i, q in above.items():
            for k in (k for k in above if k <= i):
                product = mul(a[k], q)
                left = add(Q[k, i], neg(product)) if (k, i) in Q else neg(product)
                Q[k, i] = let(body, f"q_{k}_{i}_{j}", left)
        inner = use(j, {**a, j: Num(1.0)}, c)
        body.append(When(positive, tuple(inner)))
    return body
