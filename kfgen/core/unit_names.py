"""The names of units: their sizes in SI, the prefixes, and the signs that people type for them."""

from __future__ import annotations

import math

STANDARD_GRAVITY = 9.80665
"""Standard acceleration of free fall [m/s^2]."""

BASE_UNITS = ("m", "kg", "s", "A", "K", "rad", "count")
"""Base units, in the order of the exponents of a unit."""

PREFIX_FACTORS = {"": 1.0, "n": 1e-9, "u": 1e-6, "m": 1e-3, "c": 1e-2, "k": 1e3, "M": 1e6}
"""What a prefix multiplies by."""

UNIT_NAMES: dict[str, tuple[float, dict[str, int], bool]] = {
    "m": (1.0, {"m": 1}, True),
    "kg": (1.0, {"kg": 1}, False),
    "s": (1.0, {"s": 1}, True),
    "min": (60.0, {"s": 1}, False),
    "h": (3600.0, {"s": 1}, False),
    "hr": (3600.0, {"s": 1}, False),
    "sec": (1.0, {"s": 1}, False),
    "msec": (1e-3, {"s": 1}, False),
    "usec": (1e-6, {"s": 1}, False),
    "second": (1.0, {"s": 1}, False),
    "seconds": (1.0, {"s": 1}, False),
    "milliseconds": (1e-3, {"s": 1}, False),
    "microseconds": (1e-6, {"s": 1}, False),
    "nanoseconds": (1e-9, {"s": 1}, False),
    "minutes": (60.0, {"s": 1}, False),
    "hours": (3600.0, {"s": 1}, False),
    "A": (1.0, {"A": 1}, True),
    "K": (1.0, {"K": 1}, True),
    "degC": (1.0, {"K": 1}, False),
    "rad": (1.0, {"rad": 1}, True),
    "deg": (math.pi / 180.0, {"rad": 1}, True),
    "dps": (math.pi / 180.0, {"rad": 1, "s": -1}, True),
    "arcmin": (math.pi / 10800.0, {"rad": 1}, False),
    "arcsec": (math.pi / 648000.0, {"rad": 1}, False),
    "rev": (2.0 * math.pi, {"rad": 1}, False),
    "rpm": (2.0 * math.pi / 60.0, {"rad": 1, "s": -1}, False),
    "Hz": (1.0, {"s": -1}, True),
    "g": (STANDARD_GRAVITY, {"m": 1, "s": -2}, True),
    "Gal": (1e-2, {"m": 1, "s": -2}, True),
    "N": (1.0, {"kg": 1, "m": 1, "s": -2}, True),
    "Pa": (1.0, {"kg": 1, "m": -1, "s": -2}, True),
    "hPa": (100.0, {"kg": 1, "m": -1, "s": -2}, False),
    "bar": (1e5, {"kg": 1, "m": -1, "s": -2}, True),
    "J": (1.0, {"kg": 1, "m": 2, "s": -2}, True),
    "W": (1.0, {"kg": 1, "m": 2, "s": -3}, True),
    "V": (1.0, {"kg": 1, "m": 2, "s": -3, "A": -1}, True),
    "ohm": (1.0, {"kg": 1, "m": 2, "s": -3, "A": -2}, True),
    "Ohm": (1.0, {"kg": 1, "m": 2, "s": -3, "A": -2}, True),
    "T": (1.0, {"kg": 1, "s": -2, "A": -1}, True),
    "G": (1e-4, {"kg": 1, "s": -2, "A": -1}, True),
    "gauss": (1e-4, {"kg": 1, "s": -2, "A": -1}, True),
    "count": (1.0, {"count": 1}, False),
    "LSB": (1.0, {"count": 1}, False),
    "%": (1e-2, {}, False),
    "ppm": (1e-6, {}, False),
}
"""By name: factor to SI, exponents of `BASE_UNITS`, whether it takes prefixes."""

TYPED_SIGNS = (
    ("\N{DEGREE SIGN}C", "degC"),
    ("\N{DEGREE SIGN} C", "degC"),
    ("degrees Celsius", "degC"),
    ("degrees C", "degC"),
    ("deg C", "degC"),
    ("\N{DEGREE SIGN}", "deg"),
    ("\N{MICRO SIGN}", "u"),
    ("\N{GREEK SMALL LETTER MU}", "u"),
    ("\N{OHM SIGN}", "ohm"),
    ("\N{GREEK CAPITAL LETTER OMEGA}", "ohm"),
    ("\N{SUPERSCRIPT MINUS}\N{SUPERSCRIPT ONE}", "^-1"),
    ("\N{SUPERSCRIPT MINUS}\N{SUPERSCRIPT TWO}", "^-2"),
    ("\N{SUPERSCRIPT TWO}", "^2"),
    ("\N{SUPERSCRIPT THREE}", "^3"),
    ("\N{MIDDLE DOT}", "*"),
)
"""A sign as people type it, and its letters; the degree of temperature before that of angle."""

SI_NAMES = {
    "kg/s^2/A": "T",
    "m*kg/s^2": "N",
    "kg/m/s^2": "Pa",
    "m^2*kg/s^2": "N m",
    "m^2*kg/s^3/A": "V",
}
"""The usual name of a product of base units."""
