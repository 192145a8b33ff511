"""The directions that no measurement of a manoeuvre shows, exactly.

Along a segment the error is ``x(t) = Phi(t) x0``, and shows as ``H(t) Phi(t) x0``; with ``Phi' = F Phi`` its power series is
written down order by order. What stays hidden is carried to the next segment by ``Phi(T)``, summed at a duration at which
every series converges (see `ring`), so that the answer holds for almost every duration. Directions are those at the start.

References
----------
.. [1] A. Sedoglavic, A probabilistic algorithm to test local algebraic observability in polynomial time,
   J. Symbolic Computation 33(5), 2002.
.. [2] D. Goshen-Meskin, I. Y. Bar-Itzhack, Observability analysis of piece-wise constant systems, IEEE TAES 28(4), 1992.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import sympy as sp

from kfgen.audit.course import Course, start_of
from kfgen.audit.modular import Echelon, coefficient, product
from kfgen.audit.plan import Plan
from kfgen.audit.ring import PRIMES, Degenerate, Ring
from kfgen.manoeuvre.manoeuvre import Manoeuvre, Segment

DIGITS = 24
"""Digits, and orders of the power series, of the exact answer."""
STALL = 8
"""Orders without a new row after which the quick look ends."""
DURATION = 1009
"""A segment's duration, in multiples of p, times its number."""

Residues = Any
"""Object arrays of whole numbers, shape (n, d)."""


@dataclass(frozen=True)
class Hidden:
    """A null space in a ring.

    Parameters
    ----------
    ring : Ring
        With the digits that are left.
    basis : ndarray of int, shape (n, d)
        Columns.
    """

    ring: Ring
    basis: Residues

    @property
    def nullity(self) -> int:
        """Its dimension."""
        return int(self.basis.shape[1])

    @cached_property
    def _kernel(self) -> Residues:
        """Rows that vanish on it, shape (n - d, n)."""
        rows, _ = null_space([[int(e) for e in c] for c in self.basis.T], self.basis.shape[0], self.ring)
        return rows

    def contains(self, vector: Sequence[int], ring: Ring) -> bool:
        """Whether a direction, in residues of a ring of the same prime, lies in it."""
        m = min(ring.m, self.ring.m)
        return all(sum(int(a) * v for a, v in zip(row, vector)) % m == 0 for row in self._kernel.T)


class Search:
    """Audits a plan along manoeuvres; first segments that manoeuvres share are done once."""

    def __init__(self, plan: Plan, p: int = PRIMES[0], digits: int = DIGITS) -> None:
        self.plan = plan
        self.p = p
        self.digits = digits
        self._first: dict[Any, tuple[Hidden, int]] = {}

    def hidden(self, manoeuvre: Manoeuvre, length: float | None = None) -> Hidden:
        """What a manoeuvre hides of the error at its start.

        Parameters
        ----------
        length : float, optional
            Of the manoeuvre [s]: rates that are written with it depend on it.
        """
        length = manoeuvre.length if length is None else length
        n = self.plan.size
        ring = Ring(self.p, self.digits)
        columns = self._quick(manoeuvre, length)
        start = np.zeros((n, len(columns)), dtype=object)
        for k, c in enumerate(columns):
            start[c, k] = 1
        B = image = start
        state = start_of(self.plan, manoeuvre, ring)
        for k, segment in enumerate(manoeuvre.segments):
            if not B.shape[1]:
                break
            course = Course(self.plan, ring, segment, length, state)
            course.extend(self.digits)
            V = _transition(course, image, self.digits)
            C, ring_left = null_space(_shown(course, V), B.shape[1], ring)
            B = (B.dot(C)) % ring_left.m
            if k + 1 == len(manoeuvre.segments) or not C.shape[1]:
                return Hidden(ring_left, B)
            T = self.p * DURATION * (k + 2) % ring.m
            image = _value([v.dot(C) for v in V], T, ring_left)
            state = {s: v % ring_left.m for s, v in course.at(T).items()}
            ring = ring_left
        return Hidden(ring, B)

    def _quick(self, manoeuvre: Manoeuvre, length: float) -> list[int]:
        """The states that the first segment may hide, modulo p."""
        ring = Ring(self.p, 1)
        try:
            state = start_of(self.plan, manoeuvre, ring)
            return quick(self.plan, ring, manoeuvre.segments[0], length, state).hidden
        except Degenerate:
            return list(range(self.plan.size))


