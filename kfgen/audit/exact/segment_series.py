"""`SegmentSeries`: the motion of a segment as the filter sees it, everything that F and H depend on, as power series of the time since a segment began."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from fractions import Fraction
from functools import lru_cache

import sympy as sp

from kfgen.audit.exact.padic import Degenerate, Ring, echelon
from kfgen.audit.exact.plan import Plan
from kfgen.audit.exact.power_series import Coefficients, Runner, convolved, exact_writer
from kfgen.core.straight_line import decimal
from kfgen.manoeuvre.manoeuvre import INPUT_FORMULA_ORDER, TIME, Manoeuvre, Segment, of_time

State = Mapping[sp.Symbol, int]
"""Residues of the attitude's atoms and of the blocks at a segment's start."""


def start_of(plan: Plan, manoeuvre: Manoeuvre, ring: Ring, *, generic: bool) -> dict[sp.Symbol, int]:
    """Where a manoeuvre starts; `generic` as in `Plan.start`.

    At a generic start what stands inside a sine is a multiple of p, so that sines of related arguments stay related.

    Parameters
    ----------
    plan : Plan
    manoeuvre : Manoeuvre
    ring : Ring
    generic : bool
        As in `Plan.start`.
    """
    small = plan.curved if generic else frozenset()
    out = {s: ring.of(v) * (ring.p if s in small else 1) for s, v in plan.start(generic=generic).items()}
    if not plan.rotation:
        return out
    level = turn_of(plan)
    own = rotation([decimal(c) for c in manoeuvre.attitude])
    R = [sum(level[3 * i + k] * own[3 * k + j] for k in range(3)) for i in range(3) for j in range(3)]
    out |= {s: ring.of(Fraction(v)) for s, v in zip(plan.rotation, R)}
    v_l = [decimal(v) for v in manoeuvre.velocity]
    for b in plan.vectors:
        if b.name == "v" and b.name in plan.given:
            v_n = [sum((level[3 * i + k] * v_l[k] for k in range(3)), Fraction(0)) for i in range(3)]
            out |= {s: ring.of(v) for s, v in zip(b.nominal, v_n)}
    return out


def turn_of(plan: Plan) -> list[Fraction]:
    """The rotation from north-east-down at the start to navigation axes, exactly a rotation."""
    return rotation([decimal(c) for c in plan.frame])


def rotation(q: list[Fraction]) -> list[Fraction]:
    """The nine entries of ``R_nb`` of a quaternion of any length, exactly."""
    return list(_rotation(tuple(q)))


@lru_cache(maxsize=64)
def _rotation(q: tuple[Fraction, ...]) -> tuple[Fraction, ...]:
    from kfgen.model.symbols.rotation import matrix_of

    # The entries are one less or zero plus squares: over the length, exact for any quaternion.
    length, one = sum(c * c for c in q), sp.eye(3)
    squares = [Fraction(int(e.p), int(e.q)) / length for e in matrix_of(q) - one]
    return tuple(e + int(o) for e, o in zip(squares, one))


class SegmentSeries:
    """A segment in a ring.

    Parameters
    ----------
    plan : Plan
    ring : Ring
    segment : Segment
    length : float
        Of the whole manoeuvre [s].
    start : mapping of Symbol to int
    """

    def __init__(self, plan: Plan, ring: Ring, segment: Segment, length: float, start: State) -> None:
        self.plan, self.ring = plan, ring
        self.orders = 0
        self.series: dict[sp.Symbol, Coefficients] = {s: [] for s in plan.variables}
        for s, value in start.items():
            self.series[s].append(value)
        self._time: Coefficients = []
        writer = exact_writer([TIME])
        places = [writer.place(e) for e in segment.formulas(length)]
        named = {n: writer.place(of_time(e, length)) for n, e in segment.inputs.items()}
        self._formulas = Runner(writer, ring, [self._time])
        self._motion = [self._formulas.series[k] for k in places]
        self._named = {n: self._formulas.series[k] for n, k in named.items()}
        given = [self.series[s] for s in plan.variables]
        self._control = Runner(plan.control.writer, ring, given) if plan.control else None
        self._main = Runner(plan.writer, ring, given)
        self._level = [ring.of(e) for e in turn_of(plan)] if plan.rotation else [1, 0, 0, 0, 1, 0, 0, 0, 1]
        self._acceleration: list[Coefficients] = [[], [], []]
        self._J0: list[list[int]] = []
        self._free = self._free_inputs()
        self.F = [(i, j, self._main.series[k]) for i, j, k in plan.F]
        self.H = [(i, j, self._main.series[k]) for i, j, k in plan.H]

    def _free_inputs(self) -> dict[sp.Symbol, Coefficients | None]:
        """Inputs that the manoeuvre does not determine: as it names them, its own signals, or generic."""
        determined = self.plan.control.channels if self.plan.control else ()
        out: dict[sp.Symbol, Coefficients | None] = {}
        for k, c in enumerate(c for c in self.plan.channels if c not in determined):
            plain = (
                self._motion[INPUT_FORMULA_ORDER[k % len(INPUT_FORMULA_ORDER)]]
                if self.plan.control is None
                else None
            )
            out[sp.Symbol(c, real=True)] = self._named.get(c, plain)
        for d in self.plan.model.drivers:
            out[sp.Symbol(d, real=True)] = None
        return out

    def extend(self, orders: int) -> None:
        """Know everything to so many orders."""
        while self.orders < orders:
            self._step(self.orders)
            self.orders += 1

    def _step(self, k: int) -> None:
        self._time.append(1 if k == 1 else 0)
        self._formulas.step(k)
        self._accelerate(k)
        for s, known in self._free.items():
            self.series[s].append(self._generic(s, k) if known is None else known[k])
        if self._control is not None:
            self._solve(k)
        self._main.step(k)
        self._advance(k)

    def _generic(self, s: sp.Symbol, k: int) -> int:
        """A coefficient of a signal of which nothing is special."""
        digest = hashlib.shake_256(f"{s.name} {k}".encode()).digest(6)
        return int.from_bytes(digest, "big") % self.ring.m

    def _accelerate(self, k: int) -> None:
        """Acceleration in navigation axes: its own part, and the body's turned by the attitude."""
        R = [self.series[s] for s in self.plan.rotation]
        for i in range(3):
            total = sum(self._level[3 * i + j] * self._motion[3 + j][k] for j in range(3))
            for j in range(3) if R else ():
                total += convolved(self._motion[6 + j], R[3 * i + j], k)
            self._acceleration[i].append(total % self.ring.m)

    def _target(self, name: str) -> list[Coefficients]:
        return self._acceleration if name == "v" else self._motion[:3]

    def _solve(self, k: int) -> None:
        """Coefficient k of the inputs that make the rates what they should be."""
        control, runner = self.plan.control, self._control
        assert control is not None
        assert runner is not None
        runner.step(k)
        targets = [c for n in control.targets for c in self._target(n)]
        J = [[runner.series[e] for e in row] for row in control.J]
        u = [self.series[sp.Symbol(c, real=True)] for c in control.channels]
        rest = [
            target[k]
            - runner.series[b][k]
            - sum(Jij[l] * uj[k - l] for Jij, uj in zip(row, u) for l in range(1, k + 1) if Jij[l])
            for target, b, row in zip(targets, control.b, J)
        ]
        if not k:
            self._J0 = inverse([[e[0] for e in row] for row in J], self.ring)
        for row, c in zip(self._J0, u):
            c.append(sum(a * r for a, r in zip(row, rest) if a) % self.ring.m)

    def _advance(self, k: int) -> None:
        """Coefficient k + 1 of the blocks."""
        m, over = self.ring.m, self.ring.inverse(k + 1)
        plan, rates = self.plan, self.plan.rates
        main = self._main.series
        for b in plan.vectors:
            given = b.name in plan.given
            slopes = self._target(b.name) if given else [main[e] for e in rates.get(b.name, ())]
            for s, slope in zip(b.nominal, slopes):
                self.series[s].append(slope[k] * over % m)
            if not slopes:
                for s in b.nominal:
                    self.series[s].append(0)
        if not plan.rotation:
            return
        name = plan.model.attitude.name if plan.model.attitude is not None else ""
        w = self._motion[:3] if name in plan.given else [main[e] for e in rates[name]]
        R = [self.series[s] for s in plan.rotation]
        for i in range(3):
            row = R[3 * i : 3 * i + 3]
            new = [
                convolved(w[c], row[b], k) - convolved(w[b], row[c], k) for b, c in ((1, 2), (2, 0), (0, 1))
            ]
            for series, value in zip(row, new):
                series.append(value * over % m)

    def at(self, T: int) -> dict[sp.Symbol, int]:
        """The blocks at a time [a multiple of p] after the start."""
        moving = (*self.plan.rotation, *(s for b in self.plan.vectors for s in b.nominal))
        return {s: summed(self.series[s], T, self.ring) for s in moving}


def summed(series: Coefficients, T: int, ring: Ring) -> int:
    """The value of a power series at a multiple of p.

    Parameters
    ----------
    series : list of int
        Coefficients.
    T : int
        The time, a multiple of p.
    ring : Ring
    """
    total = 0
    for c in reversed(series):
        total = (total * T + c) % ring.m
    return total


def inverse(A: list[list[int]], ring: Ring) -> list[list[int]]:
    """The inverse of a matrix; raises `Degenerate` where p divides its determinant.

    Parameters
    ----------
    A : list of list of int
        Residues, one list a row.
    ring : Ring
    """
    n = len(A)
    rows = echelon([[*row, *(int(i == j) for j in range(n))] for i, row in enumerate(A)], range(n), ring)
    if len(rows) < n:
        raise Degenerate("a matrix without inverse modulo p")
    return [row[n:] for row in rows]
