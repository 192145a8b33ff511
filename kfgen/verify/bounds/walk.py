"""A walk of a routine with intervals: what an operation may do that no number survives, and the longest way through it.

Both sides of a branch are walked unless the intervals decide it, each knowing what its condition says; after it a
number is one or the other. Loops run over whole numbers that are known, so they are walked turn by turn.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

from kfgen.emit.covariance.packed import place
from kfgen.emit.ir.ir import (
    Bin,
    Cell,
    Compare,
    Condition,
    Cursor,
    Expr,
    For,
    FunctionCall,
    Let,
    Num,
    Ref,
    Routine,
    Stmt,
    Store,
    Una,
    When,
    comparisons,
    turns,
)
from kfgen.verify.bounds.interval import RAW, Arithmetic, KnownNumber, hull, value

Array = list[KnownNumber]
Scope = dict[str, KnownNumber | Array]


@dataclass(frozen=True)
class Open:
    """An operation that the intervals do not show to be sound: in which routine, for what, and what it may do."""

    routine: str
    target: str
    what: str

    @property
    def sentence(self) -> str:
        """In words."""
        return f"{self.routine}: {self.target} {self.what}"


@dataclass
class Assumed:
    """What is taken for granted while a routine is walked.

    Parameters
    ----------
    elements : dict of str to list of KnownNumber
        Ranges of the elements of an array, whenever one is stored.
    local : callable
        The range of a local that is made, given what is known of it and the walk; None: nothing is assumed of it.
    stored : callable
        The same of what a statement stores at a place.
    """

    elements: Mapping[str, Sequence[KnownNumber]]
    local: Callable[[Let, KnownNumber, Walk], tuple[float, float] | None]
    stored: Callable[[Store, int, Walk], tuple[float, float] | None] = lambda store, place, walk: None


@dataclass
class Walk:
    """The walk of one routine and of those that it calls.

    Parameters
    ----------
    real : str
    n : int
        States: rows of the packed triangle.
    routines : mapping of str to Routine
        Those that may be called.
    assumed : Assumed
    """

    real: str
    n: int
    routines: Mapping[str, Routine]
    assumed: Assumed
    memory: Scope = field(default_factory=dict)
    names: Scope = field(default_factory=dict)
    whole: dict[str, int | range] = field(default_factory=dict)
    open: dict[Open, None] = field(default_factory=dict)
    branches: dict[str, None] = field(default_factory=dict)
    checked: int = 0

    def __post_init__(self) -> None:
        self.arithmetic = Arithmetic(self.real)
        self._routine, self._target, self._guard = "", "", False
        self._rows = [place(self.n, i, 0) for i in range(self.n)]
        self.returned: dict[str, Array] = {}

    def run(self, routine: Routine, arguments: Mapping[str, KnownNumber | Array]) -> int:
        """Walk a routine; returns the operations of the longest way through it.

        Parameters
        ----------
        routine : Routine
        arguments : mapping of str to KnownNumber or list of KnownNumber
        """
        outer = (self.names, self.whole, self._routine)
        self.names = {**arguments, **{s.name: [value(0.0, 0.0)] * s.size for s in routine.scratch}}
        self.whole, self._routine = {}, routine.name
        count = self._body(routine.body)
        self.returned = {a.name: v for a in routine.arguments if isinstance(v := self.names[a.name], list)}
        self.names, self.whole, self._routine = outer
        return count

    def _body(self, body: Sequence[Stmt]) -> int:
        return sum(map(self._statement, body))

    def _statement(self, s: Stmt) -> int:
        before = self.checked
        if isinstance(s, Let):
            self._target = s.name
            known = self.expression(s.value)
            bounds = self.assumed.local(s, known, self)
            self.names[s.name] = known if bounds is None or known.raw else known.within(*bounds)
        elif isinstance(s, Store):
            self._store(s)
        elif isinstance(s, Cursor):
            self._target = s.name
            self._cursor(s)
        elif isinstance(s, When):
            return self._when(s)
        elif isinstance(s, For):
            return self._loop(s)
        elif isinstance(s, FunctionCall):
            return self._call(s)
        return self.checked - before

    def _cursor(self, s: Cursor) -> None:
        v = self.expression(s.value)
        lo, hi = (math.floor(v.lo), math.ceil(v.hi)) if math.isfinite(v.lo + v.hi) else (0, 0)
        self.whole[s.name] = lo if lo == hi else range(lo, hi + 1)

    def _store(self, s: Store) -> None:
        self._target = s.target.name if s.target.index is None else f"{s.target.name}[{_text(s.target)}]"
        new = self.expression(s.value)
        array, places = self.array(s.target.name), self._places(s.target)
        for k in places:
            ranges = self.assumed.elements.get(s.target.name)
            bounds = (ranges[k].lo, ranges[k].hi) if ranges else self.assumed.stored(s, k, self)
            kept = new if bounds is None or new.raw else new.within(*bounds)
            array[k] = kept if len(places) == 1 else hull(array[k], kept)

    def array(self, name: str) -> Array:
        """What is known of the elements of an array."""
        found = self.names.get(name, self.memory.get(name))
        assert isinstance(found, list), name
        return found

    def _places(self, ref: Ref) -> list[int]:
        """Elements that an index may mean."""
        index = ref.index
        if isinstance(index, tuple):
            (i, *more_i), (j, *more_j) = (self._whole(k) for k in index)
            assert not more_i
            assert not more_j
            return [self._rows[i] + j]
        if isinstance(index, Cell):
            rows, columns = self._whole(index.row), self._whole(index.column)
            size = len(self.array(ref.name))
            return [k for r in rows for c in columns if 0 <= (k := r * index.width + c) < size]
        assert index is not None
        return [k for k in self._whole(index) if 0 <= k < len(self.array(ref.name))]

    def _whole(self, k: int | str) -> list[int]:
        if isinstance(k, int):
            return [k]
        known = self.whole[k]
        return [known] if isinstance(known, int) else list(known)

    def _loop(self, s: For) -> int:
        known = {k: v for k, v in self.whole.items() if isinstance(v, int)}
        total = 0
        for k in turns(s, known):
            self.whole[s.var] = k
            total += self._body(s.body)
        return total

    def _call(self, s: FunctionCall) -> int:
        routine, before = self.routines[s.routine], self.checked
        self._target = f"call of {s.routine}"
        given: dict[str, KnownNumber | Array] = {}
        for a, e in zip(routine.arguments, s.arguments, strict=True):
            if a.size and isinstance(e, Ref):
                given[a.name] = self.array(e.name)
            else:
                given[a.name] = self.expression(e)
        own = self.checked - before
        count = self.run(routine, given)
        for a, e in zip(routine.arguments, s.arguments, strict=True):
            if a.size and isinstance(e, Ref):
                self.array(e.name)[:] = self.returned[a.name]
        return own + count

    def _when(self, s: When) -> int:
        before = self.checked
        kept = self._copied()
        certain, narrowed = self._condition(s.condition)
        own = self.checked - before
        if certain is not None:
            self._restore(narrowed)
            return own + self._body(s.body if certain else s.orelse)
        self.branches |= dict.fromkeys(_compared(s.condition))
        self._restore(narrowed)
        first = self._body(s.body)
        after = (self.memory, self.names)
        self._restore(kept)
        second = self._body(s.orelse)
        self.memory = _joined(after[0], self.memory)
        self.names = _joined(after[1], self.names)
        return own + max(first, second)

    def _copied(self) -> tuple[Scope, Scope]:
        return _copy(self.memory), _copy(self.names)

    def _restore(self, scopes: tuple[Scope, Scope]) -> None:
        self.memory, self.names = scopes

    def _condition(self, condition: Condition) -> tuple[bool | None, tuple[Scope, Scope]]:
        """Whether it holds, None where either may be, and what is known of numbers where it does."""
        before = self._copied()
        sure = True
        for c in comparisons(condition):
            self._guard = True
            a, b = self.expression(c.a), self.expression(c.b)
            self._guard = False
            verdict = None if a.raw or b.raw else _decided(c.op, a, b)
            if verdict is False:
                self._restore(before)
                return False, before
            sure = sure and verdict is True
            self._narrow(c, a, b)
        narrowed = self._copied()
        self._restore(before)
        return (True if sure else None), narrowed

    def _narrow(self, c: Compare, a: KnownNumber, b: KnownNumber) -> None:
        """What a comparison that holds says of the numbers on its sides."""
        tiny = self.arithmetic.smallest
        for e, other, upper, strict in (
            (c.a, b, c.op in ("<", "<="), c.op in ("<", ">")),
            (c.b, a, c.op in (">", ">="), c.op in ("<", ">")),
        ):
            edge = tiny if strict and (other.hi if upper else other.lo) == 0.0 else 0.0
            lo, hi = (-math.inf, other.hi - edge) if upper else (other.lo + edge, math.inf)
            if isinstance(e, Ref) and not other.raw:
                self._known(e, lo, hi)
            elif upper and isinstance(e, Bin) and e.op == "*" and e.a == e.b and isinstance(e.a, Ref):
                root = math.sqrt(max(other.hi, 0.0)) * (1.0 + self.arithmetic.relative)
                self._known(e.a, -root, root)

    def _known(self, ref: Ref, lo: float, hi: float) -> None:
        """Of a raw number that was compared on one side only, the other side stays open."""
        if ref.index is None:
            old = self.names[ref.name]
            assert isinstance(old, KnownNumber)
            self.names[ref.name] = _narrowed(old, lo, hi)
            return
        places = self._places(ref)
        if len(places) == 1:
            array = self.array(ref.name)
            array[places[0]] = _narrowed(array[places[0]], lo, hi)

    def expression(self, e: Expr) -> KnownNumber:
        """What is known of an expression's value; each operation counts."""
        if isinstance(e, Num):
            return self.arithmetic.number(e.value)
        if isinstance(e, Ref):
            return self._read(e)
        if isinstance(e, Bin):
            a, b = self.expression(e.a), self.expression(e.b)
            self.checked += 1
            return self._noted(_BINARY[e.op], a, b)
        a = self.expression(e.a)
        self.checked += e.op != "neg"
        return self._noted(_UNARY[e.op], a)

    def _noted(self, operation: Callable[..., KnownNumber], *operands: KnownNumber) -> KnownNumber:
        if any(v.raw for v in operands):
            if not self._guard:
                self._say("works on what nothing has looked at")
            return RAW
        result = operation(self.arithmetic, *operands)
        for what in self.arithmetic.failed:
            self._say(what)
        self.arithmetic.failed.clear()
        return result

    def _say(self, what: str) -> None:
        self.open[Open(self._routine, re.sub(r"\d+$", "", self._target) or self._target, what)] = None

    def _read(self, ref: Ref) -> KnownNumber:
        if ref.index is None:
            known = self.names.get(ref.name)
            if isinstance(known, KnownNumber):
                return known
            counter = self.whole[ref.name]
            ends = (counter, counter) if isinstance(counter, int) else (counter.start, counter.stop - 1)
            return value(float(ends[0]), float(ends[1]))
        array, places = self.array(ref.name), self._places(ref)
        found = array[places[0]]
        for k in places[1:]:
            found = hull(found, array[k])
        return found


