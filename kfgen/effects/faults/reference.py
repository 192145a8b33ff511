"""Faults of a reference: of another motion, of another convention, held, stuck or rounded.

A filter models none of them; each says what to do about the reference.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from kfgen.effects.effect import parameter
from kfgen.effects.faults.samples import Fault


@dataclass(frozen=True)
class ReferenceFault(Fault):
    """A fault of the reference, not of the sensor: a simulated log, whose reference is the truth, has none."""


@dataclass(frozen=True)
class OtherMotion(ReferenceFault):
    """No scale, no axes and no delay make the reference what was read."""

    correlation: Any = parameter("", "ratio")

    name: ClassVar[str] = "other_motion"
    title: ClassVar[str] = "a reference of another motion"
    sentence_template: ClassVar[str] = (
        "and its reference are not of the same motion (correlation {correlation}): give the reference of this log"
    )


@dataclass(frozen=True)
class ReversedAttitude(ReferenceFault):
    """The conjugate of the attitude turns as the sensor does."""

    name: ClassVar[str] = "reversed_attitude"
    title: ClassVar[str] = "an inverse attitude quaternion"
    sentence_template: ClassVar[str] = (
        "moves as if ref_q were navigation to body: give its conjugate, body to navigation"
    )


@dataclass(frozen=True)
class ScalarLastAttitude(ReferenceFault):
    """The attitude turns as the sensor does if its last column is the scalar."""

    name: ClassVar[str] = "scalar_last_attitude"
    title: ClassVar[str] = "an attitude with its scalar last"
    sentence_template: ClassVar[str] = (
        "moves as if ref_q had its scalar last: name its columns x, y, z, w in this order"
    )


@dataclass(frozen=True)
class HeldReference(ReferenceFault):
    """The reference is slower than the log and holds each value for a `period`."""

    period: Any = parameter("s", "time")

    name: ClassVar[str] = "held_reference"
    title: ClassVar[str] = "a reference that is held"
    sentence_template: ClassVar[str] = (
        "has a reference that holds each value for {period}: between them it was interpolated"
    )


@dataclass(frozen=True)
class StuckReference(ReferenceFault):
    """The reference is stuck for a `share` of the log while the sensor moves."""

    share: Any = parameter("", "ratio")

    name: ClassVar[str] = "stuck_reference"
    title: ClassVar[str] = "a reference that is stuck"
    sentence_template: ClassVar[str] = (
        "moved while its reference was stuck, in a share of {share} of the log: left out"
    )


@dataclass(frozen=True)
class RoundedReference(ReferenceFault):
    """The reference attitude was written in steps of `step`, which turn it by more than its sensor's noise hides."""

    step: Any = parameter("", "size")

    name: ClassVar[str] = "rounded_reference"
    title: ClassVar[str] = "a reference that is rounded"
    sentence_template: ClassVar[str] = (
        "is held against a reference attitude rounded to {step}, too coarse for its noise: give it more digits"
    )
