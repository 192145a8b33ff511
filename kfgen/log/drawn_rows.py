"""At which rows of a log a slower sensor gave a value, where straight lines are drawn from one value to the next.

A log whose channels are brought to one rate by linear interpolation has rows that no sensor measured: between two
values the second difference is zero, but for rounding, and at a value it is not.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Rows = NDArray[np.intp]

MIN_VALUES = 64
"""In a log, from which the distance between them is known."""
MAX_ROWS_OF_A_LINE = 256
MIN_SHARE_BY_THE_CLOCK = 0.98
"""Of the rows at which a line bends, that are whole distances apart."""
MIN_SHARE_OF_BENDS = 0.5
"""Of the values, at which the line is to bend by more than rounding: where it bends less all is one line."""
ROUNDINGS_OF_A_SECOND_DIFFERENCE = 2.0
"""Of the step of the file's numbers: half of one each, the middle one twice."""
ERROR_OF_INTERPOLATION = 16.0 * float(np.finfo(float).eps)
"""Of the largest value: what the computation of the lines itself rounds."""


def ends_of_lines(y: Array) -> Rows:
    """The rows of values between which straight lines are drawn; none where a log is not made that way.

    Parameters
    ----------
    y : ndarray, shape (n, k)
        One sensor's channels at even rows; numbers.

    Returns
    -------
    ndarray of int, shape (m,)
        Evenly spaced, two rows or more apart; before the first and after the last no line is whole.
    """
    if y.shape[0] < 2 * MIN_VALUES:
        return np.zeros(0, np.intp)
    bends = np.zeros(y.shape[0] - 2, bool)
    for column in y.T:
        bends |= np.abs(np.diff(column, 2)) > _rounding(column)
    at = 1 + np.flatnonzero(bends)
    if at.size < MIN_SHARE_OF_BENDS * MIN_VALUES or 2 * at.size > y.shape[0]:
        return np.zeros(0, np.intp)
    for period in range(min(MAX_ROWS_OF_A_LINE, y.shape[0] // MIN_VALUES), 1, -1):
        first = int(np.argmax(np.bincount(at % period, minlength=period)))
        rows = np.arange(first, y.shape[0], period)
        on = int(np.count_nonzero(at % period == first))
        if on >= MIN_SHARE_BY_THE_CLOCK * at.size and on >= MIN_SHARE_OF_BENDS * rows.size:
            return rows
    return np.zeros(0, np.intp)


def _rounding(y: Array) -> float:
    """The largest second difference of values on one line."""
    computed = ERROR_OF_INTERPOLATION * float(np.abs(y).max())
    steps = np.diff(np.unique(y))
    steps = steps[steps > computed]
    return computed + ROUNDINGS_OF_A_SECOND_DIFFERENCE * (1.0 + 1e-6) * float(steps.min(initial=np.inf))
