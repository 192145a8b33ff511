"""Effects of the past of a temperature: its rate, its hysteresis; of the past of any driver: a lag behind it.

References
----------
.. [1] F. Preisach, Über die magnetische Nachwirkung, Z. Phys. 94, 1935 (the hysteresis with this dead band, backlash, is his simplest element).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache
from itertools import pairwise
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from kfgen.effects.driven.first_order_lag import behind
from kfgen.effects.driven.proportional import driver_named, is_channel, of_channel
from kfgen.effects.effect import Effect, parameter
from kfgen.effects.filter_role import DrivenOutput, FilterPlace, FilterRole, StoredValue
from kfgen.effects.linear_system import LinearSystem, State
from kfgen.effects.series import Detection, WhiteSeries

Array = NDArray[np.float64]

POINTS = 4096
"""To which a thermometer is thinned before its rate or its hysteresis is computed."""
CLEAR = 0.1
"""Share of the rate's size by which it may differ from that of a window twice as long, else it is smoothed more."""
WIDTHS = (0.05, 0.1, 0.15, 0.2, 0.25, 0.3, 0.35, 0.4)
"""Half-widths of hysteresis that are looked for, in the range of the temperature."""
LAGGED = "lagged:"
"""Before the name of a channel: the effect of its past."""
SHORTEST, LONGEST, LAGS = 1e-3, 0.15, 13
"""Lags that are looked for: of the record, how many."""
ALIKE = 0.95
"""Squared cosine between a course and itself behind beyond which there is no lag to see."""


RATE_LAG_S = 10.0
"""Lag against which a filter takes the rate of a temperature [s]: thermometers are noisy, housings slow."""


def lag_of(driver: str, lag: Any) -> StoredValue:
    """A driver behind a first-order lag [s], by an implicit step, which no length of the step makes unstable."""
    return StoredValue(
        "behind",
        driver_named(driver).unit,
        f"{driver} behind a lag",
        driver,
        lambda x, u, dt: x + (u - x) * dt / (lag + dt),
    )


@dataclass(frozen=True)
class TemperatureRate(Effect):
    """A bias proportional to the rate of the temperature: gradients inside, or a thermal lag to first order."""

    coefficient: Any = parameter("U*s/K", "signed")

    name: ClassVar[str] = "temperature_rate"
    title: ClassVar[str] = "bias proportional to the temperature's rate"
    separating_experiment: ClassVar[str] = "the same temperatures passed at two speeds"
    sentence_template: ClassVar[str] = "follows the rate of the temperature by {coefficient}"
    driver: ClassVar[str] = "temperature"

    @classmethod
    def detect(cls, series: WhiteSeries) -> list[Detection]:
        """Where there is a thermometer that moves."""
        return [Detection(cls(0.0))] if moving(series) else []

    def form(self, drive: Mapping[str, Any] | None = None) -> LinearSystem:
        """``y = coefficient dT/dt``; the coefficient is a constant state, seen when the driver has a rate."""
        return LinearSystem(
            A=((0,),), W=((0,),), C=(0,), x0=(self.coefficient,), states=(State("temperature_rate", "U*s/K"),)
        )

    def in_filter(self, place: FilterPlace) -> FilterRole:
        """The distance from the temperature behind a lag, over that lag: its rate, as late as that."""
        stored = lag_of(self.driver, RATE_LAG_S)
        return DrivenOutput(lambda driver, behind: (driver - behind) / RATE_LAG_S, self.driver, stored)

    def mean(self, t: Array, drive: Mapping[str, Array] | None = None) -> Array:
        """Of the recorded temperature, smoothed as much as its noise asks for."""
        return float(self.coefficient) * rate_of(t, drive["temperature"]) if drive else np.zeros(np.size(t))


