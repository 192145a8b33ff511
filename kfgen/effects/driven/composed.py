"""What follows sample by sample, over whole arrays."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def composed(maps: Array, after: Callable[[Array, Array], Array]) -> Array:
    """Maps of one sample to the next, each put together with all before it, shape (2, n, batch).

    Maps of single steps are put together in pairs, those in pairs of pairs and so on: ``log2(n)`` passes.

    Parameters
    ----------
    maps : ndarray, shape (2, n, batch)
        Two numbers of the map of each step; the first map is constant.
    after : callable
        The maps, shape (2, m, batch), that are those of its first argument after those of its second.
    """
    out, span = maps.copy(), 1
    while span < out.shape[1]:
        out[:, span:] = after(out[:, span:], out[:, :-span])
        span *= 2
    return out
