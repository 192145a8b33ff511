"""`CourseFigure`: a figure of the course of a random error, and what it means where it is large."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class CourseFigure:
    """A figure of courses.

    Parameters
    ----------
    of : callable
        The course that was taken and, in the other columns, those that the model gives, shape (points, 1 + m), to
        their figures, shape (1 + m,), and where in the course, or what, makes each.
    words : callable
        Where, or what, to its meaning.
    """

    of: Callable[[Array], tuple[Array, NDArray[np.intp]]]
    words: Callable[[int], str]


def largest(
    of: Callable[[Array], Array], share: bool = True, smoothed_over: float = 0.0
) -> Callable[[Array], tuple[Array, NDArray[np.intp]]]:
    """The largest of many figures over its mean in courses that the model gives.

    Parameters
    ----------
    of : callable
        Courses, shape (points, 1 + m), to figures, shape (figures, 1 + m).
    share : bool
        The sum of all says nothing.
    smoothed_over : float
        Neighbouring figures that are looked at together.
    """

    def figure(every: Array) -> tuple[Array, NDArray[np.intp]]:
        from scipy.ndimage import gaussian_filter1d

        over = of(every)
        over = over / np.maximum(over[:, 1:].mean(axis=1), 1e-300)[:, None]
        if smoothed_over:
            over = gaussian_filter1d(over, smoothed_over, axis=0)
        if share:
            over = over / over.sum(axis=0)
        return over.max(axis=0), over.argmax(axis=0)

    return figure


def strangest(
    of: Callable[[Array], Array], larger: bool = False
) -> Callable[[Array], tuple[Array, NDArray[np.intp]]]:
    """The figure that is furthest from its mean in courses that the model gives, in their standard deviations.

    Parameters
    ----------
    of : callable
        Courses, shape (points, 1 + m), to figures, shape (figures, 1 + m).
    larger : bool
        Whether only what is larger than the mean counts.
    """

    def figure(every: Array) -> tuple[Array, NDArray[np.intp]]:
        figures = of(every)
        usual = figures[:, 1:]
        mean, sd = usual.mean(axis=1)[:, None], np.maximum(usual.std(axis=1), 1e-12)[:, None]
        away = (figures - mean) / sd
        away = away if larger else np.abs(away)
        return away.max(axis=0), away.argmax(axis=0)

    return figure
