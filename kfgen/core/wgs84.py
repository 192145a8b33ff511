"""The ellipsoid of WGS 84, and the metres north, east and down of its coordinates.

References
----------
.. [1] NIMA TR8350.2, World Geodetic System 1984, 3rd ed., 2000.
.. [2] P. D. Groves, Principles of GNSS, Inertial, and Multisensor Integrated Navigation Systems, 2nd ed., 2013,
   eqs (2.112), (2.150).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

SEMI_MAJOR = 6378137.0
"""Equatorial radius [m]."""
FLATTENING = 1.0 / 298.257223563
ECCENTRICITY2 = FLATTENING * (2.0 - FLATTENING)
"""Squared eccentricity of the meridian."""
EARTH_RATE = 7.292115e-5
"""Rotation of the Earth [rad/s]."""


def local_metres(latitude: Array, longitude: Array, height: Array) -> tuple[Array, Array, Array]:
    """Coordinates as metres north, east and down of the first of them.

    North and east are axes of the tangent plane at the first point; down is the difference of heights, so that it
    agrees with a barometer at any distance.

    Parameters
    ----------
    latitude, longitude : ndarray, shape (n,)
        Geodetic [rad].
    height : ndarray, shape (n,)
        Above the ellipsoid or the sea [m]: of the datum, only differences count.

    Returns
    -------
    north, east, down : ndarray, shape (n,)
        [m].
    """
    sine, cosine = np.sin(latitude), np.cos(latitude)
    transverse = SEMI_MAJOR / np.sqrt(1.0 - ECCENTRICITY2 * sine**2)
    x = (transverse + height) * cosine * np.cos(longitude - longitude[0])
    east = (transverse + height) * cosine * np.sin(longitude - longitude[0])
    z = ((1.0 - ECCENTRICITY2) * transverse + height) * sine
    north = cosine[0] * (z - z[0]) - sine[0] * (x - x[0])
    return north, east, height[0] - height
