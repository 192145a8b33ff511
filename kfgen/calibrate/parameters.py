"""The numbers of a calibration, as entries of the catalogue's effects, and the effects from the numbers."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from kfgen.core.channel_names import AXES
from kfgen.effects import make
from kfgen.gap.scene.scene import Placed

MIN_POSES_OF_ANGLES = 9
"""Poses from which the angles between the axes are fitted beside bias and scale."""
TRIANGLE = ("xy", "xz", "yz")
"""Entries of a matrix that a length can tell: a turn of all axes together changes none."""


@dataclass(frozen=True)
class CalibratedNumber:
    """One number: the effect that has it, where that acts, and its name there."""

    effect: str
    where: str
    parameter: str

    @property
    def label(self) -> str:
        """``accel_x bias value``."""
        return f"{self.where} {self.effect} {self.parameter}"


def entries_of(sensor: str, readings: int, *, known_length: bool) -> tuple[CalibratedNumber, ...]:
    """What is fitted of a triad of which the length of what it should read is constant.

    Parameters
    ----------
    sensor : str
        ``accel`` or ``mag``.
    readings : int
        Poses, or samples.
    known_length : bool
        Whether that length is known: else one axis measures it.
    """
    if sensor == "mag":
        diagonal = ("xx", "yy", "zz") if known_length else ("xx", "yy")
        return (
            *(CalibratedNumber("hard_iron", "mag", a) for a in AXES),
            *(CalibratedNumber("soft_iron", "mag", e) for e in (*diagonal, *TRIANGLE)),
        )
    axes = [f"{sensor}_{a}" for a in AXES]
    found = [
        *(CalibratedNumber("bias", a, "value") for a in axes),
        *(CalibratedNumber("scale_factor", a, "coefficient") for a in axes),
    ]
    if readings >= MIN_POSES_OF_ANGLES:
        found += [CalibratedNumber("misalignment", f"{sensor}_{e[0]}", e) for e in TRIANGLE]
    return tuple(found)


def placed(entries: Sequence[CalibratedNumber], values: Iterable[float]) -> tuple[Placed, ...]:
    """The effects with their values [SI], each where it acts.

    Parameters
    ----------
    entries : sequence of CalibratedNumber
    values : iterable of float
        Of the entries.
    """
    groups: dict[tuple[str, str], dict[str, Any]] = {}
    for entry, value in zip(entries, values):
        groups.setdefault((entry.effect, entry.where), {})[entry.parameter] = float(value)
    return tuple(Placed(make(effect, **numbers), where) for (effect, where), numbers in groups.items())
