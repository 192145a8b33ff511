"""The intermediate form: straight-line scalar code that every target prints alike.

Every operation has two operands and its own parentheses, so that C, the float32 reference and
Python round in the same order. A routine works on named arrays (state, covariance, constants,
arguments) and on local scalars, each assigned once. Loops run over whole numbers; an index is a number,
a loop's variable, a pair (i, j) with i <= j: the element of a triangle that is packed by rows, or the cell of a table.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class Num:
    """A number; one with a name is a setting of the emitted code, printed by that name."""

    value: float
    name: str = ""


Whole = int | str
"""A whole number, or a loop's variable by name."""


@dataclass(frozen=True)
class Cell:
    """A place in a table that is stored by rows: `row` and `column` are whole numbers or their names."""

    row: Whole
    width: int
    column: Whole


Index = int | str | tuple[Whole, Whole] | Cell


@dataclass(frozen=True)
class Ref:
    """A local scalar (`index` None) or an element of an array."""

    name: str
    index: Index | None = None


@dataclass(frozen=True)
class Bin:
    """``a op b`` with op one of ``+ - * /``."""

    op: str
    a: Expr
    b: Expr


@dataclass(frozen=True)
class Una:
    """``neg``, ``sqrt``, ``abs``, ``sign`` (-1, 0, 1) or ``rint`` (to the nearest whole number) of one operand."""

    op: str
    a: Expr


Expr = Num | Ref | Bin | Una


@dataclass(frozen=True)
class Let:
    """A new local scalar."""

    name: str
    value: Expr


@dataclass(frozen=True)
class Cursor:
    """A new local whole number: that of an element."""

    name: str
    value: Expr


@dataclass(frozen=True)
class Store:
    """An element of an array gets a value."""

    target: Ref
    value: Expr


@dataclass(frozen=True)
class Compare:
    """``a op b`` with op one of ``< <= > >=``."""

    op: str
    a: Expr
    b: Expr


@dataclass(frozen=True)
class All:
    """Every one of several comparisons holds; those after the first that does not are not made."""

    comparisons: tuple[Compare, ...]


Condition = Compare | All


@dataclass(frozen=True)
class When:
    """A branch."""

    condition: Condition
    body: tuple[Stmt, ...]
    orelse: tuple[Stmt, ...] = ()


@dataclass(frozen=True)
class StatusFlag:
    """The routine's status becomes one of `STATUS`, unless a graver one was met before."""

    status: str


@dataclass(frozen=True)
class Note:
    """A comment."""

    text: str


@dataclass(frozen=True)
class For:
    """A loop of `var` over whole numbers from `start + skip` to before `stop`, or from its end down."""

    var: str
    start: Whole
    stop: Whole
    body: tuple[Stmt, ...]
    down: bool = False
    skip: int = 0


@dataclass(frozen=True)
class FunctionCall:
    """A routine at work: arrays by name, scalars by value.

    An internal one has no status; that of another one is `merged` into the caller's, the graver of the two.
    """

    routine: str
    arguments: tuple[Expr, ...]
    merged: bool = False


def comparisons(condition: Condition) -> tuple[Compare, ...]:
    """The comparisons of a condition."""
    return condition.comparisons if isinstance(condition, All) else (condition,)


Stmt = Let | Cursor | Store | When | StatusFlag | Note | For | FunctionCall

STATUS = (
    "OK",
    "LIMITED",
    "GATED",
    "NOT_POSITIVE",
    "BAD_STEP",
    "BAD_INPUT",
    "NOT_FINITE",
    "DEGRADED",
    "LOST",
    "ALIGNING",
    "GATHERING",
    "OUT_OF_ORDER",
    "DOUBLED",
    "NO_ROOM",
    "TOO_OLD",
    "ORIGIN_SET",
    "RECENTRED",
    "TOO_FAR",
)
"""What a routine returns, in order of number and of gravity."""


@dataclass(frozen=True)
class Argument:
    """An argument: a scalar (`size` 0) or an array of `size` elements, with what it means.

    One with a `default`, a number for each element, may be left out of a call.
    """

    name: str
    size: int
    text: str
    default: tuple[Expr, ...] = ()


@dataclass(frozen=True)
class Scratch:
    """A local array of zeros."""

    name: str
    size: int


