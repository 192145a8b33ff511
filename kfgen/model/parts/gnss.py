"""GNSS: the antenna away from the IMU by a lever arm, its solution late by a delay.

Both are effects (`kfgen.effects.inertial`), attached by the options ``lever_arm`` and ``delay`` or by a file: the antenna is
at ``p + R_nb l``, and what arrives was valid a delay ``td`` ago, taken back by first order along the motion,
``p_a(t - td) = p_a - td v_a``, ``v_a(t - td) = v_a - td a_a``.

References
----------
.. [1] P. D. Groves, Principles of GNSS, Inertial, and Multisensor Integrated Navigation
   Systems, 2nd ed., 2013, eqs (14.81), (14.82), (14.121).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import sympy as sp

from kfgen.effects import make
from kfgen.effects.filter_role import AntennaOffset, ReadingLag, Use
from kfgen.model.option import NOTHING, Option, OrState, Quantity
from kfgen.model.parts.attached_error import attached, unknown_state
from kfgen.model.parts.motion import NED
from kfgen.model.parts.sensor import Sensor, Views, triad, unknown

LEVER_ARM = Option(
    "lever_arm", "from IMU to antenna in body axes: known, or states", OrState(Quantity("m", 3)), "0 0 0 m"
)
DELAY = Option("delay", "age of the GNSS solution: known, or a state", OrState(Quantity("s")), "0 s")
ARM_SD_M = 1.0
"""Standard deviation of an unknown lever arm before the log [m]."""
DELAY_SD_S = 0.2
"""Standard deviation of an unknown age of a solution before the log [s]."""


class Antenna(Sensor):
    """What GNSS sensors share: where the antenna is, and how old its solution."""

    options = (LEVER_ARM, DELAY)
    usual_rate = 5.0

    def __init__(self, chosen: Mapping[str, Any] = NOTHING, axes: tuple[str, ...] = NED) -> None:
        super().__init__(chosen, axes)
        found, arm, delay = [], self.chosen["lever_arm"], self.chosen["delay"]
        free_arm, free_delay = unknown("lever_arm", self), unknown("delay", self)
        if free_arm or any(arm):
            effect = make("lever_arm", **dict(zip("xyz", (0.0, 0.0, 0.0) if free_arm else arm)))
            use = unknown_state(ARM_SD_M, "xyz") if free_arm else Use()
            found.append(attached("gnss", effect, "m", use, "xyz", AntennaOffset()))
        if free_delay or delay != 0.0:
            effect = make("time_delay", delay=0.0 if free_delay else delay)
            use = unknown_state(DELAY_SD_S, ("delay",)) if free_delay else Use()
            found.append(attached("gnss", effect, "s", use, ("delay",), ReadingLag()))
        self.errors = tuple(found)


class GnssPosition(Antenna):
    """GNSS position in the navigation frame."""

    name = "gnss_position"
    title = "GNSS position"
    unit = "m"
    sd = 1.5
    shows = "p"
    needs = ("p",)
    rate_needs = ("v",)
    arm_order = 0

    @property
    def channels(self) -> tuple[str, ...]:  # type: ignore[override]
        """By navigation axes."""
        return triad("gnss_p", self.axes)

    def predict(self, x: Views) -> sp.Matrix:
        """The position."""
        return x["p"]

    def rate(self, x: Views) -> sp.Matrix:
        """The velocity."""
        return x["v"]


class GnssVelocity(Antenna):
    """GNSS velocity in the navigation frame."""

    name = "gnss_velocity"
    title = "GNSS velocity"
    unit = "m/s"
    sd = 0.1
    shows = "v"
    needs = ("v",)
    rate_needs = ("acceleration",)
    arm_order = 1

    @property
    def channels(self) -> tuple[str, ...]:  # type: ignore[override]
        """By navigation axes."""
        return triad("gnss_v", self.axes)

    def predict(self, x: Views) -> sp.Matrix:
        """The velocity."""
        return x["v"]

    def rate(self, x: Views) -> sp.Matrix:
        """The acceleration."""
        return x["acceleration"]
