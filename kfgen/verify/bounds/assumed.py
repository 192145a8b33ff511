"""What bounds rest on: the ranges within which a call finds the filter, each with a name, and what theory adds to them.

An interval cannot know that a covariance stays bounded, nor that it is positive semidefinite. Both are assumed within
bounds that are wide beside any flight, and hostile calls show how much of them is used
(`kfgen.verify.bounds.hostile`). Everything that comes from outside is any bit pattern: the guards of the code bound it.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import dataclass

from kfgen.emit.check import MAX_NORM_ERROR, MAX_WIDENED, MAX_WIDENED_ATTITUDE, widened_at_most, widest
from kfgen.emit.covariance.packed import place
from kfgen.emit.covariance.state_range import StateRange
from kfgen.emit.ir.ir import Bin, Expr, Let, Num, Ref, Routine, Store, Una
from kfgen.emit.routines import Program
from kfgen.emit.settings import MAX_BY_UNIT
from kfgen.emit.watch.supervisor import ARRAY as SUPERVISOR
from kfgen.verify.bounds.interval import RAW, Arithmetic, KnownNumber, value
from kfgen.verify.bounds.walk import Array, Assumed, Scope, Walk

OF_WIDENED = 3.0
"""Times that what rejected samples may widen a state to: with what was there before."""
LEAST_SIGMAS = 1e-6
"""Prior standard deviations down to which D may say that it is known."""
FACTOR = 1e3
"""Prior standard deviations of one state that follow from one of another, for elements of U and of its inverse."""
STATE_SIGMAS = 1e3
"""Prior standard deviations up to which a state that has no range of its own may be off its start."""
OF_UNIT = {u: 4.0 * MAX_BY_UNIT[u] for u in ("m", "m/s", "T")}
"""Ranges of positions, velocities and fields [SI]: four times those of their sensors."""
CONSTANT_SHARE, CONSTANT_AT_ZERO = 0.25, 100.0
"""How far a constant may be set from its default: a share of it, or that much [SI] where it is zero."""
MAX_GATE = 1e2
"""Largest gate, in standard deviations."""
VARIANCE_SHARE = 1e2
"""By which factor a call's variances may differ from those of the settings."""
LEAST_OF_R = 0.5
"""Share of R that the variance of an innovation is at least."""
LEAST_SQUARE = 0.25
"""Least squared length of a quaternion before it is scaled to one."""
MAX_TIME_S = 1e7
"""A filter is started again within so long [s]: 115 days."""
NOT_NEGATIVE = ("ALIGN_COUNT", "ALIGN_GATHERED", "REST_COUNT", "REST_GATHERED", "REST_WAITED", "AT_REST")
"""Times and counts among the numbers of alignment and rest."""
LEAST_TRACE = 0.5
"""The largest of four that add up to four, reached where no other is one."""
MAX_BANKED = 0.7
"""Largest horizontal part of a vertical that is banked by the 37 degrees that are allowed: their sine, and more."""
LEAST_DIRECTION = 1e-12
"""Least squared length of a vector that gives a direction [SI]."""
MAX_MEMORY = 1e9
"""Other numbers that the filter keeps [SI]."""


@dataclass(frozen=True)
class Assumption:
    """A range that is assumed, by name, and what keeps it."""

    name: str
    bound: str
    kept: str


