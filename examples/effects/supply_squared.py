"""A bias that follows the supply voltage squared, declared for kfgen: ``kfgen judge supply_squared.py LOG --model M``."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Self

from kfgen.effects import LinearSystem, Look, State
from kfgen.effects.effect import LinearProcess, parameter


@dataclass(frozen=True)
class SupplySquared(LinearProcess):
    """``y = coefficient (voltage - reference)^2``."""

    coefficient: Any = parameter("U/V^2", "signed")
    reference: float = parameter("V", "setting", 3.3)

    name: ClassVar[str] = "supply_squared"
    title: ClassVar[str] = "bias proportional to the square of the supply voltage's error"
    sentence_template: ClassVar[str] = "follows the supply voltage squared by {coefficient}"
    driver: ClassVar[str] = "voltage"

    def form(self, drive: Mapping[str, Any] | None = None) -> LinearSystem:
        """One constant state, seen through the voltage."""
        away = (drive["voltage"] - self.reference) ** 2 if drive else 0.0
        return LinearSystem(
            ((0,),), ((0,),), (away,), x0=(self.coefficient,), states=(State("supply", "U/V^2"),)
        )

    @classmethod
    def starts(cls, look: Look) -> list[Self]:
        """The coefficient is solved for; 3.3 V is nominal."""
        return [cls(0.0)] if "voltage" in look.drive else []
