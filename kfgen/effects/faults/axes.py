"""Wrong sign and exchanged axes of a triad, found by regression on what its three axes should have read.

A channel's readings are a combination of what the three axes should have read; the row of its coefficients tells.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from kfgen.effects.effect import Effect
from kfgen.effects.faults.samples import Fault

Array = NDArray[np.float64]

MAX_CROSS_COEFFICIENT_RATIO = 0.3
"""Coefficient of another axis over the largest one, below which a channel reads a single axis."""
UNIT_COEFFICIENT_TOLERANCE = 0.25
"""Distance of the size of a coefficient from one that a scale factor explains."""


@dataclass(frozen=True)
class SignError(Fault):
    """The readings have the wrong sign."""

    name: ClassVar[str] = "sign_error"
    title: ClassVar[str] = "a wrong sign"
    sentence_template: ClassVar[str] = "has the opposite sign of what it should read: negate it"

    @classmethod
    def turned(cls, own: bool, coefficient: float) -> Effect | None:
        """Near minus one of its own axis."""
        return cls() if own and abs(coefficient + 1.0) < UNIT_COEFFICIENT_TOLERANCE else None


@dataclass(frozen=True)
class AxisSwap(Fault):
    """The readings are those of another axis."""

    name: ClassVar[str] = "axis_swap"
    title: ClassVar[str] = "exchanged axes"
    sentence_template: ClassVar[str] = "reads another axis of its triad: exchange the columns"

    @classmethod
    def turned(cls, own: bool, coefficient: float) -> Effect | None:
        """Near one or minus one of another axis."""
        return cls() if not own and abs(abs(coefficient) - 1.0) < UNIT_COEFFICIENT_TOLERANCE else None


def axis_faults(row: Array, axis: int) -> list[Effect]:
    """What is wrong with a channel of a triad.

    Parameters
    ----------
    row : ndarray, shape (3,)
        Coefficients of the three true axes in the channel's readings; a faultless channel has 1 at its own.
    axis : int
        The channel's own axis: 0, 1 or 2.

    Returns
    -------
    list of Effect
        Empty where the channel does not read a single axis, or reads its own as it should.
    """
    along = int(np.argmax(np.abs(row)))
    if np.abs(np.delete(row, along)).max() >= MAX_CROSS_COEFFICIENT_RATIO * abs(row[along]):
        return []
    found = [cls.turned(along == axis, float(row[along])) for cls in Fault.__subclasses__()]
    return [f for f in found if f is not None]
