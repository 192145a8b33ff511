"""The ellipsoid on which the readings of a constant length lie, in closed form: where a calibration starts.

References
----------
.. [1] Q. Li and J. G. Griffiths, Least squares ellipsoid specific fitting, Geometric Modeling and Processing, 2004.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kfgen.core.errors import InputError

Array = NDArray[np.float64]

MIN_READINGS = 9
"""Numbers of a quadric."""


def ellipsoid(y: Array) -> tuple[Array, Array]:
    """Centre and upper triangular root of the ellipsoid of readings: ``y = b + U e`` with ``|e| = 1``.

    Parameters
    ----------
    y : ndarray, shape (n, 3)
        Readings [SI], n of at least `MIN_READINGS`.

    Returns
    -------
    b : ndarray, shape (3,)
    U : ndarray, shape (3, 3)

    Raises
    ------
    InputError
        The readings lie on no ellipsoid.
    """
    middle, size = y.mean(axis=0), float(np.linalg.norm(y - y.mean(axis=0), axis=1).max())
    x, v, z = ((y - middle) / size).T
    D = np.column_stack([x * x, v * v, z * z, 2 * x * v, 2 * x * z, 2 * v * z, 2 * x, 2 * v, 2 * z])
    p = np.linalg.lstsq(D, np.ones(x.size), rcond=None)[0]
    Q = np.array([[p[0], p[3], p[4]], [p[3], p[1], p[5]], [p[4], p[5], p[2]]])
    if not np.linalg.eigvalsh(Q)[0] > 0.0:
        raise InputError("the readings lie on no ellipsoid")
    centre = -np.linalg.solve(Q, p[6:])
    shape = np.linalg.inv(Q / (1.0 + centre @ Q @ centre))
    # Upper triangular: the lower one of the axes in the opposite order.
    U = np.linalg.cholesky(shape[::-1, ::-1])[::-1, ::-1]
    return middle + size * centre, size * U
