"""Sensors: each is one ``predict(x)``; Jacobian, simulator, residual and code follow from it.

To add a sensor, write one class in this file, or in a file that this one imports; `sensors` finds it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import sympy as sp
from numpy.typing import NDArray

from kfgen.core.optional_library import modules_of_others
from kfgen.effects import make
from kfgen.effects.filter_role import ReadingLag, Use
from kfgen.model.option import NOTHING, STATE, Choice, Option, OrState, Quantity, YesNo
from kfgen.model.parts.aiding import Airspeed, Barometer, NonHolonomic, Odometer, ZeroVelocity
from kfgen.model.parts.attached_error import AttachedError, attached, unknown_state
from kfgen.model.parts.bearing import BeaconRange, Heading, LandmarkBearing
from kfgen.model.parts.bounded_velocity import ACCELERATION, BOUNDED
from kfgen.model.parts.constant import Constant
from kfgen.model.parts.gnss import GnssPosition, GnssVelocity
from kfgen.model.parts.motion import GRAVITY, LEFT_OUT, NED
from kfgen.model.parts.sensor import Array, Sensor, Views, triad, unknown
from kfgen.model.symbols.blocks import Vector

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


VIBRATION = 0.02
"""Beside a bounded velocity accelerometers show vibration and its rectification [m/s^2/sqrt(Hz)]: 0.2 m/s^2 over 100 Hz."""


class GravityDirection(Sensor):
    """An accelerometer triad: ``f_b = R_bn (a_n - g_n)``, the acceleration being a state or left out."""

    name = "accel"
    title = "gravity seen by the accelerometers"
    unit = "m/s^2"
    channels = triad("accel")
    sd = 0.02
    left_out = 0.05
    min_length = 1.0
    needs: tuple[str, ...] = ("phi", "level")
    constants = (GRAVITY,)
    options = (LEFT_OUT, ACCELERATION)
    at_rest = "up"

    def __init__(self, chosen: Mapping[str, Any] = NOTHING, axes: tuple[str, ...] = NED) -> None:
        super().__init__(chosen, axes)
        if self.chosen["acceleration"] == BOUNDED:
            self.needs = ("phi", "level", "acceleration")
            self.left_out = min(self.left_out, VIBRATION)

    def predict(self, x: Views) -> sp.Matrix:
        """Specific force."""
        f_n = x["level"].T * sp.Matrix([0, 0, -GRAVITY.symbol])
        return x["phi"].T * (f_n + x["acceleration"] if "acceleration" in self.needs else f_n)


FIELD_PRIOR = 1e-5
"""How well the components of the field are known before a log [T]."""
A_SAMPLE_S = 0.01
"""How old a sample may be [s]: magnetometers convert some hundred times a second and are read between."""
SOFT_IRON_SD = 0.1
"""Standard deviation of the entries of soft iron before a log."""
SYMMETRIC = ("xx", "yy", "zz", "xy", "xz", "yz")
MIRRORED = {"yx": "xy", "zx": "xz", "zy": "yz"}
"""Entries of a symmetric matrix, and those that equal others."""


class MagneticField(Sensor):
    """A magnetometer triad: ``m_b = R_bn m_n``, north being magnetic north; iron and delay are attached effects."""

    name = "mag"
    title = "magnetic field vector"
    unit = "T"
    channels = triad("mag")
    sd = 2e-7
    usual_rate = 50.0
    bias_prior = 2e-5
    K = 1e-9  # magnetisation ages, and currents change: PX4's EKF2_MAG_B_NOISE, 1e-4 G/s in steps of 8 ms
    min_length = 5e-6
    needs: tuple[str, ...] = ("phi", "level")
    at_rest = "north"
    rate_needs = ("omega",)
    options = (
        LEFT_OUT,
        Option(
            "field_left_out",
            "how a room bends the field beyond what the model says, as a density",
            Quantity("T/sqrt(Hz)"),
            "0.5 uT/sqrt(Hz)",
        ),
        Option("hard_iron", "a constant field of the body as states", YesNo(), "false"),
        Option("hard_iron_sd", "standard deviation of that field before the log", Quantity("T"), "2e-5 T"),
        Option(
            "mag_delay",
            "age of the magnetometer's samples against those of the gyros: known, or a state",
            OrState(Quantity("s")),
            "0 s",
        ),
        Option("soft_iron", "distortion of the field by the body as six states", YesNo(), "false"),
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
        self.left_out = self.chosen["field_left_out"] if self.chosen["left_out"] else 0.0
        self.biases, self.bias_prior = self.chosen["hard_iron"], self.chosen["hard_iron_sd"]
        blocks, known = [], {c.name[-1]: c.value for c in FIELD}
        self.field = {"known": (), STATE: ("N", "D"), "vector": NED}[self.chosen["field"]]
        if self.field:
            start = tuple(known.get(a, 0.0) for a in self.field)
            blocks.append(Vector("mag", self.field, "T", "magnetic field", FIELD_PRIOR, start))
        self.blocks, self.constants = tuple(blocks), () if self.field else FIELD
        self.errors = tuple(self._attached())

    def _attached(self) -> Iterator[AttachedError]:
        """Soft iron, symmetric, and the delay, as the options say."""
        if self.chosen["soft_iron"]:
            entries = (*SYMMETRIC, *MIRRORED)
            iron = attached(
                "mag", make("soft_iron"), self.unit, unknown_state(SOFT_IRON_SD, entries), entries
            )
            yield replace(
                iron,
                parameters=tuple(replace(p, axis=MIRRORED.get(p.parameter, p.axis)) for p in iron.parameters),
            )
        delay, free = self.chosen["mag_delay"], unknown("mag_delay", self)
        if free or delay != 0.0:
            effect = make("time_delay", delay=0.0 if free else delay)
            use = unknown_state(A_SAMPLE_S, ("delay",)) if free else Use()
            yield attached("mag", effect, "s", use, ("delay",), ReadingLag())

    def predict(self, x: Views) -> sp.Matrix:
        """The field in body axes."""
        part = dict(zip(self.field, x["mag"])) if self.field else {c.name[-1]: c.symbol for c in FIELD}
        m_l = sp.Matrix([part.get(a, 0) for a in NED])
        m_b = x["phi"].T * (x["level"].T * m_l)
        return m_b

    def rate(self, x: Views) -> sp.Matrix:
        """``-omega x m_b``: a field that is constant in space."""
        return -x["omega"].cross(self.predict(x))

    def plausible(self, z: Array, known: Mapping[str, float]) -> NDArray[np.bool_]:
        """Those whose magnitude is the field's, within the gate."""
        gate = self.chosen["field_gate"]
        if gate <= 0.0:
            return super().plausible(z, known)
        field = np.sqrt(sum(known.get(f"mag_{a}", 0.0) ** 2 for a in NED))
        return np.asarray(np.abs(np.linalg.norm(z, axis=1) - field) <= gate * field)

    def gated_length(self) -> tuple[sp.Expr, float]:
        """That of the field, known or a state, and the gate."""
        known = [sp.Symbol(f"mag_{a}", real=True) for a in self.field] or [c.symbol for c in FIELD]
        return sp.Add(*(m**2 for m in known)), float(self.chosen["field_gate"])

    def calibrated(self, z_b: tuple[float, ...], up_b: tuple[float, ...]) -> dict[str, float]:
        """The components of the field; those that are known stay where more iron of the body may add to them."""
        if self.biases and not self.field and self.bias_prior >= FIELD_PRIOR:
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
    """Every declared sensor by its name, those of other packages with them."""
    modules_of_others("sensors")
    found: dict[str, type[Sensor]] = {}
    queue = list(Sensor.__subclasses__())
    while queue:
        cls = queue.pop(0)
        queue.extend(cls.__subclasses__())
        if cls.name:
            found[cls.name] = cls
    return found
