"""GNSS: the antenna away from the IMU by a lever arm, its solution late by a delay.

The antenna is at ``p + R_nb l``; what arrives was valid a delay ``td`` ago, taken back by first order along the
motion: ``p_a(t - td) = p_a - td v_a``, ``v_a(t - td) = v_a - td a_a``.

References
----------
.. [1] P. D. Groves, Principles of GNSS, Inertial, and Multisensor Integrated Navigation
   Systems, 2nd ed., 2013, eqs (14.81), (14.82), (14.121).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import sympy as sp

from kfgen.model.option import NOTHING, Option, OrState, Quantity
from kfgen.model.parts.motion import NED, Constant
from kfgen.model.parts.sensor import Sensor, Views, triad, unknown
from kfgen.model.symbols.blocks import Vector

LEVER_ARM = Option(
    "lever_arm", "from IMU to antenna in body axes: known, or states", OrState(Quantity("m", 3)), "0 0 0 m"
)
DELAY = Option("delay", "age of the GNSS solution: known, or a state", OrState(Quantity("s")), "0 s")


class Antenna(Sensor):
    """What GNSS sensors share: the point of the antenna, and when."""

    options = (LEVER_ARM, DELAY)
    usual_rate = 5.0

    def __init__(self, chosen: Mapping[str, Any] = NOTHING, axes: tuple[str, ...] = NED) -> None:
        super().__init__(chosen, axes)
        arm, delay = self.chosen["lever_arm"], self.chosen["delay"]
        blocks, constants = [], []
        self.offset = unknown("lever_arm", self) or any(arm)
        self.late = unknown("delay", self) or delay != 0.0
        if unknown("lever_arm", self):
            blocks.append(Vector("l", ("x", "y", "z"), "m", "GNSS lever arm", 1.0))
        elif self.offset:
            constants += [
                Constant(f"l_{a}", "m", v, f"GNSS lever arm, {a}") for a, v in zip("xyz", arm, strict=True)
            ]
        if unknown("delay", self):
            blocks.append(Vector("td", ("",), "s", "GNSS delay", 0.2))
        elif self.late:
            constants.append(Constant("td", "s", delay, "GNSS delay"))
        self.blocks, self.constants = tuple(blocks), tuple(constants)

    def arm(self, x: Views) -> sp.Matrix:
        """The lever arm in body axes [m], shape (3, 1)."""
        if unknown("lever_arm", self):
            return x["l"]
        return sp.Matrix([c.symbol for c in self.constants[:3]])

    def delay(self, x: Views) -> sp.Expr:
        """The age [s]."""
        return x["td"][0] if unknown("delay", self) else self.constants[-1].symbol

    def position(self, x: Views) -> sp.Matrix:
        """Of the antenna now, shape (3, 1) [m]."""
        return x["p"] + x["phi"] * self.arm(x) if self.offset else x["p"]

    def velocity(self, x: Views) -> sp.Matrix:
        """Of the antenna now, shape (3, 1) [m/s]."""
        return x["v"] + x["phi"] * x["omega"].cross(self.arm(x)) if self.offset else x["v"]

    def acceleration(self, x: Views) -> sp.Matrix:
        """Of the antenna now at a steady rate of turn, shape (3, 1) [m/s^2]."""
        if not self.offset:
            return x["acceleration"]
        inward = x["omega"].cross(x["omega"].cross(self.arm(x)))
        return x["acceleration"] + x["phi"] * inward


class GnssPosition(Antenna):
    """GNSS position in the navigation frame."""

    name = "gnss_position"
    title = "GNSS position"
    unit = "m"
    sd = 1.5
    shows = "p"

    @property
    def channels(self) -> tuple[str, ...]:  # type: ignore[override]
        """By navigation axes."""
        return triad("gnss_p", self.axes)

    @property
    def needs(self) -> tuple[str, ...]:  # type: ignore[override]
        """Position; attitude with a lever arm, velocity with a delay."""
        turned = ("phi", *(("omega",) if self.late else ())) if self.offset else ()
        return ("p", *turned, *(("v",) if self.late else ()))

    def predict(self, x: Views) -> sp.Matrix:
        """``p_a - td v_a``."""
        p = self.position(x)
        return p - self.velocity(x) * self.delay(x) if self.late else p


class GnssVelocity(Antenna):
    """GNSS velocity in the navigation frame."""

    name = "gnss_velocity"
    title = "GNSS velocity"
    unit = "m/s"
    sd = 0.1
    shows = "v"

    @property
    def channels(self) -> tuple[str, ...]:  # type: ignore[override]
        """By navigation axes."""
        return triad("gnss_v", self.axes)

    @property
    def needs(self) -> tuple[str, ...]:  # type: ignore[override]
        """Velocity; attitude and rate with a lever arm, acceleration with a delay."""
        more = (("phi", "omega") if self.offset else ()) + (("acceleration",) if self.late else ())
        return ("v", *more)

    def predict(self, x: Views) -> sp.Matrix:
        """``v_a - td a_a``."""
        v = self.velocity(x)
        return v - self.acceleration(x) * self.delay(x) if self.late else v