def quick(plan: Plan, ring: Ring, segment: Segment, length: float, state: dict[sp.Symbol, int]) -> Echelon:
    """The row space of a segment modulo p."""
    n, p = plan.size, ring.p
    course = Course(plan, ring, segment, length, state)
    m = 1 + max((i for i, _, _ in plan.H), default=0)
    echelon = Echelon(n, p)
    F, H, Phi = [], [], [np.eye(n, dtype=np.int64)]
    gained = 0
    for k in range(n + STALL):
        course.extend(k + 1)
        F.append(coefficient(course.F, k, (n, n), p))
        H.append(coefficient(course.H, k, (m, n), p))
        if echelon.add(_convolution(H, Phi, k, p)):
            gained = k
        if echelon.rank == n or k - gained >= STALL:
            break
        step = _convolution(F, Phi, k, p)
        Phi.append(product(step, np.eye(n, dtype=np.int64) * ring.inverse(k + 1), p))
    return echelon


def _convolution(A: list[Any], B: list[Any], k: int, p: int) -> Any:
    """``sum_j A_j B_(k-j)``, leaving out the coefficients that are zero."""
    used = [j for j in range(k + 1) if A[j].any()]
    if not used:
        return np.zeros((A[0].shape[0], B[0].shape[1]), dtype=np.int64)
    return product(np.hstack([A[j] for j in used]), np.vstack([B[k - j] for j in used]), p)


def _convolve(entries: Any, V: list[Residues], k: int, rows: int, m: int) -> Residues:
    out = np.zeros((rows, V[0].shape[1]), dtype=object)
    for i, j, series in entries:
        for l in range(k + 1):
            if series[l]:
                out[i] = out[i] + series[l] * V[k - l][j]
    return out % m


def _transition(course: Course, start: Residues, orders: int) -> list[Residues]:
    """Coefficients of ``Phi(t) start``."""
    V = [start]
    for k in range(orders - 1):
        V.append(
            _convolve(course.F, V, k, start.shape[0], course.ring.m)
            * course.ring.inverse(k + 1)
            % course.ring.m
        )
    return V


def _shown(course: Course, V: list[Residues]) -> list[list[int]]:
    """Rows of ``H(t) Phi(t) start``, order by order, without those that are zero."""
    m = 1 + max((i for i, _, _ in course.H), default=0)
    rows = (row for k in range(len(V)) for row in _convolve(course.H, V, k, m, course.ring.m).tolist())
    return [row for row in rows if any(row)]


def _value(V: list[Residues], T: int, ring: Ring) -> Residues:
    total = np.zeros_like(V[0])
    for v in reversed(V):
        total = (total * T + v) % ring.m
    return total


def null_space(rows: list[list[int]], columns: int, ring: Ring) -> tuple[Residues, Ring]:
    """The null space of a matrix over the p-adic numbers.

    Pivots are those that p divides least, so that nothing is lost; of the answer as many digits are
    known as are left after the last pivot.

    Returns
    -------
    basis : ndarray of int, shape (columns, d)
        The identity in the free columns.
    ring : Ring
        With the digits that are left.
    """
    m, p = ring.m, ring.p
    rows = [[e % m for e in row] for row in rows]
    done: list[tuple[int, list[int], int]] = []
    free, lost = list(range(columns)), 0
    while rows and free:
        v, r, c = min((ring.valuation(row[c]), r, c) for r, row in enumerate(rows) for c in free)
        if v >= ring.digits - lost:
            break
        lost = max(lost, v)
        pivot = rows.pop(r)
        unit = ring.inverse(pivot[c] // p**v)
        done = [(c2, _without(row2, pivot, c, unit, p**v, m), v2) for c2, row2, v2 in done]
        rows = [_without(row, pivot, c, unit, p**v, m) for row in rows]
        rows = [row for row in rows if any(row)]
        done.append((c, pivot, v))
        free.remove(c)
    left = Ring(p, ring.digits - lost)
    basis = np.zeros((columns, len(free)), dtype=object)
    for k, f in enumerate(free):
        basis[f, k] = 1
        for c, row, v in done:
            basis[c, k] = -(row[f] // p**v) * pow(row[c] // p**v, -1, m) % left.m
    return basis, left


def _without(row: list[int], pivot: list[int], c: int, unit: int, power: int, m: int) -> list[int]:
    """A row with its entry under a pivot taken away; the entry is a multiple of the pivot."""
    if not row[c]:
        return row
    q = (row[c] // power) * unit
    return [(a - q * b) % m for a, b in zip(row, pivot)]