@dataclass(frozen=True)
class ThermalHysteresis(Effect):
    """A bias that follows the temperature with hysteresis: it stays behind by up to `width` either way [1]_."""

    width: Any = parameter("K", "place")
    coefficient: Any = parameter("U/K", "signed")

    name: ClassVar[str] = "thermal_hysteresis"
    prior_penalty_nats: ClassVar[float] = (
        2.0  # most sensors go with the temperature: a hysteresis of any width bends to fit a drift or a step
    )
    title: ClassVar[str] = "thermal hysteresis"
    separating_experiment: ClassVar[str] = "the same temperatures passed at two speeds, up and down"
    sentence_template: ClassVar[str] = (
        "follows the temperature by {coefficient} with a hysteresis of {width} either way"
    )
    driver: ClassVar[str] = "temperature"

    @classmethod
    def detect(cls, series: WhiteSeries) -> list[Detection]:
        """Half-widths over the range of a thermometer that turns."""
        if not moving(series):
            return []
        T = series.drive[cls.driver]
        span = float(np.quantile(T, 0.995) - np.quantile(T, 0.005))
        return [Detection(cls(share * span, 0.0)) for share in WIDTHS]

    def form(self, drive: Mapping[str, Any] | None = None) -> LinearSystem:
        """The coefficient is a constant state."""
        return LinearSystem(
            A=((0,),), W=((0,),), C=(0,), x0=(self.coefficient,), states=(State("thermal_hysteresis", "U/K"),)
        )

    def in_filter(self, place: FilterPlace) -> FilterRole:
        """The hysteresis operator of the temperature is kept beside the state."""
        import sympy as sp

        def follow(stood: Any, driver: Any, dt: Any) -> Any:
            pushed = sp.Rational(1, 2) * (driver - self.width + stood + sp.Abs(driver - self.width - stood))
            return sp.Rational(1, 2) * (pushed + driver + self.width - sp.Abs(pushed - driver - self.width))

        stored = StoredValue("stood", "K", "temperature within its hysteresis", self.driver, follow)
        return DrivenOutput(lambda _, stood: stood, self.driver, stored)

    def mean(self, t: Array, drive: Mapping[str, Array] | None = None) -> Array:
        """Of the recorded temperature, shape (n,)."""
        if not drive:
            return np.zeros(np.size(t))
        at, T = course_of(t, drive["temperature"])
        return float(self.coefficient) * np.interp(t, at, hysteresis(T, float(self.width)))


@dataclass(frozen=True)
class Lagged(Effect):
    """A bias that follows a recorded channel through one pole of time constant `lag`, ``lagged:NAME``."""

    lag: Any = parameter("s", "place")
    coefficient: Any = parameter("U", "signed")

    name: ClassVar[str] = "lagged"
    prior_penalty_nats: ClassVar[float] = (
        3.0  # most drivers act at once: a lag of any length bends to fit a drift
    )
    title: ClassVar[str] = "bias behind another channel"
    separating_experiment: ClassVar[str] = (
        "that channel changed at two speeds: a lag shrinks with the slow one, a hysteresis does not"
    )
    sentence_template: ClassVar[str] = "follows the other channel by {coefficient}, {lag} behind it"

    @classmethod
    def detect(cls, series: WhiteSeries) -> list[Detection]:
        """Lags behind the channel that shows best, of those that drive no other effect."""
        names = [n for n in series.drive if n != "temperature" and is_channel(n)]
        found = [lagged(n).lags(series) for n in names]
        best = max(found, key=lambda f: f[0], default=(0.0, []))[1]
        chance = -float(np.log(max(len(names), 1)))
        return [replace(s, located=chance) for s in best]

    @classmethod
    def lags(cls, series: WhiteSeries) -> tuple[float, list[Detection]]:
        """The best regression in standard deviations, and the lags whose course is not that of the channel itself."""
        x, best, out = series.drive[cls.driver], 0.0, []
        _, u0 = series.regression(x)
        for lag in np.geomspace(SHORTEST, LONGEST, LAGS) * series.n * series.dt:
            z, u = series.regression(behind(series.t, x[:, None], float(lag), x[:1])[:, 0])
            alike = float(u @ u0) ** 2 / max(float(u @ u) * float(u0 @ u0), 1e-300)
            if alike < ALIKE and lag > 5.0 * series.dt:
                out.append(Detection(cls(float(lag), 0.0)))
                best = max(best, abs(z))
        return best, out

    def form(self, drive: Mapping[str, Any] | None = None) -> LinearSystem:
        """The coefficient is a constant state."""
        name, unit = self.name.replace(":", "_"), self.parameters()[1].unit
        return LinearSystem(A=((0,),), W=((0,),), C=(0,), x0=(self.coefficient,), states=(State(name, unit),))

    def in_filter(self, place: FilterPlace) -> FilterRole:
        """The driver behind the lag is kept beside the state."""
        return DrivenOutput(lambda _, behind: behind, self.driver, lag_of(self.driver, self.lag))

    def mean(self, t: Array, drive: Mapping[str, Array] | None = None) -> Array:
        """Of the recorded channel, shape (n,)."""
        if not drive:
            return np.zeros(np.size(t))
        x = drive[self.driver][:, None]
        return float(self.coefficient) * behind(np.asarray(t), x, float(self.lag), x[0])[:, 0]


