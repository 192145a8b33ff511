"""Noise whose spectrum falls with a slope of its own: between white noise and flicker, or flicker and a random walk.

The slope is a number like others, with an interval. The variances of the bank follow from the integral of
``x^(slope - 1) / (1 + x^2)`` over all x > 0, which is ``pi / (2 sin(pi slope / 2))``; see ``docs/noise.md``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np

from kfgen.core.errors import InputError
from kfgen.effects.effect import LinearProcess, parameter
from kfgen.effects.linear_system import LinearSystem
from kfgen.effects.process.stochastic import DEFAULT_FLICKER_BAND_S, OfABand, bank, bank_times
from kfgen.effects.series import Detection, OnGrid, WhiteSeries

STEEPEST = 2.0
"""Slope of a random walk."""
STEEPEST_FITTED = 1.99
"""Up to which the interval of a slope may go."""
SLOPES_LOOKED_FOR = ((0.3, 0.85), (1.2, 1.8))
"""Beyond and between, white noise, flicker and a random walk are simpler and say the same."""
SLOWEST_OVER_LONGEST = 100.0
"""Correlation time of the process that stands for all that is slower than the band, over the longest in it."""
SLOPES_TRIED = (0.45, 0.7, 1.3, 1.5, 1.7)
"""Where fits start."""
MEANS = 64
"""Into which a record is gathered for a first look at the size."""


@dataclass(frozen=True)
class PowerLawNoise(OfABand, LinearProcess):
    """Noise of density ``B^2 w^-slope``, ``w`` in rad/s, inside a band, as a bank of Gauss-Markov processes.

    ``B`` is the bias instability of the flicker that has the same density at 1 rad/s. Correlation times are spaced evenly
    in the logarithm with ratio ``r`` from `shortest` to `longest`, each of variance
    ``B^2 ln(r) sin(pi slope / 2) / pi tau^(slope - 1)``; a slow one more drives as all together do that would follow, and
    white noise has the density of all together that would go before.
    """

    B: Any = parameter("U")
    slope: Any = parameter("", "slope")
    shortest: float = parameter("s", "setting", DEFAULT_FLICKER_BAND_S[0])
    longest: float = parameter("s", "setting", DEFAULT_FLICKER_BAND_S[1])

    name: ClassVar[str] = "power_law_noise"
    title: ClassVar[str] = "power-law noise"
    separating_experiment: ClassVar[str] = "a much longer record"
    sentence_template: ClassVar[str] = (
        "carries noise that falls as f^-{slope}, at 1 rad/s like flicker of B = {B}, between {shortest} and {longest}"
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if isinstance(self.slope, (int, float)) and not 0.0 < self.slope < STEEPEST:
            raise InputError(
                f"power_law_noise of slope {self.slope:g} is no noise between white and a random walk",
                remedy=f"Give a slope above 0 and below {STEEPEST:g}: the density falls as f^-slope",
            )

    @classmethod
    def ceiling(cls, name: str, grid: OnGrid) -> float:
        """Nearly that of a random walk, for the slope."""
        return STEEPEST_FITTED if name == "slope" else math.inf

    @classmethod
    def ranges(cls, name: str) -> tuple[tuple[float, float], ...]:
        """Of the slope: below and above that of flicker."""
        return SLOPES_LOOKED_FOR if name == "slope" else ()

    def form(self, drive: Mapping[str, Any] | None = None) -> LinearSystem:
        """A diagonal bank of Gauss-Markov processes, and white noise."""
        r, taus = bank_times(self.shortest, self.longest)
        s, each = self.slope, self.B**2 * _sin(math.pi * self.slope / 2) / math.pi
        variances = [each * math.log(r) * t ** (s - 1) for t in taus]
        slowest = SLOWEST_OVER_LONGEST * self.longest
        driven = 2 * each * (self.longest * math.sqrt(r)) ** (s - 2) / (2 - s)
        slow = bank([*taus, slowest], [*variances, driven * slowest / 2], "power_law")
        return replace(slow, V=2 * each * (self.shortest / math.sqrt(r)) ** s / s)

    @classmethod
    def detect(cls, series: WhiteSeries) -> list[Detection]:
        """Several slopes over the band that the record can show, of the size of the means of its parts."""
        if series.n < MEANS:
            return []
        duration = series.n * series.dt
        size = float(np.std([part.mean() for part in np.array_split(series.y, MEANS)]))
        found = []
        for slope in SLOPES_TRIED:
            B = size * duration ** (0.5 * (1.0 - slope))
            found += [Detection(cls(B, slope, series.dt, duration))] if B > 0.0 else []
        return found


def _sin(x: Any) -> Any:
    """Of a number or a symbol."""
    if isinstance(x, (int, float)):
        return math.sin(x)
    import sympy as sp

    return sp.sin(x)
