"""Whether the course that a random error took is as random as its name says.

Its smoothed course is linear in the innovations, which are white if the model is right. So every figure of the course (how
well it follows something recorded, how much of it is one spectral line, one short time, one jump, whether its values and
their changes are distributed so) is compared with the same figure of courses that the model itself gives.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

FALSE_ALARM_RATE = 0.01
"""Of all tests of one course together."""
COURSE_POINTS = 600
"""Times at which a course is looked at, at most."""
WINDOWS = 16
"""Parts of the log, one of which may hold all that happened."""
LAGS = (1, 2, 4, 8, 16)
"""Points over which changes and squares are looked at."""


@dataclass(frozen=True)
class _Test:
    """A figure of courses, shape (points, m), and what it means where it is large."""

    figure: Callable[[Array], tuple[Array, NDArray[np.intp]]]
    words: Callable[[int], str]


def not_random(
    t: Array, course: Array, drawn: Array, companions: Mapping[str, Array], law: bool = False
) -> str:
    """In what the course of a random error is none of a random error; empty where in nothing.

    Parameters
    ----------
    t : ndarray, shape (points,)
        Times [s].
    course : ndarray, shape (points,)
        That it took.
    drawn : ndarray, shape (points, m)
        Courses that the model gives.
    companions : mapping of str to ndarray, shape (points,)
        What it may follow, time among it, by what each is called.
    law : bool
        Whether the law of its values and of their changes is looked at, too.
    """
    every = np.column_stack([course, drawn])
    found = {}
    for test in (*_tests(t, drawn, companions), *([_law(drawn)] if law else [])):
        figure, where = test.figure(every)
        chance = float(np.mean(figure >= figure[0]))  # the course itself is one of them
        found[test.words(int(where[0]))] = chance
    words, least = min(found.items(), key=lambda item: item[1])
    return words if least * len(found) <= FALSE_ALARM_RATE * (1.0 + 1e-9) else ""


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


def _law(drawn: Array) -> _Test:
    return _Test(_strangest(_moments, drawn), lambda k: "its values and their changes have another law")


def _moments(w: Array) -> Array:
    """Skewness and kurtosis of courses and of their changes, and how squares go with what comes before and after, (figures, m).

    What is made by a rule and not by chance (a map, a switch, a limit) shows in the third moments of two times.
    """
    x = w - w.mean(axis=0)
    x = x / np.maximum(np.sqrt(np.mean(x**2, axis=0)), 1e-300)
    out = [np.mean(x**3, axis=0), np.mean(x**4, axis=0)]
    for lag in (k for k in LAGS if k < len(x)):
        before, after = x[:-lag], x[lag:]
        change = after - before
        size = np.maximum(np.mean(change**2, axis=0), 1e-300)
        out += [np.mean(change**3, axis=0) / size**1.5, np.mean(change**4, axis=0) / size**2]
        out += [np.mean(before**2 * after, axis=0), np.mean(before * after**2, axis=0)]
    return np.array(out)


def _strangest(
    of: Callable[[Array], Array], drawn: Array
) -> Callable[[Array], tuple[Array, NDArray[np.intp]]]:
    """The figure that is furthest from its mean in drawn courses, in their standard deviations."""
    usual = of(drawn)
    mean, sd = usual.mean(axis=1)[:, None], np.maximum(usual.std(axis=1), 1e-12)[:, None]

    def figure(w: Array) -> tuple[Array, NDArray[np.intp]]:
        away = np.abs(of(w) - mean) / sd
        return away.max(axis=0), away.argmax(axis=0)

    return figure
