"""Cross-axis noise: white noise that two channels share.

References
----------
.. [1] R. A. Fisher, On the probable error of a coefficient of correlation, Metron 1, 1921.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from kfgen.effects.effect import Effect, parameter
from kfgen.effects.linear_system import LinearSystem


@dataclass(frozen=True)
class CrossAxisNoise(Effect):
    """White noise that correlates by `rho` with that of the other channel which says so."""

    rho: Any = parameter("", "setting")

    name: ClassVar[str] = "cross_axis_noise"
    title: ClassVar[str] = "noise shared with another channel"
    sentence_template: ClassVar[str] = "shares its white noise with another channel by a correlation of {rho}"

    def form(self, drive: Mapping[str, Any] | None = None) -> LinearSystem:
        """Nothing is added to a channel's own noise."""
        return LinearSystem()
