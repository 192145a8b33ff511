"""Whether another manoeuvre shows a direction: first the direction has to be carried to where that one starts.

Between them the body may have turned and gained speed. An attitude error then stays as it is in navigation axes (a
wrong heading) or turns with the body (an error of its axes), and a velocity that was integrated with it turns along.
The direction is still unobservable if one of these is.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from kfgen.audit.exact.basis import NullVector
from kfgen.audit.exact.plan import Plan
from kfgen.audit.exact.segment_series import rotation
from kfgen.core.straight_line import decimal
from kfgen.manoeuvre.manoeuvre import Manoeuvre

Fractions = Any
"""Object arrays of fractions."""


def carried(plan: Plan, v: NullVector, first: Manoeuvre, other: Manoeuvre) -> list[Fractions] | None:
    """What a direction at the start of `first` may be at that of `other`; None where it is no fraction.

    Parameters
    ----------
    plan : Plan
    v : NullVector
        The direction.
    first : Manoeuvre
        At whose start it is.
    other : Manoeuvre
        To whose start it goes.
    """
    if any(e is None for e in v.values):
        return None
    known = np.array(v.values, dtype=object)
    attitude = plan.model.attitude
    if attitude is None:
        return [known]
    places = {s.name: k for k, s in enumerate(plan.model.states)}
    angle = [places[n] for n in attitude.error_names]
    gained = np.array([decimal(n) - decimal(o) for n, o in zip(other.velocity, first.velocity)])
    A, B = (np.array(rotation([decimal(c) for c in m.attitude])).reshape(3, 3) for m in (first, other))
    out = []
    for Q in (np.eye(3, dtype=int), B @ A.T, A @ B.T):
        turned = _with(known, angle, Q @ known[angle])
        out.append(turned)
        for b in plan.vectors:
            if b.name == "v" and "v" in plan.given and gained.any():
                at = [places[n] for n in b.error_names]
                change = np.cross(turned[angle], gained)
                out += [_with(turned, at, turned[at] + sign * change) for sign in (1, -1)]
    return out


def _with(v: Fractions, places: Sequence[int], values: Fractions) -> Fractions:
    out = v.copy()
    out[list(places)] = values
    return out
