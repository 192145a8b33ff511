"""The covariance as factors, ``P = U D U'`` with U unit upper triangular and D diagonal: never indefinite.

D lies on the diagonal of the packed triangle, in an order of the states in which the transition is upper
triangular. Then ``U <- Phi U`` stays triangular and D as it is (a diagonal ``phi`` of a Gauss-Markov state scales
column and D); states that drive one another stand side by side, and only their own square is no triangle
(`kfgen.emit.covariance.coupled`). Noise comes in as rank-one updates of Agee and Turner.
The update is Bierman's (`kfgen.emit.covariance.bierman`).

References
----------
.. [1] G. J. Bierman, Factorization Methods for Discrete Sequential Estimation, 1977, sec. VI (prediction).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cached_property

import numpy as np

from kfgen.core.errors import InputError
from kfgen.emit.covariance.bierman import ARRAY, Bierman, U, agee_turner, let
from kfgen.emit.covariance.coupled import Square, scaled
from kfgen.emit.covariance.forms import Array
from kfgen.emit.covariance.order import Groups, filled, in_groups
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
WAITED, DUE, NEXT = (Ref("waiting", k) for k in range(3))
"""Time since the noise of slow states last came in [s]."""
MIN_D_ENTRY = 1e-24
"""Floor of an entry of D [SI^2]: where one is zero, the Agee-Turner update adds no noise to the states above it."""


class Factored(Bierman):
    """U and D."""

    NAME = "ud"
    TITLE = "factors of P = U D U', upper triangle by rows, D on its diagonal"
    HAS_Q_INTERVAL = True

    @cached_property
    def _groups(self) -> Groups:
        return in_groups(self.n, self.Phi, tuple(self.driven))

    @property
    def order(self) -> tuple[int, ...]:
        """An order in which the transition is triangular but for states that drive one another."""
        return tuple(state for group in self._groups for state in group)

    def init(self, priors: Sequence[Num]) -> list[Stmt]:
        """U is the identity, D the variances."""
        zero = For("i", 0, self.n, (For("j", "i", self.n, (Store(U("i", "j"), Num(0.0)),)),))
        ordered = [priors[s] for s in self.order]
        variances = [mul(sd, sd) if sd.value**2 >= MIN_D_ENTRY else Num(MIN_D_ENTRY) for sd in ordered]
        return [zero, *(Store(U(k, k), variance) for k, variance in enumerate(variances))]

    def predict(self, Phi: dict[int, Row], Qd: Noise) -> list[Stmt]:
        """Rows from the top, then what is below the diagonal is turned away, then the noise."""
        rows = {self.at[i]: {self.at[j]: c for j, c in row.items()} for i, row in Phi.items()}
        noise: dict[tuple[int, ...], Expr] = {
            tuple(sorted((self.at[i], self.at[j]))): q for (i, j), q in Qd.items()
        }
        body: list[Stmt] = []
        rescaled: list[Stmt] = []
        for group in self._groups:
            places = [self.at[i] for i in group]
            moving = {i: rows[i] for i in places if i in rows}
            body += self._right(places, moving)
            rescaled += (
                self._square(places, moving) if len(group) > 1 else scaled(places[0], _own(rows, places[0]))
            )
        body += rescaled
        body.append(Note("process noise"))
        return body + factors(noise, self.n, self._rank_one) + self._waiting()

    def _waiting(self) -> list[Stmt]:
        """Slow noise waits; when it has waited long enough that of one state comes in at each step, until all have theirs."""
        if not self.slow:
            return []
        begin = (Store(DUE, WAITED), Store(WAITED, Num(0.0)), Store(NEXT, Num(0.0)))
        due = When(Compare(">=", WAITED, Num(self.q_interval)), begin)
        come = When(Compare("<", NEXT, Num(float(len(self.slow)))), (FunctionCall("settle", ()),), (due,))
        return [Store(WAITED, add(WAITED, Ref("dt"))), come]

    @property
    def memory(self) -> dict[str, tuple[int, str]]:
        """How long slow noise has waited."""
        text = "slow noise: how long it has waited, for what time it comes in now [s], how many states have theirs"
        return {WAITED.name: (3, text)} if self.slow else {}

    @property
    def internals(self) -> tuple[Routine, ...]:
        """What held states need, and slow noise."""
        if not self.slow:
            return super().internals
        body: tuple[Stmt, ...] = ()
        ordered = sorted(self.slow.items(), key=lambda item: -self.at[item[0]])
        for k, (state, density) in reversed(list(enumerate(ordered))):
            top = self.at[state]
            own = (
                For("i", 0, top, (Store(Ref("a_", "i"), Num(0.0)),)),
                Store(Ref("a_", top), Num(1.0)),
                Store(Ref("c_", 0), mul(density, DUE)),
                *agee_turner(top + 1),
            )
            body = (When(Compare("<", NEXT, Num(k + 0.5)), own, body),) if body else own
        settle = Routine(
            "settle",
            "The noise of one slow state that has waited comes in.",
            (),
            (*body, Store(NEXT, add(NEXT, Num(1.0)))),
            (Scratch("a_", self.n), Scratch("c_", 1)),
            internal=True,
        )
        return (*super().internals, settle)

    def _right(self, group: Sequence[int], rows: Mapping[int, Row]) -> list[Stmt]:
        """Rows of a group in ``Phi U`` right of its own columns: of itself and of later rows, all still old."""
        rows = {i: row for i, row in rows.items() if row != {i: Num(1.0)}}
        coupled = {l for row in rows.values() for l in row}

        def column(k: Place) -> list[Stmt]:
            new = [(i, _times(i, row, k)) for i, row in rows.items()]
            new = [(i, value) for i, value in new if value != at(i, k, ARRAY)]
            body: list[Stmt] = []
            if len(new) > 1:
                names = [(i, f"v_{i}_{k if isinstance(k, int) else k.var}") for i, _ in new]
                body += [Let(name, value) for (_, name), (_, value) in zip(names, new)]
                new = [(i, Ref(name)) for i, name in names]
            return [*body, *(Store(at(i, k, ARRAY), value) for i, value in new)]

        right = range(group[-1] + 1, self.n)
        # The columns that are special come first: a row's own element in them is read by no other column.
        body = [s for k in right if k in coupled for s in column(k)]
        return body + each([k for k in right if k not in coupled], {*group, *coupled}, column, self.loops)

    def _square(self, group: Sequence[int], rows: Mapping[int, Row]) -> list[Stmt]:
        """A group's own columns of ``Phi U``, made a triangle again."""
        first = group[0]
        own = {i: rows.get(i, {i: Num(1.0)}) for i in group}
        needs = {i: {l for l in own[i] if l != i} for i in group}
        below = filled(group, needs)
        body: list[Stmt] = []
        made: dict[tuple[int, int], Expr] = {}
        for k in group:
            for i in group:
                value = _times(i, own[i], k)
                made[i - first, k - first] = value if value == U(i, k) else let(body, f"z_{i}_{k}", value)
            body += [Store(U(i, k), made[i - first, k - first]) for i in range(first, k)]
        size = range(len(group))
        diagonal = [made[k, k] for k in size]
        lower = {(i, c): made[i, c] for i in size for c in below[i]}
        return body + Square(first, below, diagonal, lower, self.loops).triangle()

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

    @property
    def predict_scratch(self) -> tuple[Scratch, ...]:
        """Local arrays of a prediction."""
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


def _own(rows: Mapping[int, Row], k: int) -> Expr:
    """The diagonal of Phi at a place."""
    return rows[k].get(k, Num(0.0)) if k in rows else Num(1.0)


def _times(i: int, row: Row, k: Place) -> Expr:
    """Row i of Phi times column k of U, its own place first; a diagonal is one, and below it is nothing."""
    last = k if isinstance(k, int) else k.after
    ordered = sorted(row.items(), key=lambda item: (item[0] != i, item[0]))
    terms = [c if l == k else mul(c, at(l, k, ARRAY)) for l, c in ordered if l == k or l <= last]
    return total(terms) if terms else Num(0.0)


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
