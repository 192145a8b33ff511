"""The present state of a filter that runs behind: a step by the newest inputs, and a share of what it is off the filter.

With C the corrections that the present state o had until a row of the ring was written, the row keeps ``o - C`` (of an
attitude ``C^-1 o``, C being a rotation in navigation axes). Once the filter has come to it, all corrections since are
added, and what the filter differs by then, times ``dt / tau``, is added to C and to o: no row need be touched again. C
begins again with each turn of the ring, so that it stays small.
"""

from __future__ import annotations

from collections.abc import Sequence

from kfgen.emit.guards import finite, sum_of_squares
from kfgen.emit.horizon.memory import PRESENT, HorizonMemory
from kfgen.emit.ir.ir import (
    Bin,
    Compare,
    Expr,
    Let,
    Num,
    Ref,
    StatusFlag,
    Stmt,
    Store,
    Una,
    When,
    add,
    mul,
    neg,
    sub,
)
from kfgen.emit.ir.lower import Lowering

Four = Sequence[Expr]
FOLLOW = Ref("follow", 0)
"""Scratch: share of the difference that is corrected."""
ONE = (Num(1.0), Num(0.0), Num(0.0), Num(0.0))


def product(a: Four, b: Four) -> list[Expr]:
    """Of two quaternions."""
    rows = (
        ((0, 0, 1), (1, 1, -1), (2, 2, -1), (3, 3, -1)),
        ((0, 1, 1), (1, 0, 1), (2, 3, 1), (3, 2, -1)),
        ((0, 2, 1), (2, 0, 1), (3, 1, 1), (1, 3, -1)),
        ((0, 3, 1), (3, 0, 1), (1, 2, 1), (2, 1, -1)),
    )
    out: list[Expr] = []
    for row in rows:
        total: Expr = Num(0.0)
        for i, j, sign in row:
            term = mul(a[i], b[j])
            total = add(total, term) if sign > 0 else sub(total, term)
        out.append(total)
    return out


def inverse(q: Four) -> list[Expr]:
    """Of a unit quaternion."""
    return [q[0], *(neg(c) for c in q[1:])]


class Predictor:
    """The present state.

    Parameters
    ----------
    memory : HorizonMemory
    """

    def __init__(self, memory: HorizonMemory) -> None:
        self.memory, self.program = memory, memory.program
        self.present = [Ref(PRESENT, i) for i in range(len(memory.moving))]
        self.attitude = [self.present[i] for i in memory.quaternion]
        self._local = Lowering({}, "o")

    def _lets(self, body: list[Stmt], values: Sequence[Expr]) -> list[Expr]:
        out: list[Expr] = []
        for value in values:
            name = self._local.fresh("v")
            body.append(Let(name, value))
            out.append(Ref(name))
        return out

    def _unit(self, body: list[Stmt], q: Four) -> list[Expr]:
        own = self._lets(body, q)
        (over,) = self._lets(body, [Bin("/", Num(1.0), Una("sqrt", sum_of_squares(own)))])
        return self._lets(body, [mul(c, over) for c in own])

    def _four(self, before: bool = False) -> list[Ref]:
        return [self.memory.correction(i, before) for i in self.memory.quaternion]

    def begin(self) -> list[Stmt]:
        """At the filter's state, without corrections."""
        m = self.memory
        body: list[Stmt] = [Store(o, Ref("x", i)) for o, i in zip(self.present, m.moving)]
        for before in (False, True):
            body += [Store(m.correction(i, before), Num(0.0)) for i in m.vectors]
            body += [Store(c, v) for c, v in zip(self._four(before), ONE)]
        return body

    def step(self) -> list[Stmt]:
        """By the newest inputs; a state that would not be finite is not stored."""
        program, names = self.program, self.program.discrete.nominal_names
        lower = program.lowering("p")
        lower.places |= {names[i]: o for i, o in zip(self.memory.moving, self.present)}
        used = [program.atoms.of_corrected_inputs(program.discrete.step[i]) for i in self.memory.moving]
        body = program.atoms.make(lower, used)
        values, made = lower.many(used)
        body += made
        new = self._lets(body, values)
        q = self._unit(body, [new[i] for i in self.memory.quaternion]) if self.attitude else []
        for i, value in zip(self.memory.quaternion, q):
            new[i] = value
        total, known = finite(new, "sum_o")
        stores = tuple(Store(o, v) for o, v in zip(self.present, new))
        return [*body, total, When(known, stores, (StatusFlag("NOT_FINITE"),))]

    def keep(self, row: str) -> list[Stmt]:
        """The present state without its corrections, into a row of the ring."""
        m = self.memory
        body: list[Stmt] = [Store(m.kept(row, i), sub(self.present[i], m.correction(i))) for i in m.vectors]
        if self.attitude:
            plain = self._lets(body, product(inverse(self._four()), self.attitude))
            body += [Store(m.kept(row, i), c) for i, c in zip(m.quaternion, plain)]
        return body

    def turn(self) -> list[Stmt]:
        """The ring begins again, and the corrections with it."""
        m = self.memory
        body: list[Stmt] = []
        for i in m.vectors:
            body += [Store(m.correction(i, True), m.correction(i)), Store(m.correction(i), Num(0.0))]
        body += [Store(b, c) for b, c in zip(self._four(True), self._four())]
        return [*body, *(Store(c, v) for c, v in zip(self._four(), ONE))]

    def correct(self, row: str, dt: Expr) -> list[Stmt]:
        """Towards the filter's state, which has just come to a row of the ring.

        Parameters
        ----------
        row : str
        dt : Expr
            Its step.
        """
        m, watch = self.memory, self.program.supervisor
        tau, settle = self.program.setting("TAU_PRESENT"), self.program.setting("SETTLE_TIME")
        share = Store(FOLLOW, Bin("/", dt, tau))
        body: list[Stmt] = [
            Store(FOLLOW, Num(1.0)),
            When(Compare(">=", watch.at("SINCE_RESET"), settle), (When(Compare(">", tau, dt), (share,)),)),
        ]
        for i in m.vectors:
            known = add(add(m.kept(row, i), m.correction(i, True)), m.correction(i))
            (off,) = self._lets(body, [mul(FOLLOW, sub(Ref("x", m.moving[i]), known))])
            body += [Store(c, add(c, off)) for c in (m.correction(i), self.present[i])]
        return [*body, *(self._turned(row) if self.attitude else [])]

    def _turned(self, row: str) -> list[Stmt]:
        """The same of the attitude: a share of the rotation between the two, by the shorter way."""
        m = self.memory
        body: list[Stmt] = []
        kept = [m.kept(row, i) for i in m.quaternion]
        before = self._lets(body, product(self._four(True), kept))
        known = self._lets(body, product(self._four(), before))
        filtered = [Ref("x", m.moving[i]) for i in m.quaternion]
        off = self._lets(body, product(filtered, inverse(known)))
        (side,) = self._lets(body, [mul(FOLLOW, Una("sign", off[0]))])
        least = add(sub(Num(1.0), FOLLOW), mul(side, off[0]))
        turn = self._unit(body, [least, *(mul(side, c) for c in off[1:])])
        for q in (self._four(), self.attitude):
            own = self._unit(body, product(turn, q))
            body += [Store(c, v) for c, v in zip(q, own)]
        return body
