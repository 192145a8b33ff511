"""What functions of time are in a record that holds means of blocks of samples."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from kfgen.identify.evidence.whittle import block_means

Array = NDArray[np.float64]
Shapes = Callable[[Array, Mapping[str, Array]], Sequence[Array]]

POINTS_OF_A_MEAN = 8
"""At which a function is evaluated within a block: of a line of two blocks a period the mean is right to 0.7 %."""


def in_means(shapes: Shapes, t: Array, drive: Mapping[str, Array], length: float) -> list[Array]:
    """Means of functions over blocks of time.

    Parameters
    ----------
    shapes : callable
        Of times [s], shape (m,), and of drivers there, to functions, each of shape (m,).
    t : ndarray, shape (n,)
        Middles of the blocks [s].
    drive : mapping of str to ndarray, shape (n,)
        Means of the drivers [SI].
    length : float
        Of a block [s].

    Returns
    -------
    list of ndarray, shape (n,)
    """
    inside = ((np.arange(POINTS_OF_A_MEAN) + 0.5) / POINTS_OF_A_MEAN - 0.5) * length
    times = np.asarray((t[:, None] + inside).ravel(), dtype=np.float64)
    at = {k: np.interp(times, t, v) for k, v in drive.items()}
    return [block_means(x, POINTS_OF_A_MEAN) for x in shapes(times, at)]