@dataclass(frozen=True)
class Routine:
    """A function on the filter's arrays; an internal one is called by others and has no status.

    An internal routine may write its array arguments.
    """

    name: str
    text: str
    arguments: tuple[Argument, ...]
    body: tuple[Stmt, ...]
    scratch: tuple[Scratch, ...] = ()
    internal: bool = False

    @property
    def required(self) -> tuple[Argument, ...]:
        """The arguments that no call may leave out."""
        return tuple(a for a in self.arguments if not a.default)

    @property
    def operations(self) -> int:
        """Executed ``+ - * /``, square roots and the like: all branches, loops by their turns, no calls."""
        return _counted(self.body, {})


def turns(loop: For, env: Mapping[str, int]) -> range:
    """The values of a loop's variable, given those of the loops around it.

    Parameters
    ----------
    loop : For
    env : mapping of str to int
        Values of the variables of the loops around it.
    """
    start, stop = (env[b] if isinstance(b, str) else b for b in (loop.start, loop.stop))
    start += loop.skip
    return range(stop - 1, start - 1, -1) if loop.down else range(start, stop)


def _counted(body: Sequence[Stmt], env: Mapping[str, int]) -> int:
    total = 0
    for s in body:
        if isinstance(s, Let | Store | Cursor):
            total += _count(s.value)
        elif isinstance(s, When):
            total += sum(_count(c.a) + _count(c.b) for c in comparisons(s.condition))
            total += _counted(s.body, env) + _counted(s.orelse, env)
        elif isinstance(s, FunctionCall):
            total += sum(_count(a) for a in s.arguments)
        elif isinstance(s, For):
            total += sum(_counted(s.body, {**env, s.var: k}) for k in turns(s, env))
    return total


def names_of(body: Sequence[Stmt]) -> set[str]:
    """Every name that statements read, store to or call."""
    found: set[str] = set()
    for s in body:
        if isinstance(s, Let | Store | Cursor):
            found |= _named(s.value) | (_named(s.target) if isinstance(s, Store) else {s.name})
        elif isinstance(s, When):
            found |= set().union(*(_named(c.a) | _named(c.b) for c in comparisons(s.condition)))
            found |= names_of(s.body) | names_of(s.orelse)
        elif isinstance(s, For):
            found |= names_of(s.body)
        elif isinstance(s, FunctionCall):
            found |= set().union({s.routine}, *map(_named, s.arguments))
    return found


def _named(e: Expr) -> set[str]:
    if isinstance(e, Ref):
        return {e.name}
    if isinstance(e, Bin):
        return _named(e.a) | _named(e.b)
    return _named(e.a) if isinstance(e, Una) else set()


def _count(e: Expr) -> int:
    if isinstance(e, Bin):
        return 1 + _count(e.a) + _count(e.b)
    if isinstance(e, Una):
        return (e.op != "neg") + _count(e.a)
    return 0


def add(a: Expr, b: Expr) -> Expr:
    """``a + b``, without a zero.

    Parameters
    ----------
    a : Expr
    b : Expr
    """
    if a == Num(0.0):
        return b
    if isinstance(b, Una) and b.op == "neg":
        return Bin("-", a, b.a)
    return a if b == Num(0.0) else Bin("+", a, b)


def sub(a: Expr, b: Expr) -> Expr:
    """``a - b``, without a zero.

    Parameters
    ----------
    a : Expr
    b : Expr
    """
    if isinstance(b, Una) and b.op == "neg":
        return add(a, b.a)
    if b == Num(0.0):
        return a
    return neg(b) if a == Num(0.0) else Bin("-", a, b)


def mul(a: Expr, b: Expr) -> Expr:
    """``a * b``, without ones; a sign goes outside.

    Parameters
    ----------
    a : Expr
    b : Expr
    """
    if isinstance(a, Una) and a.op == "neg":
        return neg(mul(a.a, b))
    if isinstance(b, Una) and b.op == "neg":
        return neg(mul(a, b.a))
    if Num(0.0) in (a, b):
        return Num(0.0)
    if a == Num(1.0):
        return b
    return a if b == Num(1.0) else Bin("*", a, b)


def neg(a: Expr) -> Expr:
    """``-a``."""
    if isinstance(a, Una) and a.op == "neg":
        return a.a
    return Num(-a.value) if isinstance(a, Num) and not a.name else Una("neg", a)
