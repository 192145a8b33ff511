"""Lags: the signals pass through them before other effects add to them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from kfgen.effects.effect import Effect, parameter
from kfgen.effects.filter_role import FilterPlace, FilterRole, NotModelled, ReadingLag
from kfgen.effects.inertial.felt import Signals, Splined, spline_of
from kfgen.effects.inertial.inertial_error import InertialError

Array = NDArray[np.float64]

MOST_UNHEARD = 0.2
"""Share of a log that a lag may leave without a truth; a longer memory starts from rest."""
FORGOTTEN_AFTER = 10.0
"""Time constants of a pole, after which ``exp(-10)`` of a wrong start is left."""
EARLY_RARER_BY_NATS = 2.2
"""By which it is rarer that a reading is early, which takes a reference that is late: one delay in ten."""
MAX_NOISE_SIGMAS = 4.0
"""Standard deviations up to which what is left may be noise, where nobody knows what a lag did."""


@dataclass(frozen=True)
class Lag(InertialError):
    """An effect through which the signals pass before others add to them."""

    sensors: ClassVar[tuple[str, ...]] = ("gyro", "accel", "mag")

    def passed(self, x: Array, dt: float, splined: Splined = spline_of) -> Array:
        """What becomes of signals along the first axis, shape (n, ...); `splined` gives their spline."""
        raise NotImplementedError

    def memory(self) -> tuple[float, float]:
        """How long before and after a time the signal matters for the reading [s]."""
        raise NotImplementedError

    @property
    def seconds(self) -> Any:
        """By how much a slow signal is late [s], in numbers or symbols."""
        raise NotImplementedError

    def in_filter(self, place: FilterPlace) -> FilterRole:
        """A reading that is late, to first order; an input cannot be asked for what comes later."""
        if place.measured:
            return ReadingLag()
        return NotModelled(
            "a filter is driven by its inputs as they come and cannot know what they will be",
            f"Take {float(self.seconds):.4g} s off the time stamps of {place.channel}",
        )

    def knee(self) -> float:
        """Frequency [Hz] of motion that it turns by about a radian: far below, every lag is a delay."""
        raise NotImplementedError

    def distinguishing_experiment(self, other: str) -> str:
        """From another lag: motion so fast that one keeps what the other weakens, by 4 % at a third of the knee."""
        if other not in {cls.name for cls in Lag.__subclasses__()}:
            return self.separating_experiment
        return f"motion at {self.knee() / 3.0:.2g} Hz or faster, logged as fast as it needs,"

    def output(self, signals: Signals, axis: int) -> Array:
        """What it alone changes."""
        u = signals.y[:, axis]
        return np.asarray(self.passed(u, signals.dt) - u)


def unheard(t: Array, effects: Sequence[Effect]) -> NDArray[np.bool_]:
    """Where a reading depends on what was before the first or is after the last sample, shape (n,)."""
    out = np.zeros(t.size, dtype=np.bool_)
    half = (
        0.5 * float(t[-1] - t[0]) / max(t.size - 1, 1)
    )  # of a period: what is missing then is next to nothing
    for lag in (e for e in effects if isinstance(e, Lag)):
        before, after = lag.memory()
        if before > half:
            out |= t < t[0] + before
        if after > half:
            out |= t > t[-1] - after
    return out if out.sum() < MOST_UNHEARD * out.size else np.zeros_like(out)


@dataclass(frozen=True)
class TimeDelay(Lag):
    """The reading is that of an earlier time; a negative delay is one of the reference."""

    delay: Any = parameter("s", "signed")

    name: ClassVar[str] = "time_delay"
    typical: ClassVar[Mapping[str, str]] = {"gnss": "0.1 s", "baro": "0.2 s", "": "0.05 s"}
    title: ClassVar[str] = "time delay"
    separating_experiment: ClassVar[str] = "motion at two frequencies a factor of three apart"
    sentence_template: ClassVar[str] = "lags by {delay}"

    @property
    def seconds(self) -> Any:
        """The delay."""
        return self.delay

    def rarer_by_nats(self) -> float:
        """More than others where it is early."""
        return self.prior_penalty_nats + (EARLY_RARER_BY_NATS if self.delay < 0.0 else 0.0)

    def memory(self) -> tuple[float, float]:
        """The delay itself."""
        return max(float(self.delay), 0.0), max(-float(self.delay), 0.0)

    def knee(self) -> float:
        """``1 / (2 pi delay)``."""
        return 1.0 / (2.0 * np.pi * max(abs(float(self.delay)), 1e-300))

    def passed(self, x: Array, dt: float, splined: Splined = spline_of) -> Array:
        """Signals, shape (n, ...), as they were `delay` earlier, by a cubic spline; held at the ends."""
        if self.delay == 0.0:
            return x
        at = np.arange(x.shape[0], dtype=np.float64)
        then = np.clip(at - float(self.delay) / dt, 0.0, at[-1])
        return np.asarray(splined(x)(then))


@dataclass(frozen=True)
class ClockDrift(Lag):
    """Time stamps that run away: the reading at a time since the first sample is that of ``1 - rate`` times this time."""

    rate: Any = parameter("ppm", "signed")

    name: ClassVar[str] = "clock_drift"
    title: ClassVar[str] = "clock that drifts against the others"
    separating_experiment: ClassVar[str] = "motion at the beginning and at the end of a long log"
    sentence_template: ClassVar[str] = "has time stamps that drift by {rate}"
    prior_penalty_nats: ClassVar[float] = 1.5
    typical: ClassVar[Mapping[str, str]] = {"": "500 ppm"}

    @property
    def seconds(self) -> Any:
        """After the first second."""
        return self.rate

    def in_filter(self, place: FilterPlace) -> FilterRole:
        """A delay that grows for ever, which no filter waits for."""
        return NotModelled(
            "a delay that grows without end is no constant of a filter",
            f"Synchronise the clock of {place.channel}, or correct its time stamps before the filter",
        )

    def memory(self) -> tuple[float, float]:
        """None at the first sample, from which it grows."""
        return 0.0, 0.0

    def knee(self) -> float:
        """That of the delay after a second."""
        return 1.0 / (2.0 * np.pi * max(abs(float(self.rate)), 1e-300))

    def passed(self, x: Array, dt: float, splined: Splined = spline_of) -> Array:
        """Signals, shape (n, ...), at ``(1 - rate) t``, by a cubic spline; held at the ends."""
        if self.rate == 0.0:
            return x
        at = np.arange(x.shape[0], dtype=np.float64)
        then = np.clip((1.0 - float(self.rate)) * at, 0.0, at[-1])
        return np.asarray(splined(x)(then))


@dataclass(frozen=True)
class Bandwidth(Lag):
    """The reading passes a low-pass of first order."""

    corner: Any = parameter("Hz", "frequency")

    name: ClassVar[str] = "bandwidth"
    typical: ClassVar[Mapping[str, str]] = {"": "1.5 Hz"}
    shrinks_with_size: ClassVar[bool] = True
    title: ClassVar[str] = "finite bandwidth"
    separating_experiment: ClassVar[str] = "motion at two frequencies a factor of three apart"
    prior_penalty_nats: ClassVar[float] = 1.5
    sentence_template: ClassVar[str] = "follows its input up to {corner} only"

    @property
    def seconds(self) -> Any:
        """The time constant, ``1 / (2 pi corner)``."""
        return 1 / (2 * np.pi * self.corner)

    def memory(self) -> tuple[float, float]:
        """What is not forgotten."""
        return FORGOTTEN_AFTER * float(self.seconds), 0.0

    def knee(self) -> float:
        """The corner."""
        return float(self.corner)

    def passed(self, x: Array, dt: float, splined: Splined = spline_of) -> Array:
        """Signals, shape (n, ...), behind ``seconds * y' = x - y``, as if they had come as they go on from the first.

        Exact for the cubic spline through the samples. It is causal: what a spectrum does to the ends of a record would
        decide between a pole and a delay.
        """
        from scipy.signal import lfilter

        tau = float(self.seconds) / dt
        before = min(int(FORGOTTEN_AFTER * tau) + 2, x.shape[0] - 1)
        c = splined(x, before).c
        fed = np.tensordot(_fed(tau), c[::-1], axes=1)
        phi = np.exp(-1.0 / tau)
        y = lfilter([1.0], [1.0, -phi], np.concatenate([c[-1, :1], fed]), axis=0)
        return np.asarray(y[before:])


def _fed(tau: float) -> Array:
    """What 1, s, s^2 and s^3 feed to a pole of time constant `tau` while s goes from 0 to 1, shape (4,)."""
    if tau > 0.5:
        s, w = np.polynomial.legendre.leggauss(16)
        s = 0.5 * (s + 1.0)
        return np.asarray(np.vander(s, 4, increasing=True).T @ (0.5 * w * np.exp((s - 1.0) / tau)) / tau)
    out = [1.0 - np.exp(-1.0 / tau)]
    for k in (1, 2, 3):  # by parts
        out.append(1.0 - k * tau * out[-1])
    return np.array(out)
