"""Angles and distances: heading of two antennas, range to a beacon, bearing of a landmark.

References
----------
.. [1] P. D. Groves, Principles of GNSS, Inertial, and Multisensor Integrated Navigation
   Systems, 2nd ed., 2013, sec. 10.2 (attitude from several antennas), 11.1 (ranges and bearings).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import sympy as sp

from kfgen.core.errors import InputError
from kfgen.model.option import NOTHING, Option, Quantity
from kfgen.model.parts.constant import Constant
from kfgen.model.parts.motion import NED
from kfgen.model.parts.sensor import Sensor, Views


class Heading(Sensor):
    """Heading of the line between two antennas from north, clockwise."""

    name = "heading"
    title = "heading of two antennas"
    unit = "rad"
    channels = ("heading",)
    has_vehicle_axes = True
    sd = 5e-3
    needs = ("phi", "level")
    period = 2.0 * math.pi
    options = (
        Option("baseline", "from the first to the second antenna in body axes", Quantity("m", 3), "1 0 0 m"),
    )

    def __init__(self, chosen: Mapping[str, Any] = NOTHING, axes: tuple[str, ...] = NED) -> None:
        super().__init__(chosen, axes)
        size = math.hypot(*self.chosen["baseline"])
        if size == 0.0:
            raise InputError("the baseline has no length", where="--set baseline")
        self.direction = sp.Matrix([_exact(c / size) for c in self.chosen["baseline"]])

    def predict(self, x: Views) -> sp.Matrix:
        """``atan2(east, north)``."""
        b_l = x["level"] * (x["phi"] * self.direction)
        return sp.Matrix([sp.atan2(b_l[1], b_l[0])])


def _exact(share: float) -> sp.Expr:
    """A direction's component; whole numbers as such, so that they leave no trace."""
    return sp.Integer(int(share)) if share == int(share) else sp.Float(share)


class Mark(Sensor):
    """A point whose place in the navigation frame is known."""

    point: str = ""
    needs: tuple[str, ...] = ("p",)

    def __init__(self, chosen: Mapping[str, Any] = NOTHING, axes: tuple[str, ...] = NED) -> None:
        super().__init__(chosen, axes)
        values = zip(axes, self.chosen[self.point], strict=True)
        self.constants = tuple(
            Constant(f"{self.point}_{a}", "m", v, f"place of the {self.point}, {a}") for a, v in values
        )

    def away(self, x: Views) -> sp.Matrix:
        """From the body to the point, shape (3, 1) [m]."""
        return sp.Matrix([c.symbol for c in self.constants]) - x["p"]


class BeaconRange(Mark):
    """Distance to a beacon."""

    name = "beacon_range"
    title = "range to a beacon"
    unit = "m"
    channels = ("beacon",)
    sd = 0.2
    point = "beacon"
    options = (
        Option("beacon", "place of the beacon in the navigation frame", Quantity("m", 3), "100 50 -10 m"),
    )

    def predict(self, x: Views) -> sp.Matrix:
        """The length."""
        d = self.away(x)
        return sp.Matrix([sp.sqrt(d.dot(d))])


class LandmarkBearing(Mark):
    """Azimuth (from forward, to the right) and elevation of a landmark, seen from the body."""

    name = "landmark_bearing"
    title = "azimuth and elevation of a landmark in body axes"
    unit = "rad"
    channels = ("landmark_azimuth", "landmark_elevation")
    has_vehicle_axes = True
    sd = 5e-3
    needs = ("p", "phi")
    period = 2.0 * math.pi
    point = "landmark"
    options = (
        Option("landmark", "place of the landmark in the navigation frame", Quantity("m", 3), "50 -30 -5 m"),
    )

    def predict(self, x: Views) -> sp.Matrix:
        """``atan2(d_y, d_x)`` and ``atan2(-d_z, sqrt(d_x^2 + d_y^2))``."""
        d = x["phi"].T * self.away(x)
        return sp.Matrix([sp.atan2(d[1], d[0]), sp.atan2(-d[2], sp.sqrt(d[0] ** 2 + d[1] ** 2))])
