"""The routine `align` of an emitted filter: `kfgen.emit.align` says how."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import sympy as sp

from kfgen.emit.align import (
    AHEAD,
    ALIGN_TEXT,
    HEADING,
    LEAST_HORIZONTAL,
    MAX_NOSE,
    SPREAD,
    TILTED,
    Alignment,
)
from kfgen.emit.covariance.correction import GAIN
from kfgen.emit.guards import every, possible_step, sum_of_squares, within
from kfgen.emit.ir.ir import (
    Argument,
    Bin,
    Compare,
    Expr,
    FunctionCall,
    Let,
    Num,
    Ref,
    Routine,
    Scratch,
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
from kfgen.emit.ir.tidy import tidy
from kfgen.emit.settings import MAX_BY_UNIT
from kfgen.emit.targets.names import argument, identifier
from kfgen.emit.watch.quiet import WHY, Quiet, because, squared
from kfgen.model.parts.motion import GYRO, Input

if TYPE_CHECKING:
    from kfgen.emit.routines import Program

Triad = list[Expr]


class AlignRoutine:
    """Alignment as statements.

    Parameters
    ----------
    program : Program
        Its model has an attitude, a gyro, and what points up.
    """

    def __init__(self, program: Program) -> None:
        self.program = program
        self.alignment = Alignment(program.discrete.model)
        self.lower: Lowering = program.lowering("a")
        self.at = program.supervisor.number
        north = self.alignment.north
        names = {"FORCE": self._up_name, "RATE": GYRO.name, "FIELD": north.name if north else ""}
        samples = {s: names[s] for s in self.alignment.sums}
        self.quiet = Quiet(program, "ALIGN", samples, self._up_name, GYRO.name)
        self.sums = self.quiet.sums

    @property
    def arguments(self) -> tuple[Argument, ...]:
        """A sample of each triad, or the heading, and the step."""
        found = [self._triad(self._up_name, "specific force [m/s^2], body axes")]
        found.append(self._triad(GYRO.name, "angular rate [rad/s], body axes"))
        north = self.alignment.north
        if north is None:
            found.append(
                Argument(HEADING, 0, "heading of the body's forward axis from north [rad], as it is given")
            )
        else:
            found.append(self._triad(north.name, f"{north.title} [{north.unit}], body axes"))
        return (*found, Argument("dt", 0, "step [s]"))

    @staticmethod
    def _triad(name: str, text: str) -> Argument:
        return Argument(argument(name), 3, text)

    @property
    def _up_name(self) -> str:
        assert self.alignment.up is not None
        return self.alignment.up.name

    def routine(self) -> Routine:
        """All of it."""
        scratch = (
            Scratch(GAIN, self.program.n),
            *(Scratch(name, size) for name, size in ((SPREAD, 1), (TILTED, 1), (WHY, 1), (AHEAD, 3))),
        )
        return Routine("align", ALIGN_TEXT, self.arguments, tidy(self.body(self.covariance())), scratch)

    def covariance(self) -> tuple[Stmt, ...]:
        """At the priors, the attitude's variance at the tilt's, and more about the vertical."""
        form = self.program.covariance
        return (
            *form.init([self.program.prior(i) for i in range(self.program.n)]),
            *(Store(self._variance(i), Ref(TILTED, 0)) for i in self.errors),
            When(
                Compare(">", Ref(SPREAD, 0), Num(0.0)),
                (FunctionCall("inflate", (Ref(GAIN), Ref(SPREAD, 0))),),
            ),
        )

    @property
    def errors(self) -> list[int]:
        """Places of the attitude among the error states."""
        attitude = self.program.discrete.model.attitude
        assert attitude is not None
        names = [s.name for s in self.program.discrete.model.states]
        return [names.index(n) for n in attitude.error_names]

    def _variance(self, state: int) -> Ref:
        form = self.program.covariance
        found = form.diagonal[form.order.index(state)]
        assert isinstance(found, Ref)
        return found

    def body(self, known: Sequence[Stmt]) -> tuple[Stmt, ...]:
        """The statements; `known` are those on the covariance, once the attitude is there."""
        start = Store(self.at("ALIGNING"), Num(1.0))
        disturbed = Compare(">", Ref(WHY, 0), Num(0.0))
        waiting = StatusFlag("ALIGNING")
        done = When(self.quiet.enough, tuple(self._attitude(known)), (waiting,))
        quiet = When(disturbed, (*self._thrown_away(), waiting), (*self.quiet.gathered(), done))
        inner = (start, *self.quiet.disturbed(), quiet)
        allowed = When(every(self._looked()), inner, (StatusFlag("BAD_INPUT"),))
        step = possible_step(self.program.discrete.max_step)
        return (When(step, (allowed,), (StatusFlag("BAD_STEP"),)),)

    def _looked(self) -> list[Compare]:
        looked: list[Compare] = []
        for a in self.arguments[:-1]:
            looked += within(a, self._limit(a))
        north = self.alignment.north
        if north is not None and north.min_length:
            least = self.program.setting(f"MIN_{identifier(north.name).upper()}")
            looked.append(Compare(">=", sum_of_squares(self.quiet.sample(north.name)), mul(least, least)))
        return looked

    def _limit(self, a: Argument) -> Num:
        if a.name == HEADING:
            return Num(MAX_BY_UNIT["rad"])
        part = {argument(p.name): p for p in (self.alignment.up, self.alignment.north) if p is not None}.get(
            a.name
        )
        if part is None or isinstance(part, Input):
            return self.program.input_limit(a.name)
        return self.program.setting(f"MAX_{identifier(part.name).upper()}_SAMPLE")

    def _thrown_away(self) -> list[Stmt]:
        return [Store(self.at("ALIGN_REASON"), Ref(WHY, 0)), *self.quiet.emptied()]

    def _let(self, body: list[Stmt], value: Expr, stem: str) -> Expr:
        atom, made = self.lower.let(value, stem)
        body += made
        return atom

    def _lets(self, body: list[Stmt], values: Sequence[Expr], stem: str) -> Triad:
        return [self._let(body, v, stem) for v in values]

    def _unit(self, body: list[Stmt], v: Triad, stem: str) -> Triad:
        square = self._let(body, sum_of_squares(v), f"{stem}square")
        over = self._let(body, Bin("/", Num(1.0), Una("sqrt", square)), f"{stem}over")
        return self._lets(body, [mul(c, over) for c in v], stem)

    def _cross(self, body: list[Stmt], a: Triad, b: Triad, stem: str) -> Triad:
        pairs = ((1, 2), (2, 0), (0, 1))
        return self._lets(body, [sub(mul(a[i], b[j]), mul(a[j], b[i])) for i, j in pairs], stem)

    def _attitude(self, known: Sequence[Stmt]) -> list[Stmt]:
        """From the means; thrown away where the field points along the vertical."""
        body: list[Stmt] = []
        over = self._let(body, Bin("/", Num(1.0), self.at("ALIGN_COUNT")), "over")
        down = self._unit(body, [neg(s) for s in self.sums("FORCE")], "down")
        ahead: Triad = [Ref(AHEAD, i) for i in range(3)]
        body += self._ahead(down, over)
        across = self._cross(body, down, ahead, "across")
        horizontal = self._let(body, sum_of_squares(across), "flat")
        square = self._let(body, sum_of_squares(ahead), "aheadsquare")
        least = mul(Num(LEAST_HORIZONTAL**2), square)
        inner: list[Stmt] = []
        R, vertical = self._rotation(inner, down, across, ahead)
        inner += self._quaternion(R)
        inner += self._deviations(over, down, vertical)
        inner += [*known, *self.quiet.emptied()]
        inner += [Store(self.at(n), Num(0.0)) for n in ("ALIGNING", "ALIGN_REASON")]
        refused = (because("NO_HORIZONTAL_FIELD"), *self._thrown_away(), StatusFlag("ALIGNING"))
        return [*body, When(Compare(">=", horizontal, least), tuple(inner), refused)]

    def _ahead(self, down: Triad, over: Expr) -> list[Stmt]:
        """The mean of the field without what the body adds to it, else the forward axis."""
        ahead = [Ref(AHEAD, i) for i in range(3)]
        north = self.alignment.north
        if north is not None:
            own, body = self.lower.many(self.alignment.offset)
            means = [sub(mul(s, over), o) for s, o in zip(self.sums("FIELD"), own)]
            return [*body, *(Store(a, m) for a, m in zip(ahead, means))]
        limit = Num(MAX_NOSE**2)
        flat = Compare("<", mul(down[0], down[0]), limit)
        forward, below = ([Store(a, Num(float(i == k))) for i, a in enumerate(ahead)] for k in (0, 2))
        return [When(flat, tuple(forward), tuple(below))]

    def _rotation(
        self, body: list[Stmt], down: Triad, across: Triad, ahead: Triad
    ) -> tuple[list[Triad], Triad]:
        """``R_nb`` by rows, and the vertical in navigation axes."""
        level = self.alignment.level.T
        if self.alignment.north is None:
            psi = sp.Symbol(HEADING, real=True)
            self.lower.places[HEADING] = Ref(HEADING)
            wanted = level * sp.Matrix([sp.cos(psi), sp.sin(psi), 0])
        else:
            wanted = self.alignment.field
        values, made = self.lower.many([*(level * sp.Matrix([0, 0, 1])), *wanted])
        body += made
        down_n, wanted_n = self._lets(body, values[:3], "downn"), self._lets(body, values[3:], "wantn")
        east_b = self._unit(body, across, "eastb")
        north_b = self._cross(body, east_b, down, "northb")
        east_n = self._unit(body, self._cross(body, down_n, wanted_n, "acrossn"), "eastn")
        north_n = self._cross(body, east_n, down_n, "northn")
        if self.alignment.north is not None:
            body += self._field(ahead, down, across, (north_n, down_n))
        triads = ((north_n, north_b), (east_n, east_b), (down_n, down))
        rows = []
        for i in range(3):
            entries = []
            for j in range(3):
                total: Expr = Num(0.0)
                for n, b in triads:
                    total = add(total, mul(n[i], b[j]))
                entries.append(self._let(body, total, "r"))
            rows.append(entries)
        return rows, down_n

    def _field(self, ahead: Triad, down: Triad, across: Triad, axes: tuple[Triad, Triad]) -> list[Stmt]:
        """The components of the field as the magnetometer shows them, where the sensor tells them at rest."""
        assert self.alignment.north is not None
        names = self.alignment.shown_at_rest
        if not names:
            return []
        body: list[Stmt] = []
        flat = self._let(body, Una("sqrt", sum_of_squares(across)), "flat")
        products = [mul(a, b) for a, b in zip(ahead, down)]
        steep = self._let(body, add(add(products[0], products[1]), products[2]), "steep")
        north_n, down_n = axes
        shown = [self._let(body, add(mul(flat, n), mul(steep, d)), "field") for n, d in zip(north_n, down_n)]
        for name, (i, sign) in names.items():
            place = self.lower.places[name]
            assert isinstance(place, Ref)
            body.append(Store(place, mul(Num(sign), shown[i])))
        return body

    def _quaternion(self, R: list[Triad]) -> list[Stmt]:
        """Of a rotation matrix, by its largest component: no square root of what is nearly zero."""
        names = self.program.discrete.nominal_names
        attitude = self.program.discrete.model.attitude
        assert attitude is not None
        q = [Ref("x", names.index(n)) for n in attitude.nominal_names]
        plus = {(i, j): add(R[i][j], R[j][i]) for i, j in ((0, 1), (0, 2), (1, 2))}
        turn = [sub(R[2][1], R[1][2]), sub(R[0][2], R[2][0]), sub(R[1][0], R[0][1])]
        traces = [
            add(Num(1.0), add(add(R[0][0], R[1][1]), R[2][2])),
            *(
                add(Num(1.0), sub(sub(R[i][i], R[j][j]), R[k][k]))
                for i, j, k in ((0, 1, 2), (1, 0, 2), (2, 0, 1))
            ),
        ]
        columns = [
            [None, *turn],
            [turn[0], None, plus[0, 1], plus[0, 2]],
            [turn[1], plus[0, 1], None, plus[1, 2]],
            [turn[2], plus[0, 2], plus[1, 2], None],
        ]
        made: tuple[Stmt, ...] = ()
        for k in reversed(range(4)):
            half = Ref(f"half_{k}")
            share = Ref(f"share_{k}")
            own: list[Stmt] = [
                Let(half.name, mul(Num(0.5), Una("sqrt", Ref(f"trace_{k}")))),
                Let(share.name, Bin("/", Num(0.25), half)),
            ]
            own += [Store(c, half if e is None else mul(e, share)) for c, e in zip(q, columns[k])]
            large = Compare(">=", Ref(f"trace_{k}"), Num(1.0))
            made = tuple(own) if k == 3 else (When(large, tuple(own), made),)
        return [*(Let(f"trace_{k}", t) for k, t in enumerate(traces)), *made]

    def _deviations(self, over: Expr, down: Triad, vertical: Triad) -> list[Stmt]:
        """Variance of the tilt, of the heading beyond it, and the vertical in the axes of the error."""
        setting = self.program.setting
        body: list[Stmt] = []
        rates = [self._let(body, mul(s, over), "rate") for s in self.sums("RATE")]
        half = mul(mul(self.at("ALIGN_GATHERED"), Num(0.5)), self.at("ALIGN_GATHERED"))
        turned = self._let(body, mul(sum_of_squares(rates), mul(half, Num(0.5))), "turned")
        tilt, heading = (squared(setting(n)) for n in ("ALIGN_TILT", "ALIGN_HEADING"))
        body.append(Store(Ref(TILTED, 0), add(tilt, turned)))
        body.append(Store(Ref(SPREAD, 0), sub(heading, tilt)))
        attitude = self.program.discrete.model.attitude
        assert attitude is not None
        axis = down if attitude.convention.side.body else vertical
        return [*body, *(Store(Ref(GAIN, i), a) for i, a in zip(self.errors, axis))]
