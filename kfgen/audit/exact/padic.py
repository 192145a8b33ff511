"""`Ring`: numbers in which a rank is a fact.

In floating point it needs a tolerance, and a badly scaled model (radians beside metres) has none that is right. Here numbers are
residues modulo a power of a prime p, the p-adic numbers to so many digits: a fraction without p below is one of them, a power
series with such coefficients converges at every multiple of p and is summed exactly. So a segment's duration is taken as a
multiple of p: what is zero for it is zero for almost every duration.

References
----------
.. [1] F. Q. Gouvêa, p-adic Numbers, 3rd ed., 2020, ch. 5.
.. [2] P. S. Wang, A p-adic algorithm for univariate partial fractions, SYMSAC 1981 (rational reconstruction).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property

PRIMES = (
    536870909,
    536870879,
    536870869,
    536870849,
    536870839,
    536870837,
    536870819,
    536870813,
    536870791,
    536870779,
    536870767,
    536870743,
    536870729,
    536870723,
    536870717,
    536870701,
)
"""Below 2^29: sums of 127 products of residues stay within 64 bits. One in two lacks a root that a model needs."""
MOST_PRIMES = 256
"""Primes that are tried for a model with roots: of eight independent ones a prime has them all in one of 256."""


def primes(first: int = 0) -> Iterator[int]:
    """The primes, and those below them.

    Parameters
    ----------
    first : int
        The place of the first one.
    """
    from sympy import prevprime

    yield from PRIMES[first:]
    p = PRIMES[-1]
    for _ in range(MOST_PRIMES - len(PRIMES)):
        p = int(prevprime(p))
        yield p


class Degenerate(ArithmeticError):
    """A point at which a value does not exist modulo p; another point has to be taken."""


class NoRoot(Degenerate):
    """A square root that does not exist modulo p: half of the primes have it."""


@dataclass(frozen=True)
class Ring:
    """Whole numbers modulo ``p**digits``."""

    p: int
    digits: int

    @cached_property
    def m(self) -> int:
        """The modulus."""
        return int(self.p**self.digits)

    def of(self, value: Fraction) -> int:
        """A fraction's residue."""
        return value.numerator * self.inverse(value.denominator) % self.m

    def inverse(self, a: int) -> int:
        """``1/a``; raises `Degenerate` where p divides a."""
        if a % self.p == 0:
            raise Degenerate("a division by zero modulo p")
        return pow(a, -1, self.m)

    def valuation(self, a: int) -> int:
        """How many times p divides a residue; `digits` for zero."""
        if a % self.m == 0:
            return self.digits
        v = 0
        while a % self.p == 0:
            a //= self.p
            v += 1
        return v

    def sqrt(self, a: int) -> int:
        """A square root by Newton's steps; raises `NoRoot` where there is none."""
        from sympy.ntheory import sqrt_mod

        root = sqrt_mod(a % self.p, self.p)
        if not root:
            raise NoRoot("no square root modulo p")
        root, half = int(root), pow(2, -1, self.m)
        for _ in range(self.digits.bit_length() + 1):
            root = (root + a * self.inverse(root)) * half % self.m
        return root

    def rational(self, a: int) -> Fraction | None:
        """The simplest fraction of a residue; None where there is no convincing one [2]_."""
        m = self.m
        r0, r1, t0, t1 = m, a % m, 0, 1
        # Stop at the largest quotient: there the fraction is simplest against what chance would give.
        best: tuple[int, int, int] | None = None
        while r1:
            q = r0 // r1
            if best is None or q > best[0]:
                best = (q, r1, t1)
            r0, r1, t0, t1 = r1, r0 - q * r1, t1, t0 - q * t1
        if a % m == 0:
            return Fraction(0)
        if best is None or best[0].bit_length() < MIN_QUOTIENT_BITS:
            return None
        return Fraction(best[1], best[2])


MIN_QUOTIENT_BITS = 48
"""Bits of the quotient at which a reconstruction stops; by chance one in 2^48 residues has such a fraction."""


def echelon(rows: Sequence[Sequence[int]], order: Sequence[int], ring: Ring) -> list[list[int]]:
    """The reduced echelon form of rows, its pivots (which p does not divide) where an order of the columns first finds them.

    Parameters
    ----------
    rows : sequence of sequence of int
        Residues.
    order : sequence of int
        Columns.
    ring : Ring

    Returns
    -------
    list of list of int
        As many as are independent modulo p.
    """
    left, done = [list(r) for r in rows], list[list[int]]()
    for c in order:
        at = next((i for i, row in enumerate(left) if row[c] % ring.p), None)
        if at is None:
            continue
        pivot = left.pop(at)
        scale = ring.inverse(pivot[c])
        pivot = [e * scale % ring.m for e in pivot]
        left, done = ([_minus(row, row[c], pivot, ring.m) for row in part] for part in (left, done))
        done.append(pivot)
        if not left:
            break
    return done


def _minus(row: list[int], factor: int, pivot: list[int], m: int) -> list[int]:
    return [(a - factor * b) % m for a, b in zip(row, pivot)] if factor else row
