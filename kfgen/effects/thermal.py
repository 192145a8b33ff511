"""Effects of the past of a temperature: its rate, its play.

References
----------
.. [1] F. Preisach, Über die magnetische Nachwirkung, Z. Phys. 94, 1935 (the play operator is his simplest element).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from kfgen.effects.base import Effect, parameter
from kfgen.effects.form import Form, State
from kfgen.effects.series import Series, Sought

Array = NDArray[np.float64]

POINTS = 4096
"""To which a thermometer is thinned before its rate or its play is taken."""
CLEAR = 0.1
"""Share of the rate's size below which its error must be, else it is smoothed more."""
WIDTHS = (0.05, 0.1, 0.15, 0.2, 0.25, 0.3, 0.35, 0.4)
"""Half-widths of hysteresis that are looked for, in the range of the temperature."""


@dataclass(frozen=True)
class TemperatureRate(Effect):
    """A bias proportional to the rate of the temperature: gradients inside, or a thermal lag to first order."""

    coefficient: Any = parameter("U*s/K", "signed")

    name: ClassVar[str] = "temperature_rate"
    title: ClassVar[str] = "bias proportional to the temperature's rate"
    separator: ClassVar[str] = "the same temperatures passed at two speeds"
    saying: ClassVar[str] = "follows the rate of the temperature by {coefficient}"
    driver: ClassVar[str] = "temperature"

    @classmethod
    def sought(cls, series: Series) -> list[Sought]:
        """Where there is a thermometer that moves."""
        return [Sought(cls(0.0))] if moving(series) else []

    def form(self, drive: Mapping[str, Any] | None = None) -> Form:
        """``y = coefficient dT/dt``; the coefficient is a constant state, seen when the driver has a rate."""
        return Form(
            A=((0,),), W=((0,),), C=(0,), x0=(self.coefficient,), states=(State("temperature_rate", "U*s/K"),)
        )

    def mean(self, t: Array, drive: Mapping[str, Array] | None = None) -> Array:
        """Of the recorded temperature, smoothed as much as its noise asks for."""
        return float(self.coefficient) * rate_of(t, drive["temperature"]) if drive else np.zeros(np.size(t))


@dataclass(frozen=True)
class ThermalHysteresis(Effect):
    """A bias that follows the temperature with play: it stays behind by up to `width` either way [1]_."""

    width: Any = parameter("K", "place")
    coefficient: Any = parameter("U/K", "signed")

    name: ClassVar[str] = "thermal_hysteresis"
    rare: ClassVar[float] = 1.0
    title: ClassVar[str] = "thermal hysteresis"
    separator: ClassVar[str] = "the same temperatures passed at two speeds, up and down"
    saying: ClassVar[str] = "follows the temperature by {coefficient} with a play of {width} either way"
    driver: ClassVar[str] = "temperature"

    @classmethod
    def sought(cls, series: Series) -> list[Sought]:
        """Half-widths over the range of a thermometer that turns."""
        if not moving(series):
            return []
        T = series.drive[cls.driver]
        span = float(np.quantile(T, 0.995) - np.quantile(T, 0.005))
        return [Sought(cls(share * span, 0.0)) for share in WIDTHS]

    def form(self, drive: Mapping[str, Any] | None = None) -> Form:
        """The coefficient is a constant state."""
        return Form(
            A=((0,),), W=((0,),), C=(0,), x0=(self.coefficient,), states=(State("thermal_hysteresis", "U/K"),)
        )

    def mean(self, t: Array, drive: Mapping[str, Array] | None = None) -> Array:
        """Of the recorded temperature, shape (n,)."""
        if not drive:
            return np.zeros(np.size(t))
        at, T = thinned(t, drive["temperature"])
        return float(self.coefficient) * np.interp(t, at, play(T, float(self.width)))


def moving(series: Series) -> bool:
    """Whether there is a thermometer that says anything."""
    T = series.drive.get("temperature")
    return T is not None and float(np.ptp(T)) > 0.0


def thinned(t: Array, T: Array) -> tuple[Array, Array]:
    """Means of a temperature at no more than `POINTS` times."""
    block = max(1, T.size // POINTS)
    m = T.size // block
    return (
        t[: m * block].reshape(m, block).mean(axis=1),
        T[: m * block].reshape(m, block).mean(axis=1),
    )


def rate_of(t: Array, T: Array) -> Array:
    """``dT/dt`` [K/s], shape (n,): straight lines over windows just long enough for the thermometer's noise."""
    from scipy.signal import savgol_filter

    at, means = thinned(np.asarray(t), T)
    step = float(at[1] - at[0])
    noise = float(np.sqrt(np.mean(np.diff(means, 3) ** 2) / 20.0))
    window = 5
    while True:
        rate = savgol_filter(means, window, 2, deriv=1, delta=step, mode="interp")
        error = noise * np.sqrt(12.0 / window**3) / step
        if error < CLEAR * float(np.std(rate)) or 4 * window > means.size:
            break
        window = 2 * window + 1
    return np.asarray(np.interp(t, at, rate))


def play(T: Array, width: float) -> Array:
    """The play operator: follows T only where it is further away than `width`, shape (n,)."""
    out, h = np.empty(T.size), float(T[0])
    for k, x in enumerate(T.tolist()):
        h = min(max(h, x - width), x + width)
        out[k] = h
    return out
