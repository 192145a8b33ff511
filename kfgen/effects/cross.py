"""Noise that two channels share.

References
----------
.. [1] R. A. Fisher, On the probable error of a coefficient of correlation, Metron 1, 1921.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from kfgen.effects.base import Effect, parameter
from kfgen.effects.form import Form


@dataclass(frozen=True)
class CrossAxisNoise(Effect):
    """White noise that correlates by `rho` with that of the other channel which says so."""

    rho: Any = parameter("", "setting")

    name: ClassVar[str] = "cross_axis_noise"
    title: ClassVar[str] = "noise shared with another channel"
    saying: ClassVar[str] = "shares its white noise with another channel by a correlation of {rho}"

    def form(self, drive: Mapping[str, Any] | None = None) -> Form:
        """Nothing is added to a channel's own noise."""
        return Form()
