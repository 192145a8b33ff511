"""Cross-axis noise: white noise that two channels share.

References
----------
.. [1] R. A. Fisher, On the probable error of a coefficient of correlation, Metron 1, 1921.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from kfgen.effects.effect import AddsNothingAtRest, parameter
from kfgen.effects.filter_role import FilterPlace, FilterRole, NotModelled, SharedNoise


@dataclass(frozen=True)
class CrossAxisNoise(AddsNothingAtRest):
    """White noise that correlates by `rho` with that of the other channel which says so."""

    rho: Any = parameter("", "setting")

    name: ClassVar[str] = "cross_axis_noise"
    title: ClassVar[str] = "noise shared with another channel"
    sentence_template: ClassVar[str] = "shares its white noise with another channel by a correlation of {rho}"

    def in_filter(self, place: FilterPlace) -> FilterRole:
        """Correlated driving noise of two inputs; the rows of a measurement are fused one by one."""
        if not place.measured:
            return SharedNoise(self.rho)
        return NotModelled(
            "the channels of a measurement are fused one by one, each with noise of its own",
            f"Raise the white noise of both channels by {50.0 * abs(float(self.rho)):.3g} %",
        )