@dataclass(frozen=True)
class ThermalLag(Lagged):
    """A bias that follows the temperature through one pole: what is warm is not where the thermometer is."""

    coefficient: Any = parameter("U/K", "signed")

    name: ClassVar[str] = "thermal_lag"
    title: ClassVar[str] = "bias behind the temperature"
    sentence_template: ClassVar[str] = "follows the temperature by {coefficient}, {lag} behind it"
    driver: ClassVar[str] = "temperature"

    @classmethod
    def detect(cls, series: WhiteSeries) -> list[Detection]:
        """Lags behind a thermometer that moves."""
        return cls.lags(series)[1] if moving(series) else []


@cache
def lagged(channel: str) -> type[Lagged]:
    """The effect of a channel whose name is plain."""
    return of_channel(Lagged, channel)


def moving(series: WhiteSeries) -> bool:
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
    """``dT/dt`` [K/s], shape (n,): parabolas over windows just long enough for the thermometer's noise."""
    at, means = thinned(np.asarray(t), T)
    return np.asarray(np.interp(t, at, _smoothed(means, float(at[1] - at[0]))[0]))


def course_of(t: Array, T: Array) -> tuple[Array, Array]:
    """Times [s] and temperatures [K] without the thermometer's noise, which a hysteresis would follow to its peaks."""
    at, means = thinned(np.asarray(t), T)
    return at, _smoothed(means, float(at[1] - at[0]))[1]


def _smoothed(means: Array, step: float) -> tuple[Array, Array]:
    """Rate and course by parabolas over windows just long enough for the noise, shapes (m,)."""
    from scipy.signal import savgol_filter

    windows = [5]
    while 8 * windows[-1] < means.size:
        windows.append(2 * windows[-1] + 1)
    windows = [w for w in windows if w < means.size]
    rates = [savgol_filter(means, w, 2, deriv=1, delta=step, mode="interp") for w in windows]
    # Too short a window leaves noise, too long a one leaves the course: between both a rate does not change.
    differences = [float(np.std(a - b)) for a, b in pairwise(rates)]
    calm = next((k for k, d in enumerate(differences) if d < CLEAR * float(np.std(rates[k + 1]))), None)
    best = calm if calm is not None else int(np.argmin(differences)) if differences else 0
    return rates[best], savgol_filter(means, windows[best], 2, mode="interp")


def hysteresis(T: Array, width: float) -> Array:
    """The hysteresis operator: follows T only where it is further away than `width`, shape (n,)."""
    out, h = np.empty(T.size), float(T[0])
    for k, x in enumerate(T.tolist()):
        h = min(max(h, x - width), x + width)
        out[k] = h
    return out
