"""Groups of states that drive one another: ``Phi U`` of a group is no triangle, and is turned into one.

Two columns with their weights in D are turned against one another so that one element below the diagonal goes, which
leaves ``U D U'`` as it is; above the diagonal they stay where they are. It is the rotation of Agee and Turner, also for a
diagonal that is no longer one (Gentleman's rotation without square roots).

References
----------
.. [1] W. M. Gentleman, Least squares computations by Givens transformations without square roots,
   IMA J. Applied Mathematics 12(3), 1973.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from kfgen.emit.covariance.bierman import U, let
from kfgen.emit.covariance.order import rotations
from kfgen.emit.ir.ir import Bin, Expr, For, Let, Num, Ref, Stmt, Store, add, mul, sub

MIN_ROWS = 3
"""Rows that are worth a loop."""


class Square:
    """A group's own square of ``Phi U``: its triangle is stored, its diagonal and what is below are locals.

    Parameters
    ----------
    first : int
        Place of its first state.
    below : sequence of set of int
        Columns of each row below the diagonal that are not zero, by places in the group.
    diagonal : sequence of Expr
    lower : mapping of (int, int) to Expr
        Of `below`.
    loops : bool
        Rows above the group in a loop.
    """

    def __init__(
        self,
        first: int,
        below: Sequence[set[int]],
        diagonal: Sequence[Expr],
        lower: dict[tuple[int, int], Expr],
        loops: bool,
    ) -> None:
        self.first, self.below, self.loops = first, below, loops
        self.diagonal, self.lower = list(diagonal), dict(lower)
        self.body: list[Stmt] = []

    def triangle(self) -> list[Stmt]:
        """Statements after which only the triangle is left, with ones on its diagonal."""
        turned = dict(rotations(self.below))
        for r in range(len(self.below) - 1, -1, -1):
            for c in turned.get(r, ()):
                self._turn(r, c)
            self._scale(r)
        return self.body

    def _turn(self, r: int, c: int) -> None:
        """Columns r and c, so that nothing is left at (r, c)."""
        p, s = self.diagonal[r], self.lower[r, c]
        D, d = U(self.first + r, self.first + r), U(self.first + c, self.first + c)
        tag = f"{self.first + r}_{self.first + c}"
        weight = let(self.body, f"turn_t_{tag}", mul(d, s))
        if p == Num(1.0):
            new = let(self.body, f"turn_d_{tag}", add(D, mul(weight, s)))
            share = let(self.body, f"turn_o_{tag}", Bin("/", d, new))
            beta, left = let(self.body, f"turn_e_{tag}", mul(s, share)), mul(share, D)
            self._columns(r, c, Num(1.0), s, None, beta)
        else:
            pull = let(self.body, f"turn_p_{tag}", mul(D, p))
            new = let(self.body, f"turn_d_{tag}", add(mul(pull, p), mul(weight, s)))
            over = let(self.body, f"turn_o_{tag}", Bin("/", Num(1.0), new))
            own = let(self.body, f"turn_g_{tag}", mul(pull, over))
            beta, left = let(self.body, f"turn_e_{tag}", mul(weight, over)), mul(mul(d, over), D)
            self._columns(r, c, p, s, own, beta)
        self.body += [Store(d, left), Store(D, new)]
        self.diagonal[r] = Num(1.0)

    def _columns(self, r: int, c: int, p: Expr, s: Expr, own: Expr | None, beta: Expr) -> None:
        """``w' = p w - s u`` in column c, ``u' = g u + e w`` in column r; the same by w' where the diagonal is one."""
        for i in self._rows(c):
            place, inner = U(i, self.first + c), list[Stmt]()
            new = self._turned(inner, place, U(i, self.first + r), (p, s, own, beta))
            inner.append(Store(place, new))
            self.body += [For("i", 0, self.first, tuple(inner))] if i == "i" else inner
        for k in range(c, r):
            u = U(self.first + k, self.first + r)
            w: Expr = self.diagonal[k] if k == c else self.lower.get((k, c), Num(0.0))
            new = self._turned(self.body, w, u, (p, s, own, beta))
            if k == c:
                self.diagonal[k] = new
            else:
                self.lower[k, c] = new

    def _turned(self, body: list[Stmt], w: Expr, u: Ref, by: tuple[Expr, Expr, Expr | None, Expr]) -> Expr:
        """Stores the new u; returns the new w."""
        p, s, own, beta = by
        new = self._name(body, sub(mul(p, w), mul(s, u)))
        value = add(u, mul(beta, new)) if own is None else add(mul(own, u), mul(beta, w))
        body.append(Store(u, value))
        return new

    def _name(self, body: list[Stmt], value: Expr) -> Expr:
        name = f"w_{self.first}_{len(self.body)}_{len(body)}"
        body.append(Let(name, value))
        return Ref(name)

    def _rows(self, columns: int) -> Iterator[int | str]:
        """Rows above the diagonal of a group's column; those above the group as a loop where that is wanted."""
        if self.loops and self.first >= MIN_ROWS:
            yield "i"
        else:
            yield from range(self.first)
        yield from range(self.first, self.first + columns)

    def _scale(self, r: int) -> None:
        """Column r is divided by its diagonal, D takes the square."""
        self.body += scaled(self.first + r, self.diagonal[r])


def scaled(k: int, d: Expr) -> list[Stmt]:
    """A column with d on its diagonal is divided by it, and D takes its square.

    Parameters
    ----------
    k : int
        Place.
    d : Expr
    """
    if d == Num(1.0):
        return []
    over = Ref(f"over_{k}")
    body: list[Stmt] = [Let(over.name, Bin("/", Num(1.0), d))]
    body += [Store(U(i, k), mul(U(i, k), over)) for i in range(k)]
    return [*body, Store(U(k, k), mul(mul(d, d), U(k, k)))]
