"""Intervals of numbers of limited precision, rounded outward, that know when a product is a square.

A plain interval takes ``d s s`` with s in [-1, 1] for something that may be negative. Each value therefore carries the
factors of its sign: those that occur twice cancel, and what is left without any has a known sign. Two relations are
kept as well: a sum of numbers that are not negative is no less than each of them, so ``(c / (d + e)) d <= c``; and
the nearest whole number k of ``c x + b`` leaves little of ``x - k / c`` however large x is.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from itertools import count

import numpy as np

from kfgen.emit.routines import REALS

Addend = int | tuple[int, ...]
_numbers: Iterator[int] = count()


@dataclass(frozen=True)
class Rounded:
    """A whole number: that nearest to ``slope x + shift``, by less than half and what rounding adds.

    Parameters
    ----------
    of : int
        Identity of x.
    slope, shift, off : float
        `off` is the most by which it differs from ``slope x + shift``.
    """

    of: int
    slope: float
    shift: float
    off: float


@dataclass(frozen=True)
class Reduced:
    """``x - m k``: what is left of x, with the rounding of the way there.

    Parameters
    ----------
    x, k : KnownNumber
    m, error : float
    """

    x: KnownNumber
    k: KnownNumber
    m: float
    error: float


@dataclass(frozen=True)
class KnownNumber:
    """What is known of a number.

    Parameters
    ----------
    lo, hi : float
        It is neither below nor above.
    raw : bool
        It may have any bit pattern: nothing has looked at it yet.
    negative, factors : bool, frozenset of int
        Its sign is that of the product of values with these identities, or the opposite.
    addends : frozenset
        Numbers that are not negative and not larger than it, by their identities; products by `term`.
    product : (int, int), optional
        Of these two it is the product.
    term : tuple of int, optional
        ``(s,)`` where it is the square of s, ``(c, s)`` where it is c times that.
    under : frozenset
        It is the root of a number with these addends.
    ratio : (KnownNumber, KnownNumber), optional
        It is the first over the second.
    scaled : (KnownNumber, float), optional
        It is the first times a number.
    rounded, reduced : optional
        See there.
    identity : int
    """

    lo: float
    hi: float
    raw: bool = False
    negative: bool = False
    factors: frozenset[int] = frozenset()
    addends: frozenset[Addend] = frozenset()
    product: tuple[int, int] | None = None
    term: tuple[int, ...] | None = None
    under: frozenset[Addend] = frozenset()
    ratio: tuple[KnownNumber, KnownNumber] | None = None
    scaled: tuple[KnownNumber, float] | None = None
    rounded: Rounded | None = None
    reduced: Reduced | None = None
    identity: int = field(default_factory=lambda: next(_numbers))

    @property
    def most(self) -> float:
        """Its largest magnitude."""
        return max(-self.lo, self.hi)

    @property
    def least(self) -> float:
        """Its smallest magnitude."""
        return max(self.lo, -self.hi, 0.0)

    def within(self, lo: float, hi: float) -> KnownNumber:
        """The same number, known to be within two more bounds."""
        if self.raw:
            return value(lo, hi)
        lo, hi = max(self.lo, lo), min(self.hi, hi)
        return self if (lo, hi) == (self.lo, self.hi) else signed(replace(self, lo=lo, hi=max(lo, hi)))


def signed(v: KnownNumber) -> KnownNumber:
    """With the factors of its sign: none where that is known, itself where it is not the product of others."""
    if v.lo >= 0.0 or v.hi <= 0.0:
        return replace(v, factors=frozenset(), negative=v.hi <= 0.0 and v.lo < 0.0)
    return v if v.factors else replace(v, factors=frozenset({v.identity}), negative=False)


def value(lo: float, hi: float) -> KnownNumber:
    """A number between two bounds."""
    return signed(KnownNumber(lo, hi))


RAW = KnownNumber(-math.inf, math.inf, raw=True)
"""Any bit pattern."""


def hull(a: KnownNumber, b: KnownNumber) -> KnownNumber:
    """One or the other."""
    if a is b:
        return a
    return RAW if a.raw or b.raw else value(min(a.lo, b.lo), max(a.hi, b.hi))


class Arithmetic:
    """Operations on values in one precision; a result that cannot be bounded is noted in `failed`, and goes on bounded.

    Parameters
    ----------
    real : str
        A key of `kfgen.emit.routines.REALS`.
    """

    def __init__(self, real: str) -> None:
        self.kind = REALS[real]
        kind = np.finfo(self.kind)
        self.largest = float(kind.max)
        # Twice the unit of the last place covers the rounding of the operation and that of its bounds in double precision.
        self.relative = 4.0 * max(float(kind.eps), 2.0**-52)
        self.smallest = float(kind.smallest_subnormal)
        self.whole = 0.25 / float(kind.eps)
        self.failed: list[str] = []

    def number(self, v: float) -> KnownNumber:
        """A literal, as it is rounded to the precision."""
        with np.errstate(over="ignore"):
            rounded = float(self.kind(v))
        return value(rounded, rounded)

    def _out(self, lo: float, hi: float) -> KnownNumber:
        """Rounded outward; what would be beyond the largest number is a failure."""
        if not (math.isfinite(lo) and math.isfinite(hi)):
            lo, hi = -math.inf, math.inf
        below, above = self._margin(lo), self._margin(hi)
        out_lo = max(lo - below, 0.0) if lo >= 0.0 else lo - below
        out_hi = min(hi + above, 0.0) if hi <= 0.0 else hi + above
        if max(-out_lo, out_hi) > self.largest:
            self.failed.append("overflows")
            out_lo, out_hi = max(out_lo, -self.largest), min(out_hi, self.largest)
        return value(out_lo, out_hi)

    def _margin(self, v: float) -> float:
        return 0.0 if v == 0.0 else abs(v) * self.relative + 2.0 * self.smallest

    def add(self, a: KnownNumber, b: KnownNumber) -> KnownNumber:
        """``a + b``."""
        out = self._out(a.lo + b.lo, a.hi + b.hi)
        if a.lo >= 0.0 and b.lo >= 0.0:
            out = replace(out, addends=_addends(a) | _addends(b))
        for x, c in ((a, b), (b, a)):
            if x.rounded and c.lo == c.hi:
                shifted = replace(
                    x.rounded, shift=x.rounded.shift + c.lo, off=x.rounded.off + self._margin(out.most)
                )
                out = replace(out, rounded=shifted)
            if x.scaled and c.lo == c.hi:
                out = replace(out, reduced=None, scaled=None, rounded=self._linear(x, c.lo, out))
        return out

    def _linear(self, x: KnownNumber, shift: float, out: KnownNumber) -> Rounded | None:
        """``slope x + shift`` before it is rounded to a whole number."""
        assert x.scaled
        base, slope = x.scaled
        return Rounded(base.identity, slope, shift, self._margin(out.most) + self._margin(x.most))

    def sub(self, a: KnownNumber, b: KnownNumber) -> KnownNumber:
        """``a - b``."""
        if b.lo == b.hi and (a.scaled or a.rounded):
            return self.add(a, self.neg(b))
        out = self._out(a.lo - b.hi, a.hi - b.lo)
        if b.scaled and b.scaled[0].rounded:
            return self._less(a, b.scaled[0], b.scaled[1], out, b.most)
        return out

    def _less(self, a: KnownNumber, k: KnownNumber, m: float, out: KnownNumber, size: float) -> KnownNumber:
        """``a - m k``, where k is a whole number near a multiple of a, or of what a was before."""
        assert k.rounded
        before = a.reduced if a.reduced and a.reduced.k.identity == k.identity else None
        x, total = (before.x, before.m + m) if before else (a, m)
        if k.rounded.of != x.identity:
            return out
        error = (before.error if before else 0.0) + 2.0 * (self._margin(size) + self._margin(a.most))
        left = abs(1.0 - total * k.rounded.slope) * x.most + abs(total) * (
            abs(k.rounded.shift) + k.rounded.off
        )
        bound = (left + error) * (1.0 + self.relative)
        return replace(out.within(-bound, bound), reduced=Reduced(x, k, total, error))

    def mul(self, a: KnownNumber, b: KnownNumber) -> KnownNumber:
        """``a b``."""
        products = [_product(p, q) for p in (a.lo, a.hi) for q in (b.lo, b.hi)]
        lo, hi = min(products), max(products)
        factors, negative = a.factors ^ b.factors, a.negative != b.negative
        if not factors:
            lo, hi = (lo, min(hi, 0.0)) if negative else (max(lo, 0.0), hi)
        bound = min(_held(a, b), _held(b, a)) * (1.0 + 4.0 * self.relative)
        lo, hi = max(lo, -bound), min(hi, bound)
        out = self._out(lo, hi)
        if out.factors and factors:
            out = replace(out, factors=factors, negative=negative)
        out = replace(out, product=(a.identity, b.identity), term=_term(a, b) or _term(b, a))
        for x, c in ((a, b), (b, a)):
            if c.lo == c.hi:
                out = replace(out, scaled=(x, c.lo))
        return out

    def div(self, a: KnownNumber, b: KnownNumber) -> KnownNumber:
        """``a / b``."""
        if b.lo <= 0.0 <= b.hi:
            self.failed.append("divides by what may be zero")
            return value(-self.largest, self.largest)
        quotients = [_quotient(p, q) for p in (a.lo, a.hi) for q in (b.lo, b.hi)]
        lo, hi = min(quotients), max(quotients)
        if a.identity in b.addends:
            hi = min(hi, 1.0 + self.relative)
        out = self._out(lo, hi)
        factors, negative = a.factors ^ b.factors, a.negative != b.negative
        if out.factors and factors:
            out = replace(out, factors=factors, negative=negative)
        return replace(out, ratio=(a, b))

    def neg(self, a: KnownNumber) -> KnownNumber:
        """``-a``."""
        if a.lo >= 0.0 or a.hi <= 0.0:
            return value(-a.hi, -a.lo)
        scaled = a.scaled and (a.scaled[0], -a.scaled[1])
        return KnownNumber(-a.hi, -a.lo, negative=not a.negative, factors=a.factors, scaled=scaled)

    def sqrt(self, a: KnownNumber) -> KnownNumber:
        """Root."""
        if a.lo < 0.0:
            self.failed.append("takes the root of what may be negative")
        out = self._out(math.sqrt(max(a.lo, 0.0)), math.sqrt(max(a.hi, 0.0)))
        return replace(out, under=_addends(a))

    def magnitude(self, a: KnownNumber) -> KnownNumber:
        """``|a|``."""
        return value(a.least, a.most)

    def sign(self, a: KnownNumber) -> KnownNumber:
        """-1, 0 or 1."""
        return value(-1.0 if a.lo < 0.0 else 0.0, 1.0 if a.hi > 0.0 else 0.0)

    def rint(self, a: KnownNumber) -> KnownNumber:
        """Nearest whole number, by adding and taking away a large one."""
        near = 0.5 if a.most < self.whole else 0.5 + self._margin(a.most) + 8.0 * a.most * self.relative
        out = self._out(a.lo - near, a.hi + near)
        linear = a.rounded or (a.scaled and self._linear(a, 0.0, a))
        if not linear:
            return out
        return replace(out, rounded=replace(linear, off=linear.off + near), scaled=None)


def _product(a: float, b: float) -> float:
    return 0.0 if a == 0.0 or b == 0.0 else a * b


def _quotient(a: float, b: float) -> float:
    try:
        return a / b
    except OverflowError:
        return math.copysign(math.inf, a * b)


def _term(a: KnownNumber, b: KnownNumber) -> tuple[int, ...] | None:
    """What ``a b`` is as a square, or as a number times one."""
    if a.identity == b.identity:
        return (a.identity,)
    if a.product and b.identity in a.product:
        c, s = a.product if a.product[1] == b.identity else reversed(a.product)
        return (c, s)
    return None


def _addends(a: KnownNumber) -> frozenset[Addend]:
    """What is not larger than it, itself among them."""
    return a.addends | {a.identity} | ({a.term} if a.term is not None else frozenset())


def _held(a: KnownNumber, b: KnownNumber) -> float:
    """A bound of ``a b`` where a is ``c / (b + ...)``, ``c / sqrt(b^2 + ...)``, or ``c / (d + c b^2)`` with d > 0.

    The last is largest where both addends are equal.
    """
    if not a.ratio:
        return math.inf
    c, under = a.ratio
    if b.identity in under.addends or (b.identity,) in under.under:
        return c.most
    if (c.identity, b.identity) in under.addends and under.lo > 0.0:
        return 0.5 * math.sqrt(c.most / under.lo)
    return math.inf
