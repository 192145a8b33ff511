"""The Earth in symbols or numbers: ellipsoid, rate, normal gravity (WGS 84).

References
----------
.. [1] NIMA TR8350.2, World Geodetic System 1984, 3rd ed., 2000.
.. [2] P. D. Groves, Principles of GNSS, Inertial, and Multisensor Integrated Navigation
   Systems, 2nd ed., 2013, eqs (2.105), (2.106), (2.112), (2.134), (2.142).
.. [3] B. R. Bowring, The accuracy of geodetic latitude and height equations, Survey Review 28, 1985.
"""

from __future__ import annotations

import math

import sympy as sp

from kfgen.core.wgs84 import EARTH_RATE, ECCENTRICITY2, FLATTENING, SEMI_MAJOR

GM = 3.986004418e14
"""Gravitational constant of the Earth [m^3/s^2]."""
J2 = 1.0826298e-3
"""Second zonal harmonic, conventional sign removed."""
EQUATOR_GRAVITY = 9.7803253359
"""Normal gravity at the equator [m/s^2]."""
SOMIGLIANA = 1.931852652e-3
"""Constant of Somigliana's formula."""
GRAVITY_RATIO = 3.449786507e-3
"""Squared Earth rate times a^2 b over GM."""


def radii(s: sp.Expr) -> tuple[sp.Expr, sp.Expr]:
    """Radii of curvature of meridian and prime vertical [m] for the sine of a latitude (eqs (2.105), (2.106) of [2]_)."""
    w2 = 1 - ECCENTRICITY2 * s**2
    w = sp.sqrt(w2)
    return SEMI_MAJOR * (1 - ECCENTRICITY2) / (w2 * w), SEMI_MAJOR / w


def normal_gravity(s: sp.Expr, h: sp.Expr) -> sp.Expr:
    """Normal gravity [m/s^2] for the sine of a latitude and a height [m] (eqs (2.134), (2.139) of [2]_)."""
    surface = EQUATOR_GRAVITY * (1 + SOMIGLIANA * s**2) / sp.sqrt(1 - ECCENTRICITY2 * s**2)
    share = h / SEMI_MAJOR
    return surface * (1 - 2 * share * (1 + FLATTENING * (1 - 2 * s**2) + GRAVITY_RATIO) + 3 * share**2)


def gravity_e(r: sp.Matrix) -> sp.Matrix:
    """Gravity in Earth axes [m/s^2] at a place [m], shape (3, 1): second harmonic and rotation (eq. (2.142) of [2]_).

    Within 1.1e-4 m/s^2 of normal gravity near the ground.
    """
    x, y, z = r / SEMI_MAJOR  # in radii: no power leaves single precision
    r2 = x**2 + y**2 + z**2
    flat = sp.Rational(3, 2) * J2 / r2
    polar = 5 * z**2 / r2
    pull = -GM / SEMI_MAJOR**2 / (r2 * sp.sqrt(r2))
    whirl = EARTH_RATE**2 * SEMI_MAJOR
    return sp.Matrix(
        [
            pull * x * (1 + flat * (1 - polar)) + whirl * x,
            pull * y * (1 + flat * (1 - polar)) + whirl * y,
            pull * z * (1 + flat * (3 - polar)),
        ]
    )


def geodetic(r: sp.Matrix) -> tuple[sp.Expr, sp.Expr, sp.Expr]:
    """Sine and cosine of the latitude, and the height [m], of a place in Earth axes (Bowring [3]_)."""
    x, y, z = r / SEMI_MAJOR
    b = 1 - FLATTENING
    rho = sp.sqrt(x**2 + y**2)
    out = rho * b
    scale = sp.sqrt(z**2 + out**2)
    sine = z + ECCENTRICITY2 / (1 - ECCENTRICITY2) * b * (z / scale) ** 3
    cosine = rho - ECCENTRICITY2 * (out / scale) ** 3
    length = sp.sqrt(sine**2 + cosine**2)
    s, c = sine / length, cosine / length
    return s, c, SEMI_MAJOR * (rho * c + z * s - sp.sqrt(1 - ECCENTRICITY2 * s**2))


def place(latitude: float, longitude: float, height: float) -> tuple[float, float, float]:
    """A place in Earth axes [m] (eq. (2.112) of [2]_)."""
    s, c = math.sin(latitude), math.cos(latitude)
    prime = float(radii(sp.Float(s))[1])
    out = (prime + height) * c
    up = (prime * (1.0 - ECCENTRICITY2) + height) * s
    return out * math.cos(longitude), out * math.sin(longitude), up
