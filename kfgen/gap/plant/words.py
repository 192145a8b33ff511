"""What a user is told of a log of a plant."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kfgen.gap.plant.lost_rows import LostRows


def of_lost_rows(lost: LostRows, t: NDArray[np.float64]) -> list[str]:
    """That rows are lost, where, and what that means; nothing where none is.

    Parameters
    ----------
    lost : LostRows
    t : ndarray, shape (n,)
        Times of the log [s].
    """
    if not lost.before.size:
        return []
    count, k = int(np.round(lost.steps - 1.0).sum()), int(np.argmax(lost.steps))
    last = lost.before[k]
    rows = "1 row of the log is" if count == 1 else f"{count} rows of the log are"
    anew = " and where the plant is after the long ones" if lost.is_long.any() else ""
    return [
        f"{rows} lost, the longest hole lasts {t[last + 1] - t[last]:.4g} s from {t[last]:.6g} s on: what the inputs did "
        f"there{anew} counts as unknown. Log without losses where small effects matter"
    ]
