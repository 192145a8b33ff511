"""Effects of iron and currents on a magnetometer that turns.

References
----------
.. [1] V. Renaudin, M. H. Afzal, G. Lachapelle, Complete triaxis magnetometer calibration in the magnetic
   domain, J. Sensors, 2010.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from kfgen.effects.effect import parameter
from kfgen.effects.filter_role import FilterPlace, FilterRole, NotModelled
from kfgen.effects.inertial.felt import Felt
from kfgen.effects.inertial.inertial_error import InertialError, row_of

Array = NDArray[np.float64]


@dataclass(frozen=True)
class HardIron(InertialError):
    """A field fixed to the body; from `time` for `duration` when that is not zero, else always.

    It comes and goes within `edge` at either end: a magnet in a hand.
    """

    x: Any = parameter("U", "signed", 0.0)
    y: Any = parameter("U", "signed", 0.0)
    z: Any = parameter("U", "signed", 0.0)
    time: float = parameter("s", "setting", 0.0)
    duration: float = parameter("s", "setting", 0.0)
    edge: float = parameter("s", "setting", 0.0)

    name: ClassVar[str] = "hard_iron"
    typical: ClassVar[Mapping[str, str]] = {"": "3 uT"}
    title: ClassVar[str] = "hard iron"
    separating_experiment: ClassVar[str] = "a turn in place about every axis"
    sentence_template: ClassVar[str] = "carries a field of its own: {entries}"
    sensors: ClassVar[tuple[str, ...]] = ("mag",)

    def error(self, felt: Felt, axis: int) -> Any:
        """A constant while it is there."""
        return _while(felt.t, self) * (self.x, self.y, self.z)[axis]

    def in_filter(self, place: FilterPlace) -> FilterRole:
        """A constant of the body; a filter does not foresee one that comes and goes."""
        return _once("a magnet that came and went") if self.duration else super().in_filter(place)

    def sentence(self, channel: str, unit: str) -> str:
        """The field and when it is there."""
        return super().sentence(channel, unit) + _when(self)


@dataclass(frozen=True)
class SoftIron(InertialError):
    """``m = (I + A) m_b``: the field is drawn together by iron in the body."""

    xx: Any = parameter("%", "signed", 0.0)
    xy: Any = parameter("%", "signed", 0.0)
    xz: Any = parameter("%", "signed", 0.0)
    yx: Any = parameter("%", "signed", 0.0)
    yy: Any = parameter("%", "signed", 0.0)
    yz: Any = parameter("%", "signed", 0.0)
    zx: Any = parameter("%", "signed", 0.0)
    zy: Any = parameter("%", "signed", 0.0)
    zz: Any = parameter("%", "signed", 0.0)

    name: ClassVar[str] = "soft_iron"
    typical: ClassVar[Mapping[str, str]] = {"": "5 %"}
    title: ClassVar[str] = "soft iron"
    separating_experiment: ClassVar[str] = "a turn in place about every axis"
    sentence_template: ClassVar[str] = "distorts the field (output axis, input axis): {entries}"
    sensors: ClassVar[tuple[str, ...]] = ("mag",)

    def error(self, felt: Felt, axis: int) -> Any:
        """``sum_j a_ij m_j``."""
        return row_of(self, felt.u, axis)


@dataclass(frozen=True)
class MagneticDisturbance(InertialError):
    """Another field, fixed in space, from `time` for `duration`, within `edge` there and gone; navigation axes."""

    x: Any = parameter("U", "signed", 0.0)
    y: Any = parameter("U", "signed", 0.0)
    z: Any = parameter("U", "signed", 0.0)
    time: float = parameter("s", "setting", 0.0)
    duration: float = parameter("s", "setting", 0.0)
    edge: float = parameter("s", "setting", 0.0)

    name: ClassVar[str] = "magnetic_disturbance"
    title: ClassVar[str] = "magnetic disturbance fixed in space"
    separating_experiment: ClassVar[str] = "a turn in place about every axis"
    sentence_template: ClassVar[str] = "meets another field in space: {entries}"
    sensors: ClassVar[tuple[str, ...]] = ("mag",)
    needs: ClassVar[tuple[str, ...]] = ("R_bn",)

    def error(self, felt: Felt, axis: int) -> Any:
        """``R_bn d`` while it is there."""
        row = felt.axes[axis]
        return _while(felt.t, self) * (row[0] * self.x + row[1] * self.y + row[2] * self.z)

    def in_filter(self, place: FilterPlace) -> FilterRole:
        """Another field in space; a filter does not foresee one that comes and goes."""
        return _once("a field that came and went") if self.duration else super().in_filter(place)

    def sentence(self, channel: str, unit: str) -> str:
        """The field and when it is there."""
        return super().sentence(channel, unit) + _when(self)


@dataclass(frozen=True)
class Declination(InertialError):
    """The horizontal field points `angle` further east than it was taken to; to first order, 1 % off at ten degrees."""

    angle: Any = parameter("rad", "signed")

    name: ClassVar[str] = "declination"
    title: ClassVar[str] = "magnetic declination"
    separating_experiment: ClassVar[str] = "turns to both sides at changing speed"
    sentence_template: ClassVar[str] = "finds magnetic north {angle} further east"
    sensors: ClassVar[tuple[str, ...]] = ("mag",)
    needs: ClassVar[tuple[str, ...]] = ("R_bn",)

    def error(self, felt: Felt, axis: int) -> Any:
        """``angle d x m_b``, d being down in body axes."""
        i, j = (axis + 1) % 3, (axis + 2) % 3
        return self.angle * (felt.downwards[i] * felt.u[j] - felt.downwards[j] * felt.u[i])


def _once(what: str) -> NotModelled:
    return NotModelled(
        f"{what} says nothing of the next time",
        "Refuse samples whose length is not the field's (--set field_gate=0.1), or give the field freedom (field_left_out)",
    )


def _while(t: Any, effect: HardIron | MagneticDisturbance) -> Any:
    """Whether it is there at times [s], from zero to one; always where it has no duration."""
    if not effect.duration:
        return 1
    inside = ((t >= effect.time) & (t < effect.time + effect.duration)).astype(np.float64)
    if not effect.edge:
        return inside
    away = np.minimum(t - effect.time, effect.time + effect.duration - t)
    return np.asarray(inside * np.clip(away / effect.edge, 0.0, 1.0))


def _when(effect: HardIron | MagneticDisturbance) -> str:
    if not effect.duration:
        return ""
    words = f" from {effect.time:.4g} s to {effect.time + effect.duration:.4g} s"
    return words + (f", within {effect.edge:.2g} s there and gone" if effect.edge else "")
