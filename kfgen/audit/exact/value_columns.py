"""The amounts of an unobservable direction as numbers, which the exact answer has not always.

They are the fractions that were found, where two primes and two sets of durations agree on them. A direction that depends
on how long segments last, or on roots and sines of a plant's point, is computed in floating point: its states are known
exactly, so one singular vector of few columns is wanted.
"""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from typing import TYPE_CHECKING

import numpy as np
import sympy as sp

from kfgen.audit.exact.chain import NullSpace, along
from kfgen.audit.exact.padic import PRIMES
from kfgen.audit.exact.plan import Plan
from kfgen.core.linear import Array, van_loan
from kfgen.manoeuvre.flight import Flight
from kfgen.manoeuvre.manoeuvre import Manoeuvre

if TYPE_CHECKING:
    from kfgen.audit.exact.basis import NullVector

FLOATING_POINT_STEPS = 1500
"""Steps of the floating point run."""
ROUNDING = 1e-9
"""An amount of a state that is less of what is seen of the others is none."""


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
    other, seen = None, None
    if nulls and (len(manoeuvre.segments) > 1 or plan.own):
        (other,) = along(plan, [manoeuvre], length, generic=generic, first=len(PRIMES) // 2)
    out: list[tuple[Sequence[float], bool]] = []
    for v in nulls:
        known = [e for e in v.values if e is not None]
        exact = len(known) == len(v.values) and _agreed(other, known)
        if exact:
            out.append(([float(e) for e in known], True))
            continue
        if seen is None:
            seen = shown(plan, manoeuvre, length, generic=generic)
        out.append((least_seen(seen, v.support), False))
    return out


def _agreed(other: NullSpace | None, values: Sequence[Fraction]) -> bool:
    """Whether another prime, and so other durations, hide the same direction."""
    return other is None or other.contains([other.ring.of(e) for e in values], other.ring)


def shown(plan: Plan, manoeuvre: Manoeuvre, length: float | None, *, generic: bool) -> Array:
    """What an error of each state at the start does to the measurements of a manoeuvre, shape (samples, n).

    Parameters
    ----------
    plan : Plan
    manoeuvre : Manoeuvre
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
    V = one = Phi = np.eye(plan.size)
    rows, last = [H[0]], np.full_like(F[0], np.nan)
    for k in range(FLOATING_POINT_STEPS):
        middle = 0.5 * (F[k] + F[k + 1])
        if not np.array_equal(middle, last):  # at rest it is the same at every step
            Phi, last = van_loan(middle, 0.0 * one, float(t[1]))[0], middle
        V = Phi @ V
        rows.append(H[k + 1] @ V)
    return np.vstack(rows)


def least_seen(seen: Array, support: Sequence[int]) -> list[float]:
    """The direction in some states that the measurements see least, one in the first that has an amount.

    Parameters
    ----------
    seen : ndarray, shape (samples, n)
        Of `shown`.
    support : sequence of int
        The states in the direction.
    """
    columns = seen[:, list(support)]
    size = np.linalg.norm(columns, axis=0)
    size[size == 0.0] = 1.0
    weakest = np.linalg.svd(columns / size, full_matrices=False)[2][-1]
    # An exact start in fractions is level to their last digit only, so that a state may be in a direction by that much.
    weakest = np.where(np.abs(weakest) > ROUNDING * np.abs(weakest).max(), weakest / size, 0.0)
    out = np.zeros(seen.shape[1])
    out[list(support)] = weakest / weakest[np.flatnonzero(weakest)[0]]
    return [float(e) for e in out]
