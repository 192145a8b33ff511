"""Deterministic drifts of a bias in time: a constant, a ramp, a warm-up.

References
----------
.. [1] IEEE Std 952-1997, annex C, eq. (C.22).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Self

import numpy as np

from kfgen.effects.effect import LinearProcess, Look, parameter
from kfgen.effects.linear_system import LinearSystem, State


@dataclass(frozen=True)
class Bias(LinearProcess):
    """A constant offset (turn-on bias), known before the record as `value` with standard deviation `sd`."""

    value: Any = parameter("U", "signed", 0.0)
    sd: float = parameter("U", "setting", 0.0)

    name: ClassVar[str] = "bias"
    title: ClassVar[str] = "constant bias"
    separating_experiment: ClassVar[str] = "rest in several positions"
    sentence_template: ClassVar[str] = "has a constant bias of {value}"

    def draw(self, rng: np.random.Generator) -> Self:
        """A turn-on bias."""
        return replace(self, value=self.value + self.sd * rng.standard_normal())

    def form(self, drive: Mapping[str, Any] | None = None) -> LinearSystem:
        """``dx = 0``."""
        return LinearSystem(
            A=((0,),), W=((0,),), C=(1,), x0=(self.value,), states=(State("bias", shared=True),)
        )


@dataclass(frozen=True)
class RateRamp(LinearProcess):
    """A drift linear in time: AVAR ``R^2 tau^2 / 2``."""

    R: Any = parameter("U/s", "signed")

    name: ClassVar[str] = "rate_ramp"
    title: ClassVar[str] = "rate ramp"
    separating_experiment: ClassVar[str] = "a second record, for a ramp comes again"
    sentence_template: ClassVar[str] = "drifts steadily by R = {R}"

    @classmethod
    def starts(cls, look: Look) -> list[Self]:
        """None: the coefficient is solved for."""
        return [cls(R=0.0)]

    def form(self, drive: Mapping[str, Any] | None = None) -> LinearSystem:
        """``x1' = x2``, ``x2' = 0``, from ``(0, R)``."""
        return LinearSystem(
            A=((0, 1), (0, 0)),
            W=((0, 0), (0, 0)),
            C=(1, 0),
            x0=(0, self.R),
            states=(State("bias", shared=True), State("ramp", "U/s")),
        )


@dataclass(frozen=True)
class WarmUp(LinearProcess):
    """An exponential settling after switch-on: ``size exp(-t / tau)`` from the first sample on."""

    size: Any = parameter("U", "signed")
    tau: Any = parameter("s", "time")

    name: ClassVar[str] = "warm_up"
    title: ClassVar[str] = "warm-up after switch-on"
    separating_experiment: ClassVar[str] = "a second record from a cold start"
    sentence_template: ClassVar[str] = "settles after switch-on from {size} with a time constant of {tau}"

    @classmethod
    def starts(cls, look: Look) -> list[Self]:
        """Time constants over the record; the size is solved for."""
        return [cls(0.0, share * look.duration) for share in (0.01, 0.03, 0.1, 0.2, 0.4)]

    def form(self, drive: Mapping[str, Any] | None = None) -> LinearSystem:
        """``dx = -x / tau dt``, from `size`."""
        return LinearSystem(
            A=((-1 / self.tau,),), W=((0,),), C=(1,), x0=(self.size,), states=(State("warm_up"),)
        )
