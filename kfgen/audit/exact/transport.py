"""A hidden direction carried from where one manoeuvre starts to where another does.

Between them the body may have turned and gained speed. An attitude error then stays as it is in navigation axes (a
wrong heading) or turns with the body (an error of its axes), and a velocity that was integrated with it turns along.
The direction is still hidden if one of these is.
"""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction

from kfgen.audit.exact.basis import Null
from kfgen.audit.exact.plan import Plan
from kfgen.audit.exact.segment_series import rotation
from kfgen.core.straight_line import decimal
from kfgen.manoeuvre.manoeuvre import Manoeuvre

Vector = list[Fraction]


def carried(plan: Plan, v: Null, first: Manoeuvre, other: Manoeuvre) -> list[Vector] | None:
    """What a direction at the start of `first` may be at that of `other`; None where it is no fraction."""
    known = [e for e in v.values if e is not None]
    if len(known) < len(v.values):
        return None
    attitude = plan.model.attitude
    if attitude is None:
        return [known]
    places = {s.name: k for k, s in enumerate(plan.model.states)}
    angle = [places[n] for n in attitude.error_names]
    out = []
    turn = _between(first.attitude, other.attitude)
    for Q in (_UNIT, turn, _transposed(turn)):
        turned = _with(known, angle, _times(Q, [known[k] for k in angle]))
        out.append(turned)
        for b in plan.vectors:
            if b.name == "v" and "v" in plan.given and other.velocity != first.velocity:
                gained = [decimal(n) - decimal(o) for n, o in zip(other.velocity, first.velocity)]
                change = _cross([turned[k] for k in angle], gained)
                at = [places[n] for n in b.error_names]
                out += [_with(turned, at, [turned[k] + s * c for k, c in zip(at, change)]) for s in (1, -1)]
    return out


_UNIT = [Fraction(int(i == j)) for i in range(3) for j in range(3)]


def _between(a: Sequence[float], b: Sequence[float]) -> Vector:
    """``R_b R_a'`` of two attitudes."""
    A, B = (rotation([decimal(c) for c in q]) for q in (a, b))
    return [
        sum((B[3 * i + k] * A[3 * j + k] for k in range(3)), Fraction(0)) for i in range(3) for j in range(3)
    ]


def _transposed(M: Vector) -> Vector:
    return [M[3 * j + i] for i in range(3) for j in range(3)]


def _times(M: Vector, x: Sequence[Fraction]) -> Vector:
    return [sum((M[3 * i + k] * x[k] for k in range(3)), Fraction(0)) for i in range(3)]


def _cross(a: Sequence[Fraction], b: Sequence[Fraction]) -> Vector:
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def _with(v: Sequence[Fraction], places: Sequence[int], values: Sequence[Fraction]) -> Vector:
    out = list(v)
    for k, value in zip(places, values):
        out[k] = value
    return out
