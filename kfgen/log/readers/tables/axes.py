"""Axes of other programs as those of kfgen: east, north, up as north, east, down."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

NED_OF_ENU = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
"""Rotation that gives north, east, down of a vector east, north, up."""


def ned_attitude(q: Array) -> Array:
    """Attitudes to east, north, up as attitudes to north, east, down; those that are none stay so.

    Parameters
    ----------
    q : ndarray, shape (4, n)
        Body to east, north, up, scalar first; of any length.

    Returns
    -------
    ndarray, shape (4, n)
        Body to north, east, down, scalar first; not numbers where there is no attitude.
    """
    from scipy.spatial.transform import Rotation  # heavy: only for logs with attitudes

    out = np.full(q.shape, np.nan)
    good = np.isfinite(q).all(axis=0) & (np.abs(q).max(axis=0) > 0.0)
    turned = Rotation.from_matrix(NED_OF_ENU) * Rotation.from_quat(q[:, good].T, scalar_first=True)
    out[:, good] = turned.as_quat(scalar_first=True).T
    return out
