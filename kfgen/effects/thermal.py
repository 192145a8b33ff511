"""Effects driven by a thermometer."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Self

from kfgen.effects.base import Effect, Look, parameter
from kfgen.effects.form import Form, State


@dataclass(frozen=True)
class Temperature(Effect):
    """A bias proportional to the temperature, about a stated reference temperature."""

    coefficient: Any = parameter("U/K", "signed")
    reference: float = parameter("K", "setting", 298.15)

    name: ClassVar[str] = "temperature"
    title: ClassVar[str] = "bias proportional to temperature"
    saying: ClassVar[str] = "follows the temperature by {coefficient}"
    driver: ClassVar[str] = "temperature"

    @classmethod
    def starts(cls, look: Look) -> list[Self]:
        """About the mean temperature, where there is a thermometer."""
        return [cls(0.0, look.drive[cls.driver])] if cls.driver in look.drive else []

    def form(self, drive: Mapping[str, Any] | None = None) -> Form:
        """``y = coefficient (T - reference)``, the coefficient a constant state."""
        away = drive["temperature"] - self.reference if drive else 0.0
        return Form(
            A=((0,),), W=((0,),), C=(away,), x0=(self.coefficient,), states=(State("temperature", "U/K"),)
        )