ASSUMPTIONS = (
    Assumption(
        "state",
        f"position {OF_UNIT['m']:g} m, velocity {OF_UNIT['m/s']:g} m/s, field {OF_UNIT['T']:g} T, others "
        f"{STATE_SIGMAS:g} priors off their start",
        "check looks at the quaternion's length, every call at the sum of all",
    ),
    Assumption(
        "covariance",
        f"standard deviations below {OF_WIDENED:g} times {MAX_WIDENED_ATTITUDE:g} rad of attitude, the range of position and "
        f"velocity, {MAX_WIDENED:g} priors of others: no rejected sample widens beyond; elements of U and of its inverse below {FACTOR:g} ratios of "
        f"priors, D above the square of {LEAST_SIGMAS:g} priors",
        "hostile calls show the share that is used",
    ),
    Assumption(
        "semidefinite",
        f"variance of an innovation at least {LEAST_OF_R:g} R, its rows correlated by one at most",
        "theory; with ud the first is proven",
    ),
    Assumption(
        "correction",
        "of an accepted sample at most gate times standard deviation a row",
        "theory: (K y)^2 <= P y^2 / S",
    ),
    Assumption(
        "quaternion",
        f"squared length at least {LEAST_SQUARE:g} before it is scaled",
        "theory: a turn leaves it, a correction makes it longer",
    ),
    Assumption(
        "settings",
        f"defaults of this folder; constants within {100 * CONSTANT_SHARE:g} % or {CONSTANT_AT_ZERO:g} of zero, gates "
        f"to {MAX_GATE:g}; R of a call within {VARIANCE_SHARE:g} times its default",
        "the firmware",
    ),
    Assumption(
        "alignment",
        f"vectors that give a direction are longer than {LEAST_DIRECTION**0.5:g}, sums below {MAX_MEMORY:g}",
        "samples that are shaken, or without gravity, or with a field along it, are thrown away",
    ),
    Assumption("time", f"started again within {MAX_TIME_S:g} s", "the firmware"),
)


