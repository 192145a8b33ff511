"""A new effect in one place: a bias that follows the supply voltage squared.

Declared once, it simulates, is found in a record by the gap workflow, and becomes a filter state.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Self

import numpy as np

from kfgen.effects import LinearSystem, Look, State, make
from kfgen.effects.effect import LinearProcess, parameter
from kfgen.effects.noise_model import ChannelNoise, Term
from kfgen.gap.rest.channel_gap import channel_gap
from kfgen.gap.words import finding_sentence
from kfgen.identify.evidence.record import Record
from kfgen.model.library import build


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


rng = np.random.default_rng(1)
t = np.arange(36_000) / 10.0
voltage = 3.3 + 0.2 * np.sin(2 * np.pi * t / 900.0) * np.exp(-t / 3000.0)
white, hidden = make("white_noise", N=1e-4), SupplySquared(coefficient=5e-3)
y = white.simulate(t, rng) + hidden.simulate(t, rng, {"voltage": voltage})

assumed = ChannelNoise("deg/s", (Term(white),))
gap = channel_gap("gyro_x", Record(t, y, {"voltage": voltage}), assumed)
for finding in gap.findings:
    print(finding_sentence(gap, finding))
assert [f.effect.name for f in gap.findings] == ["supply_squared"]

filter_model = build("gyro-static").augment("gyro_x", gap.findings[0].effect)
print("states:", ", ".join(f"{s.name} [{s.unit}]" for s in filter_model.states))
