"""Sensors: each is one ``predict(x)``; Jacobian, simulator, residual and code follow from it.

To add a sensor, write one class here; `sensors` finds it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import sympy as sp

from kfgen.model.motion import GRAVITY, Constant

FIELD = (
    Constant("mag_N", "T", 20e-6, "magnetic field, north (horizontal) component"),
    Constant("mag_D", "T", 44e-6, "magnetic field, down component"),
)


class Sensor:
    """What a sensor declares.

    Attributes
    ----------
    name, title, unit : str
        ``unit`` is SI.
    channels : tuple of str
        Channels of the log, one a row.
    sd : float
        Noise of each sample where no noise file says otherwise [SI].
    left_out : float
        What the model leaves out (a body that accelerates, a field that bends), as a density
        [SI/sqrt(Hz)]: it is slow against the samples, so it must not be averaged away faster at a
        higher rate. The filter adds it, the simulation does not.
    needs : tuple of str
        State blocks that it looks at.
    """

    name: ClassVar[str] = ""
    title: ClassVar[str] = ""
    unit: str = ""
    channels: tuple[str, ...] = ()
    sd: float = 0.0
    left_out: float = 0.0
    needs: ClassVar[tuple[str, ...]] = ()
    constants: ClassVar[tuple[Constant, ...]] = ()

    def predict(self, x: Mapping[str, sp.Matrix]) -> sp.Matrix:
        """The expected measurement, shape (m, 1), from the blocks (``R_nb`` for an attitude)."""
        raise NotImplementedError


def _triad(name: str, axes: str = "xyz") -> tuple[str, ...]:
    return tuple(f"{name}_{a}" for a in axes)


class GravityDirection(Sensor):
    """An accelerometer triad of a body that does not accelerate: ``f_b = -R_bn g_n``."""

    name = "accel"
    title = "gravity seen by the accelerometers"
    unit = "m/s^2"
    channels = _triad("accel")
    sd = 0.02
    left_out = 0.05
    needs = ("phi",)
    constants = (GRAVITY,)

    def predict(self, x: Mapping[str, sp.Matrix]) -> sp.Matrix:
        """Specific force of a body at rest."""
        return x["phi"].T * sp.Matrix([0, 0, -GRAVITY.symbol])


class MagneticField(Sensor):
    """A magnetometer triad in a known field: ``m_b = R_bn m_n``, north being magnetic north."""

    name = "mag"
    title = "magnetic field vector"
    unit = "T"
    channels = _triad("mag")
    sd = 2e-7
    left_out = 5e-7
    needs = ("phi",)
    constants = FIELD

    def predict(self, x: Mapping[str, sp.Matrix]) -> sp.Matrix:
        """The field in body axes."""
        return x["phi"].T * sp.Matrix([FIELD[0].symbol, 0, FIELD[1].symbol])


class GnssPosition(Sensor):
    """GNSS position in the local level frame."""

    name = "gnss_position"
    title = "GNSS position"
    unit = "m"
    channels = _triad("gnss_p", "NED")
    sd = 1.5
    needs = ("p",)

    def predict(self, x: Mapping[str, sp.Matrix]) -> sp.Matrix:
        """``p_n``."""
        return x["p"]


class GnssVelocity(Sensor):
    """GNSS velocity in the local level frame."""

    name = "gnss_velocity"
    title = "GNSS velocity"
    unit = "m/s"
    channels = _triad("gnss_v", "NED")
    sd = 0.1
    needs = ("v",)

    def predict(self, x: Mapping[str, sp.Matrix]) -> sp.Matrix:
        """``v_n``."""
        return x["v"]


@dataclass(frozen=True)
class AtRest(Sensor):
    """One channel of a sensor at rest: it shows the sum of its effects and nothing else."""

    name = "rest"
    title = "one axis at rest"

    channel: str = "gyro_x"
    unit: str = "rad/s"

    @property
    def channels(self) -> tuple[str, ...]:  # type: ignore[override]
        """The one channel."""
        return (self.channel,)

    def predict(self, x: Mapping[str, sp.Matrix]) -> sp.Matrix:
        """Zero: nothing moves."""
        return sp.zeros(1, 1)


def sensors() -> dict[str, type[Sensor]]:
    """Every declared sensor by its name."""
    return {cls.name: cls for cls in Sensor.__subclasses__() if cls.name}
