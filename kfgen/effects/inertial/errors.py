"""Errors of inertial triads: proportional to what they should have read, to forces, to rates.

References
----------
.. [1] P. G. Savage, Strapdown inertial navigation integration algorithm design, part 2, J. Guidance,
   Control, and Dynamics 21(2), 1998, sec. on inertial component errors.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from kfgen.core.channel_names import AXES
from kfgen.core.wgs84 import EARTH_RATE
from kfgen.effects.effect import parameter
from kfgen.effects.filter_role import AntennaOffset, FilterPlace, FilterRole, NotModelled
from kfgen.effects.inertial.felt import Felt, Signals
from kfgen.effects.inertial.inertial_error import InertialError, arm_rate, row_of

Array = NDArray[np.float64]

PRODUCTS = ("xx", "yy", "zz", "xy", "yz", "zx")
"""Pairs of axes whose products of the specific force a rate sensor may feel."""
BEYOND_LINEAR_NATS = 2.0
"""By which what is not linear is rarer: of sensors made today the linear term is the larger one, one in seven else."""
MAX_EARTH_RATE_RATIO = 2.0
"""Of a rate that noise may make the Earth's."""


def products(f_b: Array) -> dict[str, Array]:
    """Products of two axes of a triad, shape (n, 3), by the entries of `GSquared`."""
    return {p: f_b[:, AXES.index(p[0])] * f_b[:, AXES.index(p[1])] for p in PRODUCTS}


@dataclass(frozen=True)
class ScaleFactor(InertialError):
    """``y = (1 + s) u``."""

    coefficient: Any = parameter("%", "signed")

    name: ClassVar[str] = "scale_factor"
    typical: ClassVar[Mapping[str, str]] = {"": "1 %"}
    title: ClassVar[str] = "scale factor error"
    separating_experiment: ClassVar[str] = "several rates of both signs"
    sentence_template: ClassVar[str] = "reads {coefficient} too much of what it should"

    def error(self, felt: Felt, axis: int) -> Any:
        """``s u``."""
        return self.coefficient * felt.u[axis]


@dataclass(frozen=True)
class ScaleDrift(InertialError):
    """``y = u + s (T - reference) u``: a scale that changes with the temperature T."""

    coefficient: Any = parameter("%/K", "signed")
    reference: Any = parameter("K", "setting", 293.15)

    name: ClassVar[str] = "scale_temperature"
    prior_penalty_nats: ClassVar[float] = 1.0  # a bias that follows the temperature is commoner
    title: ClassVar[str] = "scale factor follows the temperature"
    separating_experiment: ClassVar[str] = "the same rates, cold and warm"
    sentence_template: ClassVar[str] = "has a scale that changes by {coefficient} from {reference} on"
    needs: ClassVar[tuple[str, ...]] = ("warmth",)
    filter_drivers: ClassVar[tuple[str, ...]] = ("temperature",)

    def error(self, felt: Felt, axis: int) -> Any:
        """``s (T - reference) u``."""
        return self.coefficient * (felt.temperature - self.reference) * felt.u[axis]


@dataclass(frozen=True)
class ScaleAsymmetry(InertialError):
    """``y = u + s |u|``: other scales for positive and negative."""

    coefficient: Any = parameter("%", "signed")

    name: ClassVar[str] = "scale_asymmetry"
    prior_penalty_nats: ClassVar[float] = BEYOND_LINEAR_NATS
    typical: ClassVar[Mapping[str, str]] = {"": "1 %"}
    title: ClassVar[str] = "scale factor differs by sign"
    separating_experiment: ClassVar[str] = "two or more rates of each sign"
    sentence_template: ClassVar[str] = (
        "has a scale that differs by {coefficient} to either side of the mean by sign"
    )

    def error(self, felt: Felt, axis: int) -> Any:
        """``s |u|``."""
        return self.coefficient * abs(felt.u[axis])


