"""The intermediate form: straight-line scalar code that every target prints alike.

Every operation has two operands and its own parentheses, so that C, the float32 reference and
Python round in the same order. A routine works on named arrays (state, covariance, constants,
arguments) and on local scalars, each assigned once.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass


@dataclass(frozen=True)
class Num:
    """A number."""

    value: float


@dataclass(frozen=True)
class Ref:
    """A local scalar (`index` None) or an element of an array."""

    name: str
    index: int | None = None


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
class When:
    """A branch."""

    condition: Compare
    body: tuple[Stmt, ...]
    orelse: tuple[Stmt, ...] = ()


@dataclass(frozen=True)
class Flag:
    """The routine's status becomes one of `STATUS`, unless a graver one was met before."""

    status: str


@dataclass(frozen=True)
class Note:
    """A comment."""

    text: str


Stmt = Let | Store | When | Flag | Note

STATUS = ("OK", "GATED", "NOT_POSITIVE", "BAD_STEP")
"""What a routine returns, in order of number and of gravity."""


@dataclass(frozen=True)
class Argument:
    """An argument: a scalar (`size` 0) or an array of `size` elements, with what it means."""

    name: str
    size: int
    text: str


@dataclass(frozen=True)
class Scratch:
    """A local array of zeros."""

    name: str
    size: int


@dataclass(frozen=True)
class Routine:
    """A function on the filter's arrays."""

    name: str
    text: str
    arguments: tuple[Argument, ...]
    body: tuple[Stmt, ...]
    scratch: tuple[Scratch, ...] = ()

    @property
    def operations(self) -> int:
        """Number of ``+ - * /``, square roots and the like, all branches counted."""
        return sum(_count(e) for e in _expressions(self.body))


def _expressions(body: tuple[Stmt, ...]) -> Iterator[Expr]:
    for s in body:
        if isinstance(s, Let | Store):
            yield s.value
        elif isinstance(s, When):
            yield s.condition.a
            yield s.condition.b
            yield from _expressions(s.body)
            yield from _expressions(s.orelse)


def _count(e: Expr) -> int:
    if isinstance(e, Bin):
        return 1 + _count(e.a) + _count(e.b)
    if isinstance(e, Una):
        return (e.op != "neg") + _count(e.a)
    return 0


def add(a: Expr, b: Expr) -> Expr:
    """``a + b``, without a zero."""
    if a == Num(0.0):
        return b
    if isinstance(b, Una) and b.op == "neg":
        return Bin("-", a, b.a)
    return a if b == Num(0.0) else Bin("+", a, b)


def sub(a: Expr, b: Expr) -> Expr:
    """``a - b``, without a zero."""
    if b == Num(0.0):
        return a
    return neg(b) if a == Num(0.0) else Bin("-", a, b)


def mul(a: Expr, b: Expr) -> Expr:
    """``a * b``, without ones; a sign goes outside."""
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
    return Num(-a.value) if isinstance(a, Num) else Una("neg", a)
