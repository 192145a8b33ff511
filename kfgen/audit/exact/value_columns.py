"""The amounts of an unobservable direction as numbers, which the exact answer has not always.

They are the fractions that were found, where two primes and two sets of durations agree on them. A direction that depends
on how long segments last, or on roots and sines of a plant's point, is computed in floating point: its states are known
exactly, so one singular vector of few columns is wanted.
"""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction

import numpy as np
import sympy as sp

from kfgen.audit.exact.basis import NullVector
from kfgen.audit.exact.chain import NullSpace, along
from kfgen.audit.exact.padic import PRIMES
from kfgen.audit.exact.plan import Plan
from kfgen.core.linear import van_loan
from kfgen.manoeuvre.flight import Flight
from kfgen.manoeuvre.manoeuvre import Manoeuvre

FLOATING_POINT_STEPS = 1500
"""Steps of the floating point run."""


def in_numbers(
    plan: Plan, manoeuvre: Manoeuvre, nulls: Sequence[NullVector], length: float | None, *, generic: bool
) -> list[tuple[Sequence[float], bool]]:
    """The amounts of directions [SI], one a state, and whether they are the exact fractions.

    Parameters
    ----------
    plan : Plan
    manoeuvre : Manoeuvre
    nulls : sequence of NullVector
        The directions.
    length : float or None
        Of the manoeuvre [s]; its own where None.
    generic : bool
        As in `Plan.start`.
    """
    other = None
    if nulls and (len(manoeuvre.segments) > 1 or plan.own):
        (other,) = along(plan, [manoeuvre], length, generic=generic, first=len(PRIMES) // 2)
    out: list[tuple[Sequence[float], bool]] = []
    for v in nulls:
        known = [e for e in v.values if e is not None]
        exact = len(known) == len(v.values) and _agreed(other, known)
        amounts = (
            [float(e) for e in known]
            if exact
            else floating(plan, manoeuvre, v.support, length, generic=generic)
        )
        out.append((amounts, exact))
    return out


def _agreed(other: NullSpace | None, values: Sequence[Fraction]) -> bool:
    """Whether another prime, and so other durations, hide the same direction."""
    return other is None or other.contains([other.ring.of(e) for e in values], other.ring)


def floating(
    plan: Plan, manoeuvre: Manoeuvre, support: Sequence[int], length: float | None, *, generic: bool
) -> list[float]:
    """The direction in some states that the measurements see least, one in the first of them.

    Parameters
    ----------
    plan : Plan
    manoeuvre : Manoeuvre
    support : sequence of int
        The states in the direction, the first gets the amount one.
    length : float or None
        Of the manoeuvre [s]; its own where None.
    generic : bool
        As in `Plan.start`.
    """
    model = plan.model
    T = manoeuvre.length if length is None else length
    t = np.linspace(0.0, T, FLOATING_POINT_STEPS + 1)
    flight = Flight(model, manoeuvre, t, start=plan.numbers(generic=generic))
    F = flight.matrix(model.F)
    H = flight.matrix(sp.Matrix.vstack(sp.zeros(0, plan.size), *(model.H(s) for s in plan.sensors)))
    V = np.eye(plan.size)[:, list(support)]
    rows = [H[0] @ V]
    for k in range(FLOATING_POINT_STEPS):
        V = van_loan(0.5 * (F[k] + F[k + 1]), 0 * F[k], float(t[1]))[0] @ V
        rows.append(H[k + 1] @ V)
    O = np.vstack(rows)
    size = np.linalg.norm(O, axis=0)
    size[size == 0.0] = 1.0
    weakest = np.linalg.svd(O / size, full_matrices=False)[2][-1] / size
    out = np.zeros(plan.size)
    out[list(support)] = weakest / weakest[0]
    return [float(e) for e in out]