@dataclass(frozen=True)
class Nonlinearity(InertialError):
    """``y = u + k2 u^2 + k3 u^3``."""

    k2: Any = parameter("1/(U)", "signed", 0.0)
    k3: Any = parameter("1/(U)^2", "signed", 0.0)

    name: ClassVar[str] = "nonlinearity"
    prior_penalty_nats: ClassVar[float] = BEYOND_LINEAR_NATS
    title: ClassVar[str] = "nonlinear scale"
    separating_experiment: ClassVar[str] = "the highest rates of both signs"
    sentence_template: ClassVar[str] = "is nonlinear: {entries}"

    def error(self, felt: Felt, axis: int) -> Any:
        """``k2 u^2 + k3 u^3``."""
        return self.k2 * felt.u[axis] ** 2 + self.k3 * felt.u[axis] ** 3


@dataclass(frozen=True)
class Misalignment(InertialError):
    """``y_i = u_i + sum_j m_ij u_j``: output axis i feels input axis j."""

    xy: Any = parameter("mrad", "signed", 0.0)
    xz: Any = parameter("mrad", "signed", 0.0)
    yx: Any = parameter("mrad", "signed", 0.0)
    yz: Any = parameter("mrad", "signed", 0.0)
    zx: Any = parameter("mrad", "signed", 0.0)
    zy: Any = parameter("mrad", "signed", 0.0)

    name: ClassVar[str] = "misalignment"
    typical: ClassVar[Mapping[str, str]] = {"": "10 mrad"}
    title: ClassVar[str] = "misalignment of the axes"
    separating_experiment: ClassVar[str] = "motion about all three axes"
    sentence_template: ClassVar[str] = "is misaligned (output axis, input axis): {entries}"

    def error(self, felt: Felt, axis: int) -> Any:
        """``sum_j m_ij u_j``."""
        return row_of(self, felt.u, axis)


@dataclass(frozen=True)
class Mounting(InertialError):
    """``y = R(delta)' u``: the sensors are turned to the vehicle, by twice the tangent of half the angle about an axis."""

    x: Any = parameter("mrad", "signed", 0.0)
    y: Any = parameter("mrad", "signed", 0.0)
    z: Any = parameter("mrad", "signed", 0.0)

    name: ClassVar[str] = "mounting"
    typical: ClassVar[Mapping[str, str]] = {"": "20 mrad"}
    title: ClassVar[str] = "mounting angles"
    separating_experiment: ClassVar[str] = "motion about all three axes"
    sentence_template: ClassVar[str] = "is turned to the vehicle (about its x, y, z axis): {entries}"
    sensors: ClassVar[tuple[str, ...]] = ("imu", "gyro", "accel", "mag")

    def error(self, felt: Felt, axis: int) -> Any:
        """``2 / (1 + g g) (u x g + (u x g) x g)`` with ``g = delta / 2``: the exact turn, without a sine."""
        g = (self.x / 2, self.y / 2, self.z / 2)
        c = tuple(_crossed(felt.u, g, i) for i in range(3))
        return 2 / (1 + g[0] * g[0] + g[1] * g[1] + g[2] * g[2]) * (c[axis] + _crossed(c, g, axis))


def _crossed(a: tuple[Any, ...], b: tuple[Any, ...], axis: int) -> Any:
    """One component of ``a x b``."""
    i, j = (axis + 1) % 3, (axis + 2) % 3
    return a[i] * b[j] - a[j] * b[i]


