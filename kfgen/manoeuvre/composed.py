"""Manoeuvres of others: at another speed, one after the other; and where they lead."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import sympy as sp
from numpy.typing import NDArray

from kfgen.core.expression import Expression
from kfgen.manoeuvre.manoeuvre import Manoeuvre, Segment, Triple, of_time
from kfgen.manoeuvre.rotations import cumulative, exponential, inverse, product, rotated

Array = NDArray[np.float64]

COURSE_STEP_S = 0.02
"""Step by which a course is integrated [s]."""
EXTENT_POINTS = 500
"""Of a course, between which its extent is measured."""
SAME_SPEED_SHARE = 0.02
"""Share of the speed by which velocities may differ where one manoeuvre goes over into another."""
SAME_SPEED_M_S = 0.1
"""The same at rest [m/s]."""
SAME_TILT_RAD = 0.05
"""Angle between the two verticals there [rad]."""


@dataclass(frozen=True)
class Course:
    """Where a manoeuvre leads.

    Parameters
    ----------
    q : ndarray, shape (n, 4)
        Attitude, body to north-east-down, scalar first.
    v : ndarray, shape (n, 3)
        Velocity in north, east and down [m/s].
    p : ndarray, shape (n, 3)
        Way from the start in north, east and down [m].
    """

    q: Array
    v: Array
    p: Array

    @cached_property
    def extent(self) -> float:
        """Largest horizontal distance between two of its points [m]."""
        from scipy.spatial.distance import pdist

        some = self.p[:: max(1, len(self.p) // EXTENT_POINTS), :2]
        return float(pdist(some).max(initial=0.0))

    def ends(self, k: int) -> tuple[Array, Array]:
        """Velocity and down in body axes at sample `k`, each of shape (3,): what does not depend on the heading."""
        back = inverse(self.q[k])
        return rotated(back, self.v[k]), rotated(back, np.array([0.0, 0.0, 1.0]))

    def leads_into(self, other: Course) -> bool:
        """Whether another manoeuvre can begin where this one ends, at any heading.

        Parameters
        ----------
        other : Course
            Of the other manoeuvre.
        """
        (v, down), (v_next, down_next) = self.ends(-1), other.ends(0)
        near = SAME_SPEED_M_S + SAME_SPEED_SHARE * float(np.linalg.norm(v))
        return bool(np.linalg.norm(v - v_next) < near and np.linalg.norm(down - down_next) < SAME_TILT_RAD)


def course(manoeuvre: Manoeuvre) -> Course:
    """Where a manoeuvre leads in its own length.

    Parameters
    ----------
    manoeuvre : Manoeuvre

    Returns
    -------
    Course

    Raises
    ------
    InputError
        As `Manoeuvre.values`.
    """
    n = max(2, int(np.ceil(manoeuvre.length / COURSE_STEP_S)))
    dt = manoeuvre.length / n
    times = np.asarray((np.arange(n) + 0.5) * dt, dtype=np.float64)
    omega, a_l, a_b = manoeuvre.values(times, manoeuvre.length, 0.0)
    start = np.asarray(manoeuvre.attitude, dtype=np.float64)
    q = product(start / np.linalg.norm(start), cumulative(exponential(omega * dt)))
    middle = product(q[:-1], exponential(0.5 * omega * dt))
    a = a_l + rotated(middle, a_b)
    v = np.asarray(manoeuvre.velocity) + np.concatenate([np.zeros((1, 3)), np.cumsum(a * dt, axis=0)])
    steps = 0.5 * (v[1:] + v[:-1]) * dt
    return Course(q, v, np.concatenate([np.zeros((1, 3)), np.cumsum(steps, axis=0)]))


def at_speed(manoeuvre: Manoeuvre, speed: float) -> Manoeuvre:
    """A manoeuvre that begins at another speed; as it is where it begins at rest.

    A level one keeps its turns and becomes wider; a banked one keeps its bank, and so its accelerations, and turns more
    slowly the faster it is.

    Parameters
    ----------
    manoeuvre : Manoeuvre
    speed : float
        At the start [m/s].

    Returns
    -------
    Manoeuvre
    """
    own = float(np.linalg.norm(manoeuvre.velocity))
    if own == 0.0:
        return manoeuvre
    share = speed / own
    x, y, z = (share * v for v in manoeuvre.velocity)
    level = np.allclose(manoeuvre.attitude[1:3], 0.0)

    def scaled(segment: Segment) -> Segment:
        if not level:
            return replace(segment, rate=_times(segment.rate, 1.0 / share))
        return replace(
            segment,
            acceleration=_times(segment.acceleration, share),
            body_acceleration=_times(segment.body_acceleration, share),
        )

    return replace(manoeuvre, velocity=(x, y, z), segments=tuple(map(scaled, manoeuvre.segments)))


def followed_by(first: Manoeuvre, second: Manoeuvre) -> Manoeuvre:
    """Two manoeuvres one after the other, each in its own length.

    Parameters
    ----------
    first, second : Manoeuvre
        The second begins where the first ends; see `Course.leads_into`.

    Returns
    -------
    Manoeuvre
        As long as both.
    """
    segments = (*_of_own_length(first), *_of_own_length(second))
    title = f"{first.title}; then {second.title}"
    return replace(first, name=f"{first.name} then {second.name}", title=title, segments=segments)


def _of_own_length(manoeuvre: Manoeuvre) -> Sequence[Segment]:
    """Its segments with the length of the manoeuvre put in."""
    length = manoeuvre.length
    return [
        replace(
            s,
            duration=_expression(of_time(s.duration, length)),
            **{
                name: _each(getattr(s, name), lambda e: of_time(e, length))
                for name in ("rate", "acceleration", "body_acceleration")
            },
            inputs={n: _expression(of_time(e, length)) for n, e in s.inputs.items()},
        )
        for s in manoeuvre.segments
    ]


def _times(triple: Triple, factor: float) -> Triple:
    return _each(triple, lambda e: sp.Float(repr(factor), 17) * e.value)


def _each(triple: Triple, made: Callable[[Expression], sp.Expr]) -> Triple:
    x, y, z = (_expression(made(e)) for e in triple)
    return x, y, z


def _expression(value: sp.Expr) -> Expression:
    return Expression(str(value), value)
