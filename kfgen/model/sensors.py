"""Sensors: each is one ``predict(x)``; Jacobian, simulator, residual and code follow from it.

To add a sensor, write one class in this file, or in a file that this one imports; `sensors` finds it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import sympy as sp
from numpy.typing import NDArray

from kfgen.model.aiding import Airspeed, Barometer, NonHolonomic, Odometer, ZeroVelocity
from kfgen.model.bearing import BeaconRange, Heading, LandmarkBearing
from kfgen.model.blocks import Vector
from kfgen.model.gnss import GnssPosition, GnssVelocity
from kfgen.model.motion import GRAVITY, LEFT_OUT, NED, Constant
from kfgen.model.option import NOTHING, STATE, Choice, Flag, Option, Quantity
from kfgen.model.sensor import Array, Sensor, Views, triad

__all__ = [
    "FIELD",
    "Airspeed",
    "AtRest",
    "Barometer",
    "BeaconRange",
    "GnssPosition",
    "GnssVelocity",
    "GravityDirection",
    "Heading",
    "LandmarkBearing",
    "MagneticField",
    "NonHolonomic",
    "Odometer",
    "Sensor",
    "ZeroVelocity",
    "sensors",
]

FIELD = (
    Constant("mag_N", "T", 20e-6, "magnetic field, north (horizontal) component"),
    Constant("mag_D", "T", 44e-6, "magnetic field, down component"),
)


class GravityDirection(Sensor):
    """An accelerometer triad of a body that does not accelerate: ``f_b = -R_bn g_n``."""

    name = "accel"
    title = "gravity seen by the accelerometers"
    unit = "m/s^2"
    channels = triad("accel")
    sd = 0.02
    left_out = 0.05
    needs = ("phi", "level")
    constants = (GRAVITY,)
    options = (LEFT_OUT,)
    at_rest = "up"

    def predict(self, x: Views) -> sp.Matrix:
        """Specific force of a body at rest."""
        return x["phi"].T * (x["level"].T * sp.Matrix([0, 0, -GRAVITY.symbol]))


class MagneticField(Sensor):
    """A magnetometer triad: ``m_b = (I + S) R_bn m_n + hard iron``, north being magnetic north."""

    name = "mag"
    title = "magnetic field vector"
    unit = "T"
    channels = triad("mag")
    sd = 2e-7
    left_out = 5e-7
    bias_prior = 2e-5
    needs = ("phi", "level")
    at_rest = "north"
    options = (
        LEFT_OUT,
        Option("hard_iron", "a constant field of the body as states", Flag(), "false"),
        Option("soft_iron", "distortion of the field by the body as six states", Flag(), "false"),
        Option(
            "field",
            "the Earth's field: known, its components north (magnetic) and down as states, or all three",
            Choice(("known", STATE, "vector")),
            "known",
        ),
        Option(
            "field_gate",
            "samples of a log whose magnitude differs by more than this share from the field are not used; 0 uses all",
            Quantity("1"),
            "0",
        ),
    )

    def __init__(self, chosen: Mapping[str, Any] = NOTHING, axes: tuple[str, ...] = NED) -> None:
        super().__init__(chosen, axes)
        self.biases = self.chosen["hard_iron"]
        blocks, known = [], {c.name[-1]: c.value for c in FIELD}
        self.field = {"known": (), STATE: ("N", "D"), "vector": NED}[self.chosen["field"]]
        if self.field:
            start = tuple(known.get(a, 0.0) for a in self.field)
            blocks.append(Vector("mag", self.field, "T", "magnetic field", 1e-5, start))
        if self.chosen["soft_iron"]:
            blocks.append(Vector("si", ("xx", "yy", "zz", "xy", "xz", "yz"), "1", "soft iron", 0.1))
        self.blocks = tuple(blocks)
        self.constants = () if self.field else FIELD

    def predict(self, x: Views) -> sp.Matrix:
        """The field in body axes."""
        part = dict(zip(self.field, x["mag"])) if self.field else {c.name[-1]: c.symbol for c in FIELD}
        m_l = sp.Matrix([part.get(a, 0) for a in NED])
        m_b = x["phi"].T * (x["level"].T * m_l)
        if not self.chosen["soft_iron"]:
            return m_b
        xx, yy, zz, xy, xz, yz = x["si"]
        return m_b + sp.Matrix([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) * m_b

    def plausible(self, z: Array, known: Mapping[str, float]) -> NDArray[np.bool_]:
        """Those whose magnitude is the field's, within the gate."""
        gate = self.chosen["field_gate"]
        if gate <= 0.0:
            return super().plausible(z, known)
        field = np.sqrt(sum(known.get(f"mag_{a}", 0.0) ** 2 for a in NED))
        return np.asarray(np.abs(np.linalg.norm(z, axis=1) - field) <= gate * field)

    def handling(self) -> tuple[str, ...]:
        """The gate on the magnitude."""
        gate = self.chosen["field_gate"]
        said = f"Leave out samples of {self.name} whose length differs by more than {gate:.3g} of the field's from it."
        return (said,) if gate > 0.0 else ()

    def calibrated(self, z_b: tuple[float, ...], up_b: tuple[float, ...]) -> dict[str, float]:
        """The components of the field; those that are known stay where iron of the body adds to them."""
        if self.biases and not self.field:
            return {}
        down = -sum(z * u for z, u in zip(z_b, up_b))
        size2 = sum(z * z for z in z_b)
        return {"mag_N": max(size2 - down * down, 0.0) ** 0.5, "mag_D": down}


@dataclass(frozen=True)
class AtRest(Sensor):
    """One channel of a sensor at rest: it shows the sum of its effects and nothing else."""

    title = "one axis at rest"

    channel: str = "gyro_x"
    unit: str = "rad/s"
    name: str = "rest"  # type: ignore[misc]

    @property
    def channels(self) -> tuple[str, ...]:  # type: ignore[override]
        """The one channel."""
        return (self.channel,)

    def predict(self, x: Views) -> sp.Matrix:
        """Zero: nothing moves."""
        return sp.zeros(1, 1)


def sensors() -> dict[str, type[Sensor]]:
    """Every declared sensor by its name."""
    found: dict[str, type[Sensor]] = {}
    queue = list(Sensor.__subclasses__())
    while queue:
        cls = queue.pop(0)
        queue.extend(cls.__subclasses__())
        if cls.name:
            found[cls.name] = cls
    return found