@dataclass(frozen=True)
class GSensitivity(InertialError):
    """``y_i = u_i + sum_j g_ij f_j``: a rate sensor feels the specific force."""

    xx: Any = parameter("U/g", "signed", 0.0)
    xy: Any = parameter("U/g", "signed", 0.0)
    xz: Any = parameter("U/g", "signed", 0.0)
    yx: Any = parameter("U/g", "signed", 0.0)
    yy: Any = parameter("U/g", "signed", 0.0)
    yz: Any = parameter("U/g", "signed", 0.0)
    zx: Any = parameter("U/g", "signed", 0.0)
    zy: Any = parameter("U/g", "signed", 0.0)
    zz: Any = parameter("U/g", "signed", 0.0)

    name: ClassVar[str] = "g_sensitivity"
    typical: ClassVar[Mapping[str, str]] = {"gyro": "0.1 deg/s/g"}
    title: ClassVar[str] = "sensitivity to specific force"
    separating_experiment: ClassVar[str] = "rest in six positions and turns between them"
    sentence_template: ClassVar[str] = "feels the specific force (output axis, input axis): {entries}"
    sensors: ClassVar[tuple[str, ...]] = ("gyro",)
    needs: ClassVar[tuple[str, ...]] = ("f_b",)

    def error(self, felt: Felt, axis: int) -> Any:
        """``sum_j g_ij f_j``."""
        return row_of(self, felt.force, axis)


@dataclass(frozen=True)
class GSquared(InertialError):
    """``y = u + sum_jk g_jk f_j f_k``: a rate sensor feels products of the specific force (anisoinertia)."""

    xx: Any = parameter("U/g^2", "signed", 0.0)
    yy: Any = parameter("U/g^2", "signed", 0.0)
    zz: Any = parameter("U/g^2", "signed", 0.0)
    xy: Any = parameter("U/g^2", "signed", 0.0)
    yz: Any = parameter("U/g^2", "signed", 0.0)
    zx: Any = parameter("U/g^2", "signed", 0.0)

    name: ClassVar[str] = "g_squared"
    title: ClassVar[str] = "sensitivity to the square of the specific force"
    separating_experiment: ClassVar[str] = "rest at many tilts"
    sentence_template: ClassVar[str] = "feels products of two axes of the specific force: {entries}"
    sensors: ClassVar[tuple[str, ...]] = ("gyro",)
    needs: ClassVar[tuple[str, ...]] = ("f_b",)
    prior_penalty_nats: ClassVar[float] = BEYOND_LINEAR_NATS

    def error(self, felt: Felt, axis: int) -> Any:
        """``sum_jk g_jk f_j f_k``."""
        f = felt.force
        squares = {p: f[AXES.index(p[0])] * f[AXES.index(p[1])] for p in PRODUCTS}
        return sum(getattr(self, pair) * f2 for pair, f2 in squares.items() if getattr(self, pair) != 0)


@dataclass(frozen=True)
class VibrationRectification(InertialError):
    """A bias proportional to the running variance of the specific force.

    An accelerometer rectifies its own axis; any other sensor the sum of all.
    """

    coefficient: Any = parameter("U/g^2", "signed")
    own: float = parameter("", "setting", 0.0)

    name: ClassVar[str] = "vibration_rectification"
    title: ClassVar[str] = "vibration is rectified into a bias"
    separating_experiment: ClassVar[str] = "shaking at rest, strong and weak"
    sentence_template: ClassVar[str] = "turns vibration into a bias of {coefficient}"
    needs: ClassVar[tuple[str, ...]] = ("power",)
    filter_drivers: ClassVar[tuple[str, ...]] = ("vibration",)

    def in_filter(self, place: FilterPlace) -> FilterRole:
        """By the driver ``vibration``, the standard deviation of the specific force of all axes together."""
        if not self.own:
            return super().in_filter(place)
        return NotModelled(
            "the vibration of one axis alone is no driver of a filter",
            "Give the coefficient for the vibration of all axes together (own = 0)",
        )

    def error(self, felt: Felt, axis: int) -> Any:
        """``k s^2``."""
        power = felt.vibration_power
        return self.coefficient * (power[axis] if self.own else power[0] + power[1] + power[2])


