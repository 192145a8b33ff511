"""Whether the course that a random error took is as random as its name says.

Its smoothed course is linear in the innovations, which are white if the model is right. So every figure of the course (how
well it follows what the vehicle does, how much of it is one spectral line, one short time, one jump) is compared with the
same figure of courses that white innovations give.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from kfgen.gap.flight.linear.linear_flight import LinearFlight
from kfgen.gap.flight.path import FlownPath
from kfgen.gap.flight.random.random_error import random_error_of
from kfgen.gap.motion.truth import Truth
from kfgen.gap.scene.scene import Placed

Array = NDArray[np.float64]

CHANCE_COURSES = 399
"""Courses of white innovations."""
FALSE_ALARM_RATE = 0.01
"""Of all tests of one course together."""
COURSE_POINTS = 600
"""Times at which a course is looked at, at most."""
WINDOWS = 16
"""Parts of the log, one of which may hold all that happened."""


@dataclass(frozen=True)
class _Test:
    """A figure of courses, shape (points, m), and what it means where it is large."""

    figure: Callable[[Array], tuple[Array, NDArray[np.intp]]]
    words: Callable[[int], str]


def not_random(path: FlownPath, truth: Truth, placed: Placed) -> str:
    """In what the course of a random error of a filter is none of a random error; empty where in nothing.

    Parameters
    ----------
    path : FlownPath
        With the error among its random_errors.
    truth : Truth
        What its sensors should have read.
    placed : Placed
        The error.
    """
    index = [(w.effect.name, w.where) for w in path.random_errors].index((placed.effect.name, placed.where))
    orders = [random_error_of(w, path.log.dt).order for w in path.random_errors]
    column = path.equations.n + sum(orders[:index])
    step = max(1, path.log.t.size // COURSE_POINTS)
    rng, linear = np.random.default_rng(0), path.linear
    course = linear.smoothed()[::step, column]
    drawn = [_by_chance(linear, rng)[::step, column] for _ in range(CHANCE_COURSES)]
    every = np.column_stack([course, *drawn])
    t = path.log.t[::step]
    found = {}
    for test in _tests(t, every[:, 1:], _companions(path, truth, step)):
        figure, where = test.figure(every)
        chance = float(np.mean(figure >= figure[0]))  # the course itself is one of them
        found[test.words(int(where[0]))] = chance
    words, least = min(found.items(), key=lambda item: item[1])
    return words if least * len(found) <= FALSE_ALARM_RATE * (1.0 + 1e-9) else ""


def _by_chance(linear: LinearFlight, rng: np.random.Generator) -> Array:
    """A smoothed course of all states that white innovations give, shape (n, states)."""
    e = np.sqrt(linear.S) * rng.standard_normal(linear.S.size)
    return replace(linear, e=e, c=np.zeros_like(linear.c), x0=np.zeros_like(linear.x0)).smoothed()


def _companions(path: FlownPath, truth: Truth, step: int) -> dict[str, Array]:
    """What the vehicle does and what was recorded beside it, each of shape (points,)."""
    out: dict[str, Array] = dict(path.log.drive)
    for name, values in (("the rate of turn", truth.omega_b), ("the specific force", truth.f_b)):
        if values is not None:
            out[name] = np.linalg.norm(values, axis=1)
    if truth.speed_squared is not None:
        out["the speed"] = np.sqrt(np.maximum(truth.speed_squared, 0.0))
    if truth.R_bn is not None:
        out |= {
            "the cosine of the heading": truth.R_bn[:, 0, 0],
            "the sine of the heading": truth.R_bn[:, 0, 1],
        }
    out["time"] = path.log.t
    return {n: v[::step] for n, v in out.items() if float(np.ptp(v)) > 0.0}


def _tests(t: Array, drawn: Array, companions: Mapping[str, Array]) -> list[_Test]:
    """Every figure, over its usual size in courses that are drawn."""
    names = list(companions)
    A = np.column_stack([v - v.mean() for v in companions.values()])
    A /= np.linalg.norm(A, axis=0)

    def alike(w: Array) -> Array:
        centred = w - w.mean(axis=0)
        return np.asarray((A.T @ centred) ** 2 / np.maximum(np.sum(centred**2, axis=0), 1e-300))

    def lines(w: Array) -> Array:
        return np.asarray(np.abs(np.fft.rfft(np.diff(w, axis=0), axis=0)[1:]) ** 2)

    def steps(w: Array) -> Array:
        return np.asarray(np.diff(w, axis=0) ** 2)

    def windows(w: Array) -> Array:
        return np.array([part.sum(axis=0) for part in np.array_split(steps(w), WINDOWS)])

    span = float(t[-1] - t[0])
    return [
        _Test(_largest(alike, drawn, share=False), lambda k: f"it follows {names[k]}"),
        _Test(_largest(lines, drawn), lambda k: f"it is a spectral line at {(k + 1) / span:.2g} Hz"),
        _Test(_largest(windows, drawn), lambda k: f"it acts about {t[0] + (k + 0.5) * span / WINDOWS:.0f} s alone"),
        _Test(_largest(steps, drawn), lambda k: f"it jumps at {t[k]:.0f} s"),
    ]  # fmt: skip


def _largest(
    of: Callable[[Array], Array], drawn: Array, share: bool = True
) -> Callable[[Array], tuple[Array, NDArray[np.intp]]]:
    """The largest of many figures over its mean in drawn courses; `share` where the sum of all says nothing."""
    usual = np.maximum(of(drawn).mean(axis=1), 1e-300)[:, None]

    def figure(w: Array) -> tuple[Array, NDArray[np.intp]]:
        over = of(w) / usual
        if share:
            over = over / over.sum(axis=0)
        return over.max(axis=0), over.argmax(axis=0)

    return figure
