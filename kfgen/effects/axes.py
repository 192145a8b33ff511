"""Axes that are exchanged, turned round or in another unit: seen against what a triad should have read.

A channel's readings are a combination of what the three axes should have read; the row of its coefficients tells.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from kfgen.effects.base import Effect
from kfgen.effects.integrity import Fault, between_units

Array = NDArray[np.float64]

AT_RIGHT = 0.3
"""Largest part of another axis in a channel that reads one axis, relative."""
CLOSE = 0.25
"""Relative distance of a coefficient from one that a scale factor explains."""


@dataclass(frozen=True)
class AxisFault(Fault):
    """A fault of a channel against its triad."""

    @classmethod
    def facing(cls, row: Array, axis: int) -> Effect | None:
        """The fault, from the coefficients of the three axes in the channel of `axis`, shape (3,)."""
        along = int(np.argmax(np.abs(row)))
        clean = np.abs(np.delete(row, along)).max() < AT_RIGHT * abs(row[along])
        return cls.turned(along == axis, float(row[along])) if clean else None

    @classmethod
    def turned(cls, own: bool, coefficient: float) -> Effect | None:
        """The fault of a channel that reads its own axis, or another one, by a coefficient."""
        return None


@dataclass(frozen=True)
class SignError(AxisFault):
    """The readings have the wrong sign."""

    name: ClassVar[str] = "sign_error"
    title: ClassVar[str] = "a wrong sign"
    saying: ClassVar[str] = "has the opposite sign of what it should read: turn it round"

    @classmethod
    def turned(cls, own: bool, coefficient: float) -> Effect | None:
        """Near minus one of its own axis."""
        return cls() if own and abs(coefficient + 1.0) < CLOSE else None


@dataclass(frozen=True)
class AxisSwap(AxisFault):
    """The readings are those of another axis."""

    name: ClassVar[str] = "axis_swap"
    title: ClassVar[str] = "exchanged axes"
    saying: ClassVar[str] = "reads another axis of its triad: exchange the columns"

    @classmethod
    def turned(cls, own: bool, coefficient: float) -> Effect | None:
        """Near one or minus one of another axis."""
        return cls() if not own and abs(abs(coefficient) - 1.0) < CLOSE else None


@dataclass(frozen=True)
class AxisUnit(AxisFault):
    """See `kfgen.effects.integrity.UnitError`, which is what it says."""

    @classmethod
    def turned(cls, own: bool, coefficient: float) -> Effect | None:
        """Near a factor between two units."""
        return between_units(abs(coefficient)) if own else None


def axis_faults(row: Array, axis: int) -> list[Effect]:
    """What is wrong with a channel, from its row of coefficients, shape (3,)."""
    found: list[Any] = [cls.facing(row, axis) for cls in AxisFault.__subclasses__()]
    return [f for f in found if f is not None]