class FilterRanges:
    """The ranges of a program's memory, and what is assumed on the way.

    Parameters
    ----------
    program : Program
    """

    def __init__(self, program: Program) -> None:
        self.program = program
        self.arithmetic = Arithmetic(program.real)
        self._direction = 0.0
        self._reach: dict[str, float] = {}
        self._first: dict[str, tuple[int, float]] = {}
        self.states = [
            StateRange(LEAST_SIGMAS * w.value, w.value, OF_WIDENED * most)
            for w, most in zip(widest(program), widened_at_most(program), strict=True)
        ]

    @property
    def assumed(self) -> Assumed:
        """For a walk: what is stored stays within its range."""
        stored = {
            "x": self._state(),
            self.program.covariance.ARRAY: self._covariance(),
            SUPERVISOR: self._supervisor(),
            "dx": self._corrections(),
        }
        return Assumed(stored, self._local, self._stored)

    def memory(self) -> Scope:
        """What a call finds."""
        program = self.program
        states = float(len(program.slow))
        waited = value(0.0, program.noise_waits + (states + 1.0) * program.discrete.max_step)
        known: dict[str, Callable[[], Array]] = {
            "x": self._state,
            program.covariance.ARRAY: self._covariance,
            SUPERVISOR: self._supervisor,
            "k": self._constants,
            "held": lambda: [value(0.0, 1.0)] * program.n,
            "any_held": lambda: [value(0.0, float(program.n))],
            "waiting": lambda: [waited, waited, value(0.0, states)],
        }
        rest = value(-MAX_MEMORY, MAX_MEMORY)
        return {a: known.get(a, lambda n=size: [rest] * n)() for a, (size, _) in program.arrays.items()}

    def arguments(self, routine: Routine) -> dict[str, KnownNumber | Array]:
        """Any bit pattern, but for variances."""
        out: dict[str, KnownNumber | Array] = {}
        for a in routine.arguments:
            if a.default:
                out[a.name] = [self._variance(e) for e in a.default]
            else:
                out[a.name] = [RAW] * a.size if a.size else RAW
        return out

    def _variance(self, default: Expr) -> KnownNumber:
        walk = Walk(self.program.real, 1, {}, Assumed({}, lambda let, known, walk: None))
        usual = walk.expression(default)
        return value(usual.lo / VARIANCE_SHARE, usual.hi * VARIANCE_SHARE)

    def _state(self) -> Array:
        discrete = self.program.discrete
        units = {s.name: (s.unit, s.prior) for s in discrete.model.states}
        attitude = discrete.model.attitude
        quaternion = attitude.nominal_names if attitude else ()
        found = []
        for name, start in zip(discrete.nominal_names, discrete.start, strict=True):
            unit, prior = units.get(name, ("", 1.0))
            most = 1.0 + MAX_NORM_ERROR
            if name not in quaternion:
                most = OF_UNIT.get(unit, abs(start) + STATE_SIGMAS * prior)
            found.append(value(-most, most))
        return found

    def _covariance(self) -> Array:
        form = self.program.covariance
        states = [self.states[s] for s in form.order]
        found: dict[int, KnownNumber] = {}
        for i in range(form.n):
            for j in range(i, form.n):
                lo, hi = form.stored_range(states[i], states[j] if i != j else None, FACTOR)
                found[place(form.n, i, j)] = value(lo, hi)
        return [found[k] for k in range(form.size)]

    def _supervisor(self) -> Array:
        program = self.program
        limits = {f"LAST_{t.upper()}": program.input_limit(t).value for t in program.supervisor.triads}
        found = []
        for name, _ in program.supervisor.places:
            last = limits.get(name.rsplit("_", 1)[0])
            if last is not None:
                found.append(value(-last, last))
            elif name.startswith(("AGE", "SINCE", "MISSED", "STUCK", "REJECTED", "RESET", *NOT_NEGATIVE)):
                found.append(value(0.0, MAX_TIME_S))
            else:
                found.append(value(-MAX_MEMORY, MAX_MEMORY))
        return found

    def _constants(self) -> Array:
        found = []
        for c in self.program.constants:
            ends = (c.value * (1.0 - CONSTANT_SHARE), c.value * (1.0 + CONSTANT_SHARE))
            most = min(CONSTANT_AT_ZERO, MAX_BY_UNIT.get(c.unit, CONSTANT_AT_ZERO))
            if c.name.startswith("gate_"):
                ends = (0.0, MAX_GATE)
            found.append(value(min(ends), max(ends)) if c.value else value(-most, most))
        return found

    def _corrections(self) -> Array:
        most = [self.program.rows * MAX_GATE * s.most for s in self.states]
        return [value(-m, m) for m in most]

    def _local(self, let: Let, known: KnownNumber, walk: Walk) -> tuple[float, float] | None:
        """What is assumed of a local, by its name."""
        name = let.name
        row = re.fullmatch(r"(f|Sj?)_j?(\d+)_(\d+)", name)
        if row and self.program.form == "ud":
            return self._of_row(row[2], int(row[3]), let.value if row[1] == "f" else known, walk)
        if name == "q_square":
            return LEAST_SQUARE, math.inf
        if re.fullmatch(r"a[a-z]+square\d+", name):
            return LEAST_DIRECTION, math.inf
        if name == "trace_3":
            return LEAST_TRACE, math.inf
        if re.fullmatch(r"aoff\d+", name):
            return -MAX_BANKED, MAX_BANKED
        pivot = re.fullmatch(r"(?:pivot|S)_(\d+)|S_(\d+)_\2", name)
        if pivot:
            return LEAST_OF_R * self._noise(int(pivot[1] or pivot[2]), walk), math.inf
        gain = re.fullmatch(r"K_(\d+)_(\d+)", name)
        if gain:
            state = self.program.covariance.order[int(gain[2])]
            most = self.states[state].most / math.sqrt(LEAST_OF_R * self._noise(int(gain[1]), walk))
            return -most, most
        spread = re.fullmatch(r"spread_(\d+)", name)
        if spread:
            limit, along = (walk.names[f"{n}_{spread[1]}"] for n in ("limit", "along"))
            assert isinstance(limit, KnownNumber)
            assert isinstance(along, KnownNumber)
            return 0.0, limit.hi / along.hi / along.lo if along.lo > 0.0 else math.inf
        factor = re.fullmatch(r"factor_(\d+)_(\d+)", name)
        if factor:
            i, j = map(int, factor.groups())
            most = math.sqrt(self._innovation(i, walk) / (LEAST_OF_R * self._noise(j, walk)))
            return -most, most
        shared = re.fullmatch(r"shared_(\d+)_(\d+)", name)
        if shared:
            most = math.sqrt(self._innovation(int(shared[1]), walk) * self._innovation(int(shared[2]), walk))
            return -most, most
        white = re.fullmatch(r"white_(\d+)", name)
        if white:
            most = math.sqrt(self._innovation(int(white[1]), walk) * self._squared(walk))
            return -most, most
        direction = re.fullmatch(r"a_(\d+)_(\d+)_(\d+)", name)
        if direction and self.program.form == "ud":
            top, _, i = map(int, direction.groups())
            sd = [self.states[s].prior for s in self.program.covariance.order]
            most = FACTOR * sd[i] / sd[top]
            return -most, most
        return None

    def _stored(self, store: Store, k: int, walk: Walk) -> tuple[float, float] | None:
        """What is assumed of a direction in the coordinates of U, once elements of U have gone into it."""
        if store.target.name == "K_":
            s = walk.names["s"]
            assert isinstance(s, KnownNumber)
            most = self.states[k].most * math.sqrt(s.hi)
            return -most, most
        if store.target.name != "a_":
            return None
        sd = [self.states[s].prior for s in self.program.covariance.order]
        if isinstance(store.value, Bin) and store.value.op == "-":
            most = FACTOR * sd[k] * self._direction
            return -most, most
        given = walk.expression(store.value)
        self._direction = max(self._direction if k else 0.0, given.most / sd[k])
        return None

    def _of_row(self, row: str, j: int, what: Expr | KnownNumber, walk: Walk) -> tuple[float, float] | None:
        """The variance of an innovation as far as its column j: what the first column makes, and what P makes at most."""
        if not isinstance(what, KnownNumber):
            self._reach[row] = max(self._reach.get(row, 0.0), self._reached(what, j, walk))
            return None
        first = self._first.setdefault(row, (j, what.hi))
        if j <= first[0]:
            self._first[row] = (j, max(first[1], what.hi))
            return None
        return -math.inf, (math.sqrt(self._first[row][1]) + self._reach.get(row, math.inf)) ** 2

    def _reached(self, f: Expr, j: int, walk: Walk) -> float:
        """``sum |h_k| sd_k`` over the terms ``h_k U_kj`` of a sum: that squared is the most that P makes of a row."""
        if isinstance(f, Bin) and f.op in "+-":
            return self._reached(f.a, j, walk) + self._reached(f.b, j, walk)
        if isinstance(f, Una):
            return self._reached(f.a, j, walk)
        h: Expr = f
        k = j
        for one, other in ((f.a, f.b), (f.b, f.a)) if isinstance(f, Bin) else ((f, Num(1.0)),):
            if isinstance(one, Ref) and isinstance(one.index, tuple) and isinstance(one.index[0], int):
                h, k = other, one.index[0]
        return walk.expression(h).most * self.states[self.program.covariance.order[k]].most

    def _noise(self, row: int, walk: Walk) -> float:
        R = walk.names.get("R")
        return R[row].lo if isinstance(R, list) else 0.0

    def _squared(self, walk: Walk) -> float:
        """Largest squared innovation over R of all rows together."""
        R, z = walk.names["R"], walk.names["z"]
        assert isinstance(R, list)
        assert isinstance(z, list)
        y = [v.most for n, v in walk.names.items() if re.fullmatch(r"r\d+", n) and isinstance(v, KnownNumber)]
        most = max(y, default=2.0 * max(v.most for v in z))
        return sum(most**2 / (LEAST_OF_R * v.lo) for v in R if isinstance(v, KnownNumber))

    def _innovation(self, row: int, walk: Walk) -> float:
        last = self.program.n - 1
        for name in (f"S_{row}_{row}", f"Sj_{row}_{last}", f"pivot_{row}"):
            found = walk.names.get(name)
            if isinstance(found, KnownNumber):
                return found.hi
        return math.inf
