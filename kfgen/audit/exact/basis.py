"""A null space has many bases, and few that a person can read: known gauges first, then the vectors of the fewest states.

The reduced echelon form for an order of the states gives vectors that no other of their support is simpler than; forms
for many orders are collected, and the simplest that are independent are kept.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property

from kfgen.audit.exact.chain import NullSpace
from kfgen.audit.exact.padic import Ring, echelon
from kfgen.audit.exact.plan import Plan
from kfgen.audit.exact.segment_series import start_of
from kfgen.audit.exact.value_columns import least_seen, shown
from kfgen.audit.words import SPOKEN_UNITS
from kfgen.core.linear import Array
from kfgen.manoeuvre.manoeuvre import Manoeuvre

Vector = tuple[int, ...]
"""Residues, one a state."""


@dataclass(frozen=True)
class NullVector:
    """A null vector.

    Parameters
    ----------
    residues : tuple of int
    values : tuple of Fraction or None
        One a state; None where a value is no fraction (it depends on durations, or on a generic point).
    gauge : str
        In words, of a freedom that no measurement of the kind can ever remove; else empty.
    """

    residues: Vector
    values: tuple[Fraction | None, ...]
    gauge: str = ""

    @property
    def support(self) -> tuple[int, ...]:
        """The states in it."""
        return tuple(k for k, r in enumerate(self.residues) if r)


def readable(plan: Plan, manoeuvre: Manoeuvre, hidden: NullSpace, *, generic: bool) -> list[NullVector]:
    """A basis of what a manoeuvre hides, each vector one in its first state; `generic` as in `Plan.start`.

    Parameters
    ----------
    plan : Plan
    manoeuvre : Manoeuvre
    hidden : NullSpace
        What the manoeuvre leaves unobservable.
    generic : bool
        As in `Plan.start`.
    """
    ring = hidden.ring
    found = [
        (words, v)
        for words, v in gauges(plan, manoeuvre, ring, generic=generic)
        if any(v) and hidden.contains(v, ring)
    ]
    candidates = found + [("", v) for v in _circuits(hidden, _moving(plan))]
    shares = _Shares(plan, manoeuvre, ring, generic)
    kept: list[tuple[str, Vector]] = []
    late: list[tuple[str, Vector]] = []
    for beyond_all in (False, True):
        for words, v in late if beyond_all else candidates:
            rows = [v, *(k for _, k in kept)]
            if len(kept) == hidden.nullity or len(echelon(rows, range(plan.size), ring)) < len(rows):
                continue
            if not beyond_all and shares.beyond_all(v):
                late.append((words, v))
            else:
                kept.append((words, v))
    kept.sort(key=lambda e: (not e[0], _order(e[1])))
    return [_null(words, v, ring) for words, v in kept]


@dataclass(frozen=True)
class _Shares:
    """Whether amounts that are shares are possible ones: a force of 1e-5 m/s^2 hides a tilt by 70,000 % of its scale."""

    plan: Plan
    manoeuvre: Manoeuvre
    ring: Ring
    generic: bool

    def beyond_all(self, v: Vector) -> bool:
        """Whether the unit in which the first state is said goes with more than all (100 %) of another state."""
        units = [s.unit for s in self.plan.model.states]
        support = _order(v)
        shares = [k for k in support[1:] if units[k] == "1"]
        if not shares:
            return False
        one = SPOKEN_UNITS.get(units[support[0]], (1.0, ""))[0]
        exact = [self.ring.rational(v[k]) for k in shares]
        known = [float(e) for e in exact if e is not None]
        if len(known) < len(shares):
            amounts = least_seen(self._seen, support)
            known = [amounts[k] for k in shares]
        return any(abs(e) * one > 1.0 for e in known)

    @cached_property
    def _seen(self) -> Array:
        return shown(self.plan, self.manoeuvre, None, generic=self.generic)


def _order(v: Vector) -> list[int]:
    return [k for k, e in enumerate(v) if e]


def _null(words: str, v: Vector, ring: Ring) -> NullVector:
    return NullVector(v, tuple(ring.rational(e) if e else Fraction(0) for e in v), words)


def gauges(plan: Plan, manoeuvre: Manoeuvre, ring: Ring, *, generic: bool) -> list[tuple[str, Vector]]:
    """Moving everything, and turning everything about the vertical, as error states.

    Parameters
    ----------
    plan : Plan
    manoeuvre : Manoeuvre
    ring : Ring
        Of the residues that are returned.
    generic : bool
        As in `Plan.start`.
    """
    level = [b for b in plan.vectors if tuple(b.axes) == ("N", "E", "D")]
    places = {s.name: k for k, s in enumerate(plan.model.states)}
    out = []
    if sum(b.unit == "m" for b in level) > 1:
        for k, word in enumerate(("north", "east", "down")):
            v = [0] * plan.size
            for b in level:
                if b.unit == "m":
                    v[places[b.error_names[k]]] = 1
            out.append((f"Moving everything {word}", tuple(v)))
    if plan.model.attitude is not None and any(b.unit == "m" for b in level):
        v = [0] * plan.size
        v[places[plan.model.attitude.error_names[2]]] = 1
        for b in level:
            start = start_of(plan, manoeuvre, ring, generic=generic)
            v[places[b.error_names[0]]] = -start[b.nominal[1]] % ring.m
            v[places[b.error_names[1]]] = start[b.nominal[0]]
        if sum(map(bool, v)) > 1:
            out.append(("Turning everything about the vertical", tuple(v)))
    return out


def _moving(plan: Plan) -> set[int]:
    """Positions and velocities: less telling than attitudes, arms and biases."""
    names = {n for b in plan.vectors if any(r != 0 for r in plan.slope(b.name)) for n in b.error_names}
    return {k for k, s in enumerate(plan.model.states) if s.name in names}


def _circuits(hidden: NullSpace, moving: set[int]) -> list[Vector]:
    """Vectors of small support, the smallest first, among equals those of states that do not change."""
    ring, d = hidden.ring, hidden.nullity
    rows = [[int(e) for e in column] for column in hidden.basis.T]
    states = [k for k in range(hidden.basis.shape[0]) if any(row[k] for row in rows)]
    found: set[Vector] = set()
    orders = [states, states[::-1]]
    orders += [[s, *(o for o in states if o != s)] for s in states] if d > 1 else []
    orders += [[*(o for o in reversed(states) if o != s), s] for s in states] if d > 1 else []
    for order in orders:
        found.update(_leading(v, ring) for v in echelon(rows, order, ring))
    return sorted(found, key=lambda v: _weight(v, moving, ring))


def _weight(v: Vector, moving: set[int], ring: Ring) -> tuple[bool, int, int, list[int]]:
    """What is read last is largest: amounts that depend on durations, many states, states that move."""
    plain = all(e % ring.p and ring.rational(e) is not None for e in v if e)
    return not plain, sum(map(bool, v)), sum(k in moving for k in _order(v)), _order(v)


def _leading(v: Sequence[int], ring: Ring) -> Vector:
    """One in the first state, where that is no multiple of p."""
    first = next(e for e in v if e)
    if first % ring.p == 0:
        return tuple(v)
    scale = ring.inverse(first)
    return tuple(e * scale % ring.m for e in v)
