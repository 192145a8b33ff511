"""The first attitude of a body that moves: level from the change of its velocity, heading from a course or a sensor.

Between two fixes of velocity, T apart, the specific force adds up to ``S = int R' f dt`` in the body's axes at the end,
and in navigation axes that is ``F = v - v_0 - g T`` [1]_. One direction in both, f = F/|F| and s = S/|S|; what is left, a
turn about f, is found from a direction d of the body (its forward axis, the field) whose horizontal part is along a
known heading psi. With ``p = (-sin psi, cos psi, 0)``, ``w = (p - (f p) f) / q``, ``u = f x w``, ``c = s d``:

    R d = c f + sqrt(1 - c^2) (cos a u + sin a w),    sin a = -c (f p) / (q sqrt(1 - c^2)).

References
----------
.. [1] M. Wu, Y. Wu, X. Hu, D. Hu, Optimization-based alignment for inertial navigation systems: theory and algorithm,
   Aerospace Science and Technology 15(1), 2011.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import sympy as sp

from kfgen.core.units import STANDARD_GRAVITY
from kfgen.emit.align import HEADING, MAX_NOSE, SPREAD, TILTED
from kfgen.emit.align_routine import AlignRoutine, Triad
from kfgen.emit.covariance.correction import GAIN
from kfgen.emit.guards import every, possible_step, sum_of_squares, within
from kfgen.emit.ir.ir import (
    All,
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
from kfgen.emit.ir.tidy import tidy
from kfgen.emit.moving.places import FIRST, SUMS, alignable
from kfgen.emit.watch.quiet import REASONS
from kfgen.model.parts.motion import ACCEL, GRAVITY, GYRO

if TYPE_CHECKING:
    from kfgen.emit.routines import Program

LEAST_UP, LEAST_UP_OF_FIELD = 0.8, 0.95
"""Share of the vertical in the mean specific force: a level turn banked by 37 degrees, by 18 where a steep field shows north."""
LEAST_ALONG = 0.75
"""Squared cosine of the turn about the force that the heading asks for: beyond 30 degrees it has two answers."""
LEAST_SIDE = 0.25
"""Sine of the angle between the force and the field."""
LONGEST = 4.0
"""Times `ALIGN_TIME` without a second velocity, after which it begins again."""
GATHER_TEXT = "A sample of a body that moves, before its attitude is known: what align_moving needs between two velocities."
MOVING_TEXT = (
    "A velocity of a body that moves: the attitude is known (OK) from two of them that are ALIGN_TIME apart at least, with "
    "align_gather called for each inertial sample between them; until then ALIGNING, with the reason. Then the velocity is "
    "that of the fix, the covariance at the priors, and other states stay as they are."
)
COURSE_TEXT = "The same of a vehicle that moves along its forward axis: its heading is its course."


class MovingAlign(AlignRoutine):
    """Alignment in motion as statements.

    Parameters
    ----------
    program : Program
        Its model is `alignable`.
    matrix : bool
        The covariance belongs to the target, which sets it itself where ``known`` is 1.
    """

    def __init__(self, program: Program, matrix: bool = False) -> None:
        super().__init__(program)
        self.matrix = matrix

    def routines(self) -> tuple[Routine, ...]:
        """What gathers, what aligns by a heading or a field, and where there is none by the course."""
        course = () if self.alignment.north else (self._course(),)
        return (self._gather(), self._moving(), *course)

    @property
    def velocity(self) -> Argument:
        """The argument."""
        return Argument("v", 3, "velocity [m/s]: north, east, down")

    def _gather(self) -> Routine:
        accel, gyro = (self._triad(i.name, f"{i.title} [{i.unit}], body axes") for i in (ACCEL, GYRO))
        f, w = (self.quiet.sample(i.name) for i in (ACCEL, GYRO))
        S = [self.at(n) for n in SUMS]
        body: list[Stmt] = []
        a = self._lets(body, [mul(c, Ref("dt")) for c in w], "a")
        d = self._lets(body, [mul(c, Ref("dt")) for c in f], "d")
        # S turns by -a, the new part by half of it: it belongs to the middle of the step.
        turn = self._cross(body, a, list(S), "t")
        twice = self._cross(body, a, turn, "t")
        half = self._cross(body, a, d, "t")
        for i, s in enumerate(S):
            grown = add(sub(add(s, mul(Num(0.5), twice[i])), turn[i]), sub(d[i], mul(Num(0.5), half[i])))
            body.append(Store(s, grown))
        body.append(Store(self.at("MOVING_TIME"), add(self.at("MOVING_TIME"), Ref("dt"))))
        looked = [c for g in (accel, gyro) for c in within(g, self.program.input_limit(g.name))]
        lost = (StatusFlag("BAD_INPUT"), Store(self.at("MOVING"), Num(0.0)))
        good = (When(every(looked), (*body, StatusFlag("ALIGNING")), lost),)
        step = possible_step(self.program.discrete.max_step)
        whole = (When(step, good, (StatusFlag("BAD_STEP"),)),)
        return Routine("align_gather", GATHER_TEXT, (accel, gyro, Argument("dt", 0, "step [s]")), tidy(whole))

    @property
    def _north(self) -> Argument:
        north = self.alignment.north
        if north is None:
            return Argument(HEADING, 0, "heading of the body's forward axis from north [rad]")
        return self._triad(north.name, f"{north.title} [{north.unit}], body axes, now")

    def _moving(self) -> Routine:
        time, setting = self.at("MOVING_TIME"), self.program.setting
        begun = Compare(">", self.at("MOVING"), Num(0.0))
        longest = mul(Num(LONGEST), setting("ALIGN_TIME"))
        late = When(Compare(">", time, longest), tuple(self._begin()), tuple(self._solved()))
        enough = When(Compare(">=", time, setting("ALIGN_TIME")), (late,))
        start = (Store(self.at("ALIGNING"), Num(1.0)), Store(Ref("known", 0), Num(0.0)))
        waiting = When(Compare("<=", Ref("known", 0), Num(0.0)), (StatusFlag("ALIGNING"),))
        body = (*start, When(begun, (enough,), tuple(self._begin())), waiting)
        looked = [c for a in (self.velocity, self._north) for c in within(a, self._most(a))]
        allowed = When(every(looked), body, (StatusFlag("BAD_INPUT"),))
        scratch = (
            Scratch(GAIN, self.program.n),
            *(Scratch(n, size) for n, size in ((SPREAD, 1), (TILTED, 1), ("known", 1), ("ahead", 3))),
        )
        return Routine("align_moving", MOVING_TEXT, (self.velocity, self._north), tidy((allowed,)), scratch)

    def _most(self, a: Argument) -> Num:
        return Num(1e4) if a.name == self.velocity.name else self._limit(a)

    def _course(self) -> Routine:
        v_N, v_E = Ref("v", 0), Ref("v", 1)
        least = self.program.setting("ALIGN_MIN_SPEED")
        speed = Let("speed", add(mul(v_N, v_N), mul(v_E, v_E)))
        north, east = sp.symbols("v_N v_E", real=True)
        self.lower.places |= {"v_N": v_N, "v_E": v_E}
        (psi,), body = self.lower.many([sp.atan2(east, north)])
        given = (*body, FunctionCall("align_moving", (Ref("v"), psi), True))
        slow = (*self._again("TOO_SLOW"), Store(self.at("ALIGNING"), Num(1.0)), StatusFlag("ALIGNING"))
        fast = When(Compare(">=", Ref(speed.name), mul(least, least)), given, slow)
        allowed = When(every(within(self.velocity, Num(1e4))), (speed, fast), (StatusFlag("BAD_INPUT"),))
        return Routine("align_course", COURSE_TEXT, (self.velocity,), tidy((allowed,)))

    def _begin(self) -> list[Stmt]:
        return [
            Store(self.at("MOVING"), Num(1.0)),
            Store(self.at("MOVING_TIME"), Num(0.0)),
            *(Store(self.at(n), Num(0.0)) for n in SUMS),
            *(Store(self.at(n), Ref("v", i)) for i, n in enumerate(FIRST)),
        ]

    def _again(self, reason: str) -> list[Stmt]:
        return [Store(self.at("ALIGN_REASON"), Num(float(REASONS.index(reason)))), *self._begin()]

    def _solved(self) -> list[Stmt]:
        """The attitude, where force, size and direction allow."""
        body: list[Stmt] = []
        time, g = self.at("MOVING_TIME"), self.lower.places.get(GRAVITY.name, Num(STANDARD_GRAVITY))
        change = [sub(Ref("v", i), self.at(n)) for i, n in enumerate(FIRST)]
        change[2] = sub(change[2], mul(g, time))
        F = self._lets(body, change, "force")
        f, s = self._unit(body, F, "f"), self._unit(body, [self.at(n) for n in SUMS], "s")
        size = self._let(body, Una("sqrt", sum_of_squares(F)), "size")
        own = self._let(body, Una("sqrt", sum_of_squares([self.at(n) for n in SUMS])), "size")
        most = mul(self.program.setting("ALIGN_MAX_FORCE"), time)
        low, high = Compare(">=", add(own, most), size), Compare("<=", own, add(size, most))
        steep = When(
            Compare("<=", f[2], Num(-self._least_up)),
            tuple(self._turned(f, s)),
            tuple(self._again("TURNING")),
        )
        return [*body, When(All((low, high)), (steep,), tuple(self._again("NOT_GRAVITY")))]

    @property
    def _least_up(self) -> float:
        return LEAST_UP_OF_FIELD if self.alignment.north else LEAST_UP

    def _direction(self, s: Triad) -> list[Stmt]:
        """The direction of the body whose heading is known, of unit length, into the scratch."""
        target = [Ref("ahead", i) for i in range(3)]
        north = self.alignment.north
        if north is None:
            forward, below = ([Store(a, Num(float(i == k))) for i, a in enumerate(target)] for k in (0, 2))
            return [When(Compare("<", mul(s[0], s[0]), Num(MAX_NOSE**2)), tuple(forward), tuple(below))]
        own, body = self.lower.many(self.alignment.offset)
        fields = [sub(m, o) for m, o in zip(self.quiet.sample(north.name), own)]
        unit = self._unit(body, fields, "m")
        return [*body, *(Store(a, c) for a, c in zip(target, unit))]

    def _heading(self, body: list[Stmt]) -> tuple[Expr, Expr]:
        """Cosine and sine of the heading of that direction."""
        if self.alignment.north is None:
            psi = sp.Symbol(HEADING, real=True)
            self.lower.places[HEADING] = Ref(HEADING)
            wanted: Sequence[sp.Expr] = [sp.cos(psi), sp.sin(psi)]
        else:
            wanted = list(self.alignment.field)[:2]
        values, made = self.lower.many(wanted)
        body += made
        pair = self._lets(body, values, "n")
        square = self._let(body, sum_of_squares(pair), "headingsquare")
        over = self._let(body, Bin("/", Num(1.0), Una("sqrt", square)), "n")
        cosine, sine = self._lets(body, [mul(c, over) for c in pair], "n")
        return cosine, sine

    def _dot(self, body: list[Stmt], a: Triad, b: Triad) -> Expr:
        return self._let(body, add(add(mul(a[0], b[0]), mul(a[1], b[1])), mul(a[2], b[2])), "dot")

    def _turned(self, f: Triad, s: Triad) -> list[Stmt]:
        body = self._direction(s)
        d: Triad = [Ref("ahead", i) for i in range(3)]
        c = self._dot(body, s, d)
        flat = self._let(body, sub(Num(1.0), mul(c, c)), "flat")
        enough = Compare(">=", flat, Num(LEAST_SIDE**2))
        inner: list[Stmt] = []
        side = self._let(inner, Una("sqrt", flat), "side")
        cosine, sine = self._heading(inner)
        p: Triad = [neg(sine), cosine, Num(0.0)]
        off = self._let(inner, sub(mul(f[1], cosine), mul(f[0], sine)), "off")
        q = self._let(inner, Una("sqrt", sub(Num(1.0), mul(off, off))), "q")
        w = self._lets(inner, [Bin("/", sub(a, mul(off, b)), q) for a, b in zip(p, f)], "w")
        u = self._cross(inner, f, w, "u")
        sin_a = self._let(inner, neg(Bin("/", mul(c, off), mul(q, side))), "a")
        rest = self._let(inner, sub(Num(1.0), mul(sin_a, sin_a)), "a")
        solved: list[Stmt] = []
        cos_a = self._let(solved, Una("sqrt", rest), "a")
        n2 = self._lets(solved, [add(mul(cos_a, a), mul(sin_a, b)) for a, b in zip(u, w)], "n")
        b2 = self._lets(solved, [Bin("/", sub(a, mul(c, b)), side) for a, b in zip(d, s)], "b")
        n3, b3 = self._cross(solved, f, n2, "n"), self._cross(solved, s, b2, "b")
        rows = [
            [
                self._let(solved, add(add(mul(f[i], s[j]), mul(n2[i], b2[j])), mul(n3[i], b3[j])), "r")
                for j in range(3)
            ]
            for i in range(3)
        ]
        solved += [*self._quaternion(rows), *self._spread(c, flat, rows)]
        solved += [*(() if self.matrix else self.covariance()), *self._done()]
        steep = When(Compare(">=", rest, Num(LEAST_ALONG)), tuple(solved), tuple(self._again("TURNING")))
        return [*body, When(enough, (*inner, steep), tuple(self._again("NO_HORIZONTAL_FIELD")))]

    def _spread(self, c: Expr, flat: Expr, R: list[Triad]) -> list[Stmt]:
        """Variance of the tilt, and of the heading beyond it; the vertical in the axes of the error."""
        setting, time = self.program.setting, self.at("MOVING_TIME")
        body: list[Stmt] = []
        change = Bin("/", setting("ALIGN_VELOCITY"), mul(Num(STANDARD_GRAVITY), time))
        drift = mul(setting("ALIGN_DRIFT"), mul(Num(0.5), time))
        parts = [self._let(body, e, "sd") for e in (setting("ALIGN_TILT"), change, drift)]
        tilt = self._let(body, sum_of_squares(parts), "tilt")
        # Of a tilt e the heading turns by e tan(elevation) / cos(a), and by e tan(bank) as the turn is not about the vertical.
        steep = add(Bin("/", mul(c, c), mul(Num(LEAST_ALONG), flat)), Num(1.0 / self._least_up**2 - 1.0))
        heading = add(mul(setting("ALIGN_HEADING"), setting("ALIGN_HEADING")), mul(tilt, steep))
        body += [Store(Ref(TILTED, 0), tilt), Store(Ref(SPREAD, 0), sub(heading, tilt))]
        attitude = self.program.discrete.model.attitude
        assert attitude is not None
        axis = R[2] if attitude.convention.side.body else [Num(0.0), Num(0.0), Num(1.0)]
        return [*body, *(Store(Ref(GAIN, i), a) for i, a in zip(self.errors, axis))]

    def _done(self) -> list[Stmt]:
        names = self.program.discrete.nominal_names
        fixed = [Store(Ref("x", names.index(f"v_{a}")), Ref("v", i)) for i, a in enumerate("NED")]
        over = [Store(self.at(n), Num(0.0)) for n in ("MOVING", "ALIGNING", "ALIGN_REASON")]
        return [*fixed, *over, Store(Ref("known", 0), Num(1.0))]


def moving(program: Program) -> tuple[Routine, ...]:
    """The routines; none where the filter cannot be aligned in motion."""
    return MovingAlign(program).routines() if alignable(program.discrete.model) else ()
