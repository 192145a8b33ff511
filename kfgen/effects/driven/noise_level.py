"""Noise whose level follows a recorded channel: a regime instead of a moment.

References
----------
.. [1] A. C. Harvey, Estimating regression models with multiplicative heteroscedasticity, Econometrica 44(3), 1976.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from kfgen.effects.driven.proportional import is_channel, of_channel
from kfgen.effects.effect import AddsNothingAtRest, parameter
from kfgen.effects.filter_role import FilterPlace, FilterRole, NoiseFactor, NotModelled
from kfgen.effects.series import DECADES, Detection, WhiteSeries

Array = NDArray[np.float64]

NOISE_LEVEL = "noise_level:"
"""Before the name of a channel: the effect of that channel on the noise."""
PROMISING = 3.5
"""Standard deviations of the regression of squares on a channel from which it is looked at in earnest."""
ROUNDS = 30


@dataclass(frozen=True)
class NoiseLevel(AddsNothingAtRest):
    """White noise of standard deviation ``sigma exp(slope (channel - reference))``, ``noise_level:NAME`` [1]_."""

    slope: Any = parameter("%", "solved")
    reference: float = parameter("", "setting", 0.0)

    name: ClassVar[str] = "noise_level"
    title: ClassVar[str] = "noise whose level follows another channel"
    sentence_template: ClassVar[str] = (
        "has noise that grows with the other channel, by {slope} per SI unit of it"
    )
    separating_experiment: ClassVar[str] = "that channel moved by itself, all else kept"
    prior_penalty_nats: ClassVar[float] = 1.0
    changes_samples: ClassVar[bool] = True

    def in_filter(self, place: FilterPlace) -> FilterRole:
        """Noise of an input that follows the driver; R of a measurement is one number."""
        if not place.measured and self.driver in place.drive:
            import sympy as sp

            return NoiseFactor(sp.exp(2 * self.slope * (place.drive[self.driver] - self.reference)))
        return NotModelled(
            "the R of a measurement is one number in the emitted filter and does not follow a driver",
            f"Give the channel the white noise that it has where {self.driver} makes it largest",
        )

    @classmethod
    def detect(cls, series: WhiteSeries) -> list[Detection]:
        """The recorded channel that the squares follow best, of those that are no axis of a sensor."""
        names = [n for n in series.drive if n != "temperature" and is_channel(n)]
        best = max(names, key=lambda n: abs(followed(series, series.drive[n])), default=None)
        chance = -float(np.log(max(len(names), 1)))
        return leveled(best).found(series, chance) if best else []

    @classmethod
    def found(cls, series: WhiteSeries, chance: float = 0.0) -> list[Detection]:
        """The slope on its own channel, with the evidence over one level by Laplace's method."""
        s = series.drive[cls.driver]
        reference = float(np.mean(s))
        if abs(followed(series, s)) < PROMISING:
            return []
        away = s - reference
        span = float(np.ptp(away))
        x, gain, sd = _fitted(series.fast**2, away / span, series.level)
        evidence = gain + 0.5 * float(np.log(2.0 * np.pi)) + float(np.log(sd / (2.0 * DECADES)))
        half = 1.96 * sd / span
        slope = x / span
        return [
            Detection(cls(slope, reference), 0.0, evidence + chance, {"slope": (slope - half, slope + half)})
        ]

    def removed_from(self, series: WhiteSeries) -> Array:
        """The white part brought to its level at the reference."""
        return np.asarray(series.y - series.noise * (1.0 - 1.0 / self._factor(series.drive[self.driver])))

    def apply_to(
        self, y: Array, t: Array, rng: np.random.Generator, drive: Mapping[str, Array] | None = None
    ) -> Array:
        """Noise is added where it is louder; where it is quieter, slow parts shrink with it."""
        if not drive or self.driver not in drive:
            return y
        factor = self._factor(drive[self.driver])
        sd = float(np.sqrt(0.5 * np.mean(np.diff(y) ** 2)))
        more = sd * np.sqrt(np.maximum(factor**2 - 1.0, 0.0)) * rng.standard_normal(y.size)
        return np.where(factor >= 1.0, y + more, y.mean() + (y - y.mean()) * factor)

    def _factor(self, s: Array) -> Array:
        return np.asarray(np.exp(np.clip(float(self.slope) * (s - float(self.reference)), -20.0, 20.0)))


@dataclass(frozen=True)
class NoiseTemperature(NoiseLevel):
    """White noise whose standard deviation follows the temperature."""

    slope: Any = parameter("%/K", "solved")
    reference: float = parameter("K", "setting", 298.15)

    name: ClassVar[str] = "noise_temperature"
    title: ClassVar[str] = "noise whose level follows the temperature"
    sentence_template: ClassVar[str] = "has noise that grows with the temperature, by {slope}"
    driver: ClassVar[str] = "temperature"

    @classmethod
    def detect(cls, series: WhiteSeries) -> list[Detection]:
        """Where there is a thermometer that moves."""
        T = series.drive.get("temperature")
        return cls.found(series) if T is not None and np.ptp(T) > 0.0 else []


@cache
def leveled(channel: str) -> type[NoiseLevel]:
    """The effect of a channel whose name is plain."""
    return of_channel(NoiseLevel, channel)


def followed(series: WhiteSeries, s: Array) -> float:
    """Regression of the squares of the white series on a channel, shape (n,), in standard deviations."""
    u = s - np.mean(s)
    size = float(np.linalg.norm(u))
    z2 = series.z**2
    return float(u @ (z2 - np.mean(z2))) / (float(np.sqrt(2.0)) * size) if size > 0.0 else 0.0


def _fitted(z2: Array, s: Array, assumed: tuple[float, float]) -> tuple[float, float, float]:
    """Slope of the logarithm of the level on a shape, gain over one level [nats], standard deviation of the slope."""
    mean, sd = assumed
    x = np.array([0.5 * np.log(np.mean(z2)), 0.0])
    one = -np.log(np.mean(z2)) * 0.5 * z2.size - 0.5 * z2.size - 0.5 * ((x[0] - mean) / sd) ** 2
    for _ in range(ROUNDS):
        u = z2 * np.exp(-2.0 * (x[0] + x[1] * s))
        g = np.array([np.sum(u - 1.0) - (x[0] - mean) / sd**2, s @ (u - 1.0)])
        off = 2.0 * float(s @ u)
        H = np.array([[2.0 * u.sum() + 1.0 / sd**2, off], [off, 2.0 * float(s**2 @ u)]])
        step = np.linalg.solve(H, g)
        x = x + np.clip(step, -0.5, 0.5)
        if np.abs(step).max() < 1e-9:
            break
    level = x[0] + x[1] * s
    two = float(np.sum(-level - 0.5 * z2 * np.exp(-2.0 * level))) - 0.5 * ((x[0] - mean) / sd) ** 2
    return float(x[1]), float(two - one), float(np.sqrt(np.linalg.inv(H)[1, 1]))