_BINARY = {"+": Arithmetic.add, "-": Arithmetic.sub, "*": Arithmetic.mul, "/": Arithmetic.div}
_UNARY = {
    "neg": Arithmetic.neg,
    "sqrt": Arithmetic.sqrt,
    "abs": Arithmetic.magnitude,
    "sign": Arithmetic.sign,
    "rint": Arithmetic.rint,
}


def _narrowed(old: KnownNumber, lo: float, hi: float) -> KnownNumber:
    if not old.raw:
        return old.within(lo, hi)
    if math.isfinite(lo) and math.isfinite(hi):
        return value(lo, hi)
    half = KnownNumber(max(old.lo, lo), min(old.hi, hi), raw=True)
    return half if not (math.isfinite(half.lo) and math.isfinite(half.hi)) else value(half.lo, half.hi)


def _decided(op: str, a: KnownNumber, b: KnownNumber) -> bool | None:
    """Whether a comparison holds for all numbers of both, or for none."""
    if op in (">", ">="):
        return _decided("<" if op == ">" else "<=", b, a)
    if op == "<":
        return True if a.hi < b.lo else False if a.lo >= b.hi else None
    return True if a.hi <= b.lo else False if a.lo > b.hi else None


def _copy(scope: Scope) -> Scope:
    return {k: list(v) if isinstance(v, list) else v for k, v in scope.items()}


def _joined(a: Scope, b: Scope) -> Scope:
    """What is there on both sides."""
    out: Scope = {}
    for k in a.keys() & b.keys():
        p, q = a[k], b[k]
        if isinstance(p, list) and isinstance(q, list):
            out[k] = [hull(x, y) for x, y in zip(p, q, strict=True)]
        elif isinstance(p, KnownNumber) and isinstance(q, KnownNumber):
            out[k] = hull(p, q)
    return out


def _text(ref: Ref) -> str:
    index = ref.index
    if isinstance(index, Cell):
        return f"{index.row}, {index.column}"
    return ", ".join(map(str, index)) if isinstance(index, tuple) else str(index)


def _compared(condition: Condition) -> list[str]:
    """What a condition looks at."""
    return [f"{name}" for c in comparisons(condition) for e in (c.a, c.b) for name in _read_of(e)]


def _read_of(e: Expr) -> list[str]:
    if isinstance(e, Ref):
        return [e.name if e.index is None or not isinstance(e.index, int) else f"{e.name}[{e.index}]"]
    if isinstance(e, Bin):
        return _read_of(e.a) + _read_of(e.b)
    return _read_of(e.a) if isinstance(e, Una) else []