@dataclass(frozen=True)
class LeverArm(InertialError):
    """A sensor at `r` from the point of reference: ``omega x (omega x r) + alpha x r`` of a force, ``r`` of a position."""

    x: Any = parameter("m", "signed", 0.0)
    y: Any = parameter("m", "signed", 0.0)
    z: Any = parameter("m", "signed", 0.0)

    name: ClassVar[str] = "lever_arm"
    typical: ClassVar[Mapping[str, str]] = {"": "0.3 m"}
    title: ClassVar[str] = "lever arm"
    separating_experiment: ClassVar[str] = "turns about all axes, fast and slow"
    sentence_template: ClassVar[str] = "sits off the point of reference by {entries}"
    sensors: ClassVar[tuple[str, ...]] = ("accel", "gnss")
    needs: ClassVar[tuple[str, ...]] = ("omega_b",)

    def in_filter(self, place: FilterPlace) -> FilterRole:
        """The point to which a position or a velocity belongs; of an accelerometer it needs the angular acceleration."""
        if place.channel.split("_")[0] in ("gnss", "odometer", "zero"):
            return AntennaOffset()
        return NotModelled(
            "it needs the angular acceleration, which no sensor of the filter measures",
            "Let the filter's position be that of the accelerometer, and take the arm off the arms of all other sensors",
        )

    def error(self, felt: Felt, axis: int) -> Any:
        """The acceleration by rotation."""
        r, w, alpha = (self.x, self.y, self.z), felt.rate, felt.angular_acceleration
        return arm_rate(r, w, alpha, 2)[axis]

    def output(self, signals: Signals, axis: int) -> Array:
        """Of an accelerometer in body axes; of a position or a velocity along a navigation axis."""
        if signals.arm_order == 2 or signals.R_bn is None or signals.omega_b is None:
            return super().output(signals, axis)
        omega = tuple(signals.omega_b[:, k] for k in range(3))
        offset = arm_rate((self.x, self.y, self.z), omega, (), signals.arm_order)
        return np.asarray(sum(signals.R_bn[:, k, axis] * offset[k] for k in range(3)))


@dataclass(frozen=True)
class GravityError(InertialError):
    """Gravity is greater by `value` than the truth took it to be."""

    value: Any = parameter("U", "signed")

    name: ClassVar[str] = "gravity_error"
    title: ClassVar[str] = "error of gravity"
    separating_experiment: ClassVar[str] = "rest in six positions"
    sentence_template: ClassVar[str] = "feels a gravity that is greater by {value}"
    sensors: ClassVar[tuple[str, ...]] = ("accel",)
    needs: ClassVar[tuple[str, ...]] = ("R_bn",)

    def error(self, felt: Felt, axis: int) -> Any:
        """``-R_bn (0, 0, value)``, the third axis being down."""
        return -self.value * felt.downwards[axis]


@dataclass(frozen=True)
class EarthRate(InertialError):
    """The turning of the earth, which the truth left out; on the axes of the navigation frame."""

    x: Any = parameter("U", "signed", 0.0)
    y: Any = parameter("U", "signed", 0.0)
    z: Any = parameter("U", "signed", 0.0)

    name: ClassVar[str] = "earth_rate"
    title: ClassVar[str] = "rotation of the earth"
    separating_experiment: ClassVar[str] = "rest in several headings"
    sentence_template: ClassVar[str] = "feels the rotation of the earth: {entries}"
    sensors: ClassVar[tuple[str, ...]] = ("gyro",)
    needs: ClassVar[tuple[str, ...]] = ("R_bn",)

    def error(self, felt: Felt, axis: int) -> Any:
        """``R_bn omega_ie``."""
        row = felt.axes[axis]
        return row[0] * self.x + row[1] * self.y + row[2] * self.z

    def forbidden(self) -> str:
        """The Earth turns at one rate."""
        rate = float(np.linalg.norm([self.x, self.y, self.z]))
        return "the Earth does not turn so fast" if rate > MAX_EARTH_RATE_RATIO * EARTH_RATE else ""
