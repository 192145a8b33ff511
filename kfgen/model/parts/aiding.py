"""Aiding of a strapdown by height, by wheels, and by what cannot happen.

References
----------
.. [1] G. Dissanayake, S. Sukkarieh, E. Nebot, H. Durrant-Whyte, The aiding of a low-cost strapdown inertial
   measurement unit using vehicle model constraints, IEEE Trans. Robotics and Automation 17(5), 2001.
.. [2] P. D. Groves, Principles of GNSS, Inertial, and Multisensor Integrated Navigation
   Systems, 2nd ed., 2013, sec. 15.1, 15.3 (zero velocity, odometer).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

import sympy as sp

from kfgen.model.option import NOTHING, Option, Quantity, YesNo
from kfgen.model.parts.constant import Constant
from kfgen.model.parts.motion import LEFT_OUT, NED
from kfgen.model.parts.sensor import Sensor, Views, triad
from kfgen.model.symbols.blocks import Vector


class Barometer(Sensor):
    """Height above the origin, from a barometer; its drift is an effect of its channel."""

    name = "barometer"
    title = "height from a barometer"
    unit = "m"
    channels = ("baro",)
    sd = 0.3
    usual_rate = 20.0
    needs = ("height",)
    biases = True
    bias_prior = 10.0
    K = 0.02  # the pressure at a place changes by a metre in an hour

    rate_needs = ("v", "level")

    def predict(self, x: Views) -> sp.Matrix:
        """The height."""
        return x["height"]

    def rate(self, x: Views) -> sp.Matrix:
        """The velocity upwards."""
        return sp.Matrix([-(x["level"] * x["v"])[2]])


class ZeroVelocity(Sensor):
    """A body at rest: zeros where it is, nothing elsewhere."""

    name = "zero_velocity"
    title = "zero velocity at rest"
    unit = "m/s"
    channels = triad("zero_v")
    is_constraint = True
    sd = 0.02
    needs = ("v", "phi")

    def predict(self, x: Views) -> sp.Matrix:
        """Velocity in body axes."""
        return x["phi"].T * x["v"]


class Wheeled(Sensor):
    """A point of a vehicle whose motion wheels constrain."""

    has_vehicle_axes = True
    options: ClassVar[tuple[Option, ...]] = (
        Option("axle_arm", "from IMU to the rear axle in body axes", Quantity("m", 3), "0 0 0 m"),
    )

    def __init__(self, chosen: Mapping[str, Any] = NOTHING, axes: tuple[str, ...] = NED) -> None:
        super().__init__(chosen, axes)
        arm = self.chosen["axle_arm"]
        words = "arm from IMU to rear axle"
        self.constants = (
            tuple(Constant(f"axle_{a}", "m", v, f"{words}, {a}") for a, v in zip("xyz", arm, strict=True))
            if any(arm)
            else ()
        )

    @property
    def needs(self) -> tuple[str, ...]:  # type: ignore[override]
        """Velocity and attitude; the rate with an arm."""
        return ("v", "phi", *(("omega",) if self.constants else ()))

    def axle_velocity(self, x: Views) -> sp.Matrix:
        """Of the axle in body axes [m/s], shape (3, 1)."""
        v_b = x["phi"].T * x["v"]
        if not self.constants:
            return v_b
        return v_b + x["omega"].cross(sp.Matrix([c.symbol for c in self.constants]))


class NonHolonomic(Wheeled):
    """A vehicle does not slide sideways and does not lift off [1]_: zeros where that holds."""

    name = "non_holonomic"
    title = "no sideways and no vertical speed of the rear axle"
    unit = "m/s"
    channels = triad("nhc", "yz")
    is_constraint = True
    sd = 0.1
    left_out = 0.05
    options = (*Wheeled.options, LEFT_OUT)

    def predict(self, x: Views) -> sp.Matrix:
        """The two components across."""
        return sp.Matrix(self.axle_velocity(x)[1:])


class Odometer(Wheeled):
    """Forward speed of the rear axle from its wheels."""

    name = "odometer"
    title = "forward speed from wheels"
    unit = "m/s"
    channels = ("odometer",)
    sd = 0.05
    options = (
        *Wheeled.options,
        Option("wheel_scale", "scale factor of the odometer as a state", YesNo(), "false"),
    )

    def __init__(self, chosen: Mapping[str, Any] = NOTHING, axes: tuple[str, ...] = NED) -> None:
        super().__init__(chosen, axes)
        if self.chosen["wheel_scale"]:
            self.blocks = (Vector("so", ("",), "1", "odometer scale factor", 0.03),)

    def predict(self, x: Views) -> sp.Matrix:
        """``(1 + s) v_x``."""
        forward = sp.Matrix([self.axle_velocity(x)[0]])
        return forward * (1 + x["so"][0]) if self.blocks else forward


class Airspeed(Sensor):
    """The speed through the air: ``|v - w|``, the horizontal wind being states."""

    name = "airspeed"
    title = "true airspeed, with the wind as states"
    unit = "m/s"
    channels = ("airspeed",)
    sd = 0.5
    left_out = 0.5
    options = (LEFT_OUT,)
    needs = ("v", "level")
    blocks = (Vector("w", ("N", "E"), "m/s", "wind", 3.0),)

    def predict(self, x: Views) -> sp.Matrix:
        """The length of velocity less wind; at least a little, where its slope would have no meaning."""
        away = x["level"] * x["v"] - sp.Matrix([*x["w"], 0])
        return sp.Matrix([sp.sqrt(away.dot(away) + LEAST_SPEED_M_PER_S**2)])

    rate_needs = ("v", "level", "acceleration")

    def rate(self, x: Views) -> sp.Matrix:
        """The acceleration along the airspeed."""
        away = x["level"] * x["v"] - sp.Matrix([*x["w"], 0])
        return sp.Matrix([away.dot(x["level"] * x["acceleration"]) / self.predict(x)[0]])


LEAST_SPEED_M_PER_S = 0.1
"""Airspeed at least: below, its slope would have no meaning."""
