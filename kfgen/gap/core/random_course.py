"""Whether the course that a random error took is as random as its name says.

Its smoothed course is linear in the innovations, which are white if the model is right. So every figure of the course (how
well it follows something recorded, how much of it is one spectral line, one short time, one jump, whether its values and
their changes are distributed so) is compared with the same figure of courses that the model itself gives: the chance of each
is the share of courses in which it is no smaller, and the cubes of the logarithms of all chances are added up. Their sum is
compared with that of every drawn course in turn, so that figures need not be independent: one that is very unusual counts
nearly as if it were alone, and several that are rather unusual count together.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from kfgen.gap.core.course_figure import CourseFigure, largest
from kfgen.gap.core.course_law import figures_of_law

Array = NDArray[np.float64]

FALSE_ALARM_RATE = 0.02
"""Of all tests of one course together."""
UNUSUAL_POWER = 3
"""Of the logarithms of chances that are added up: at one many figures that are a little unusual outweigh one that is very."""
PLAINEST_SHARE = 0.7
"""Of the least usual figure, by those cubes: of what is nearly as unusual the figure is said that is the plainest."""
COURSE_POINTS = 600
"""Times at which a course is looked at, at most."""
WINDOWS = 16
"""Parts of the log, one of which may hold all that happened."""


def not_random(t: Array, course: Array, drawn: Array, companions: Mapping[str, Array]) -> str:
    """In what the course of a random error is none of a random error; empty where in nothing. Arguments as for `least_usual`.

    Of what is made by a rule and not by chance nothing is asked.
    """
    words, chance = least_usual(t, course, drawn, companions, law=False)
    return words if chance <= FALSE_ALARM_RATE else ""


def least_usual(
    t: Array, course: Array, drawn: Array, companions: Mapping[str, Array], law: bool
) -> tuple[str, float]:
    """What the least usual figure of a course means, of several the plainest, and by what chance all figures are as unusual.

    Parameters
    ----------
    t : ndarray, shape (points,)
        Times [s].
    course : ndarray, shape (points,)
        That the random error took.
    drawn : ndarray, shape (points, m)
        Courses that the model gives.
    companions : mapping of str to ndarray, shape (points,)
        What it may follow, time among it, by what each is called.
    law : bool
        Whether the law of its values and of their changes is looked at, too.

    Returns
    -------
    (str, float)
    """
    from scipy.stats import rankdata

    every = np.column_stack([course, drawn])
    words, unusual = [], []
    for figure in (*_figures(t, companions), *(figures_of_law(t) if law else [])):
        each, where = figure.of(every)
        chance = rankdata(-each, method="max") / each.size  # the course itself is one of them
        words.append(figure.words(int(where[0])))
        unusual.append((-np.log(chance)) ** UNUSUAL_POWER)
    together = np.sum(unusual, axis=0)
    own = np.array([u[0] for u in unusual])
    plainest = int(np.argmax(own >= PLAINEST_SHARE * own.max()))
    return words[plainest], float(np.mean(together >= together[0] * (1.0 - 1e-9)))


def _figures(t: Array, companions: Mapping[str, Array]) -> list[CourseFigure]:
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
        CourseFigure(largest(alike, share=False), lambda k: f"it follows {names[k]}"),
        CourseFigure(largest(lines), lambda k: f"it is a spectral line at {(k + 1) / span:.2g} Hz"),
        CourseFigure(largest(windows), lambda k: f"it acts about {t[0] + (k + 0.5) * span / WINDOWS:.0f} s alone"),
        CourseFigure(largest(steps), lambda k: f"it jumps at {t[k]:.0f} s"),
    ]  # fmt: skip
