"""The directions that no measurement of a manoeuvre shows: their null space, exactly, for almost every duration.

Along a segment the error is ``x(t) = Phi(t) x0``, and shows as ``H(t) Phi(t) x0``; with ``Phi' = F Phi`` its power series is
written down order by order. What stays hidden is carried to the next segment by ``Phi(T)``, summed at a duration at which
every series converges (see `padic`), so that the answer holds for almost every duration. Directions are those at the start.

References
----------
.. [1] A. Sedoglavic, A probabilistic algorithm to test local algebraic observability in polynomial time,
   J. Symbolic Computation 33(5), 2002.
.. [2] D. Goshen-Meskin, I. Y. Bar-Itzhack, Observability analysis of piece-wise constant systems, IEEE TAES 28(4), 1992.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import sympy as sp

from kfgen.audit.exact.modular import Echelon, coefficient, product
from kfgen.audit.exact.padic import PRIMES, Degenerate, NoRoot, Ring, primes
from kfgen.audit.exact.plan import Plan
from kfgen.audit.exact.segment_series import SegmentSeries, start_of
from kfgen.core.errors import InputError
from kfgen.manoeuvre.manoeuvre import Manoeuvre, Segment

EXACT_DIGITS = 24
"""Digits, and orders of the power series, of the exact answer."""
MAX_STALLED_ORDERS = 8
"""Orders without a new row after which the quick look ends."""
SEGMENT_DURATION_MULTIPLE = 1009
"""A segment's duration, in multiples of p, times its number."""

Residues = Any
"""Object arrays of whole numbers, shape (n, d)."""


@dataclass(frozen=True)
class NullSpace:
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
        """Whether a direction, in residues of a ring of the same prime, lies in it.

        Parameters
        ----------
        vector : sequence of int, length n
            Residues.
        ring : Ring
            Of these residues, of the same prime.
        """
        m = min(ring.m, self.ring.m)
        return all(sum(int(a) * v for a, v in zip(row, vector)) % m == 0 for row in self._kernel.T)


@dataclass(frozen=True)
class GenericPoint:
    """Where a plan is looked at: a prime, digits, and whether its own blocks stand at no special point."""

    p: int
    generic: bool
    digits: int = EXACT_DIGITS


def along(
    plan: Plan,
    manoeuvres: Sequence[Manoeuvre],
    length: float | None = None,
    *,
    generic: bool = True,
    first: int = 0,
    p: int | None = None,
) -> list[NullSpace]:
    """What each manoeuvre hides of the error at its start, all modulo powers of one prime.

    Parameters
    ----------
    plan : Plan
    manoeuvres : sequence of Manoeuvre
    length : float, optional
        Of the manoeuvres [s]: rates that are written with it depend on it.
    generic : bool
        As in `Plan.start`.
    first : int
        The first of the primes to be tried.
    p : int, optional
        The prime; raises `Degenerate` where it cannot be had.

    Raises
    ------
    InputError
        The model has no value where it starts.
    """
    if p is not None:
        return [null_space_along(plan, m, length, GenericPoint(p, generic)) for m in manoeuvres]
    left = len(PRIMES)
    for prime in primes(first):
        try:
            return [null_space_along(plan, m, length, GenericPoint(prime, generic)) for m in manoeuvres]
        except NoRoot as error:
            why: Degenerate = error
        except Degenerate as error:
            why, left = error, left - 1
            if not left:
                break
    raise InputError(
        f"{plan.model.name} has no value where the motion starts ({why})",
        remedy="Give its states another initial value",
    )


def null_space_along(
    plan: Plan, manoeuvre: Manoeuvre, length: float | None, point: GenericPoint
) -> NullSpace:
    """What a manoeuvre hides, at a point; raises `Degenerate` where that has no value.

    Parameters
    ----------
    plan : Plan
    manoeuvre : Manoeuvre
    length : float or None
        Of the manoeuvre [s]; its own where None.
    point : GenericPoint
    """
    length = manoeuvre.length if length is None else length
    ring = Ring(point.p, point.digits)
    columns, orders = _first_look(plan, manoeuvre, length, point)
    B = np.zeros((plan.size, len(columns)), dtype=object)
    B[columns, range(len(columns))] = 1
    image, state = B, start_of(plan, manoeuvre, ring, generic=point.generic)
    for k, segment in enumerate(manoeuvre.segments, 1):
        if not B.shape[1]:
            break
        series = SegmentSeries(plan, ring, segment, length, state)
        series.extend(orders)
        V = _transition(series, image, orders)
        C, ring = null_space(_shown(series, V), B.shape[1], ring)
        B = B.dot(C) % ring.m
        if k < len(manoeuvre.segments):
            T = point.p * SEGMENT_DURATION_MULTIPLE * (k + 1) % ring.m
            image = _value([v.dot(C) for v in V], T, ring)
            state = {s: v % ring.m for s, v in series.at(T).items()}
    if 3 * ring.digits < point.digits:
        return null_space_along(plan, manoeuvre, length, replace(point, digits=2 * point.digits))
    return NullSpace(ring, B)


