"""Innovations and residuals over time, with the band of two standard deviations that they should keep to."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from kfgen.report.plots import BAND, Line, Picture, stacked_picture
from kfgen.run.band import BAND_SIGMAS

Array = NDArray[np.float64]

ROOM = 1.15
"""Of the largest value drawn, to the edge of a band that is wider."""


def band_picture(
    panels: Sequence[tuple[str, Array, Array, Sequence[Line]]], key: str, sigmas: float = BAND_SIGMAS
) -> Picture:
    """Series over their band, a panel below the other; where the band is far wider than the series it is cut.

    Parameters
    ----------
    panels : sequence of (str, ndarray, ndarray, sequence of Line)
        Label of the axis, times [s], standard deviations at these times, what is drawn over the band; the last three in
        the unit of the label.
    key : str
        Begins the inner names of the picture.
    sigmas : float
        Standard deviations of the band.
    """
    drawn = []
    for ylabel, t, sd, lines in panels:
        band = band_of(f"{sigmas:g} standard deviations", t, sigmas * sd, lines)
        drawn.append((ylabel, [band, *lines]))
    return stacked_picture(drawn, key)


def band_of(label: str, t: Array, half: Array, lines: Sequence[Line], color: str = BAND) -> Line:
    """A band about zero that is no wider than its usual width or what is drawn over it.

    Parameters
    ----------
    label : str
    t : ndarray, shape (n,)
        Times [s].
    half : ndarray, shape (n,)
        Half its width.
    lines : sequence of Line
        Drawn over it.
    color : str
    """
    sizes = [np.abs(line.y[np.isfinite(line.y)]).max(initial=0.0) for line in lines]
    usual = float(np.median(half[np.isfinite(half)])) if np.isfinite(half).any() else 0.0
    width = np.minimum(half, ROOM * max(*sizes, usual))
    return Line(label, t, np.full(t.size, np.nan), color, -width, width)