def _first_look(
    plan: Plan, manoeuvre: Manoeuvre, length: float, point: GenericPoint
) -> tuple[list[int], int]:
    """The states that the first segment may hide, modulo p; the orders of the power series that matter."""
    ring = Ring(point.p, 1)
    try:
        state = start_of(plan, manoeuvre, ring, generic=point.generic)
        rows, gained = row_space_modulo_p(plan, ring, manoeuvre.segments[0], length, state)
    except NoRoot:
        raise
    except Degenerate:
        return list(range(plan.size)), max(point.digits, plan.size)
    return rows.unobservable_columns, max(point.digits, gained + 2)


def row_space_modulo_p(
    plan: Plan, ring: Ring, segment: Segment, length: float, state: dict[sp.Symbol, int]
) -> tuple[Echelon, int]:
    """The row space of a segment modulo p, and the last order at which it grew.

    Parameters
    ----------
    plan : Plan
    ring : Ring
        Of one digit.
    segment : Segment
    length : float
        Of the whole manoeuvre [s].
    state : mapping of Symbol to int
        Residues of attitude and blocks where the segment starts.
    """
    n, p = plan.size, ring.p
    series = SegmentSeries(plan, ring, segment, length, state)
    m = 1 + max((i for i, _, _ in plan.H), default=0)
    echelon = Echelon(n, p)
    F, H, Phi = [], [], [np.eye(n, dtype=np.int64)]
    gained = 0
    for k in range(n + MAX_STALLED_ORDERS):
        series.extend(k + 1)
        F.append(coefficient(series.F, k, (n, n), p))
        H.append(coefficient(series.H, k, (m, n), p))
        if echelon.add(_convolution(H, Phi, k, p)):
            gained = k
        if echelon.rank == n or k - gained >= MAX_STALLED_ORDERS:
            break
        step = _convolution(F, Phi, k, p)
        Phi.append(product(step, np.eye(n, dtype=np.int64) * ring.inverse(k + 1), p))
    return echelon, gained


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


def _transition(series: SegmentSeries, start: Residues, orders: int) -> list[Residues]:
    """Coefficients of ``Phi(t) start``."""
    V = [start]
    for k in range(orders - 1):
        V.append(
            _convolve(series.F, V, k, start.shape[0], series.ring.m)
            * series.ring.inverse(k + 1)
            % series.ring.m
        )
    return V


def _shown(series: SegmentSeries, V: list[Residues]) -> list[list[int]]:
    """Rows of ``H(t) Phi(t) start``, order by order, without those that are zero."""
    m = 1 + max((i for i, _, _ in series.H), default=0)
    rows = (row for k in range(len(V)) for row in _convolve(series.H, V, k, m, series.ring.m).tolist())
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

    Parameters
    ----------
    rows : list of list of int
        Residues, one list a row.
    columns : int
        Their length.
    ring : Ring

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
        rows = [_without(row, pivot, c, unit, p**v, m) for row in rows]
        rows = [row for row in rows if any(row)]
        done.append((c, pivot, v))
        free.remove(c)
    left = Ring(p, ring.digits - lost)
    basis = np.zeros((columns, len(free)), dtype=object)
    for k, f in enumerate(free):
        x = {f: 1}
        # From the last pivot back: an earlier one divides all that stood in its row, so that nothing is lost.
        for c, row, v in reversed(done):
            rest = sum(row[j] * value for j, value in x.items()) % m
            x[c] = -(rest // p**v) * pow(row[c] // p**v, -1, m) % m
        for c, value in x.items():
            basis[c, k] = value % left.m
    return basis, left


def _without(row: list[int], pivot: list[int], c: int, unit: int, power: int, m: int) -> list[int]:
    """A row with its entry under a pivot eliminated; the entry is a multiple of the pivot."""
    if not row[c]:
        return row
    q = (row[c] // power) * unit
    return [(a - q * b) % m for a, b in zip(row, pivot)]
