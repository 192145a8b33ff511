"""Effects between what a plant does and what a channel shows of it: a slow sensor, a backlash."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from kfgen.effects.driven.composed import composed
from kfgen.effects.driven.first_order_lag import behind
from kfgen.effects.effect import parameter
from kfgen.effects.plant.terms import PlantEffect

Array = NDArray[np.float64]


@dataclass(frozen=True)
class SensorChange(PlantEffect):
    """A change between what the plant does and what a channel shows."""

    acts: ClassVar[str] = "channel"

    @property
    def lag(self) -> Any:
        """Time constant of a first-order lag [s]; zero for none."""
        return 0.0

    @property
    def backlash(self) -> Any:
        """Width of a backlash; zero for none."""
        return 0.0

    def shown(self, t: Array, h: Array) -> Array:
        """What the channel shows of the true values `h` at times `t` [s], shape (n, batch)."""
        raise NotImplementedError

    def begun(self, t: Array, y: Array) -> Array | None:
        """One standard deviation of what it may have begun with, which nobody knows, shape (n, batch).

        Parameters
        ----------
        t : ndarray, shape (n,)
            Times [s].
        y : ndarray, shape (n, batch)
            What it shows.
        """
        return None


@dataclass(frozen=True)
class SensorLag(SensorChange):
    """A sensor that follows with a first-order lag; before the record the motion went on as it begins."""

    tau: Any = parameter("s", "time")

    name: ClassVar[str] = "sensor_lag"
    title: ClassVar[str] = "lag of a sensor"
    separating_experiment: ClassVar[str] = "motion at two frequencies a factor of three apart"
    sentence_template: ClassVar[str] = "lags behind by {tau}"

    @property
    def seconds(self) -> Any:
        """By how much a slow signal is late [s]."""
        return self.tau

    @property
    def lag(self) -> Any:
        """The time constant [s]."""
        return self.tau

    def shown(self, t: Array, h: Array) -> Array:
        """Exact for a value that is linear between the samples."""
        slope = np.diff(h[:3], axis=0) / np.diff(t[:3])[:, None]
        first = 1.5 * slope[0] - 0.5 * slope[-1] if len(slope) else np.zeros(h.shape[1])
        return behind(t, h, self.tau, h[0] - np.asarray(self.tau) * first)

    def begun(self, t: Array, y: Array) -> Array:
        """``exp(-t / tau)``, as large as it lags behind all along and at first, where it may have rested: ``tau dy/dt``."""
        tau = np.atleast_1d(np.asarray(self.tau, dtype=np.float64))
        slope = np.diff(y, axis=0) / np.diff(t)[:, None]
        with np.errstate(over="ignore", invalid="ignore"):  # of a simulation that runs away
            late = tau * np.sqrt(np.mean(slope**2, axis=0) + slope[0] ** 2)
            return np.asarray(late * np.exp(-(t - t[0])[:, None] / tau))


@dataclass(frozen=True)
class Backlash(SensorChange):
    """Backlash between the plant and its sensor: the channel follows once the backlash is used up."""

    width: Any = parameter("U", "size")

    name: ClassVar[str] = "backlash"
    title: ClassVar[str] = "backlash"
    separating_experiment: ClassVar[str] = "reversals at two speeds"
    sentence_template: ClassVar[str] = "has a backlash of {width}"

    @property
    def backlash(self) -> Any:
        """The width."""
        return self.width

    def shown(self, t: Array, h: Array) -> Array:
        """The backlash operator, from the middle of the backlash: each sample holds the value between two limits."""
        half = np.asarray(self.width) / 2.0
        limits = np.array(np.broadcast_arrays(h - half, h + half))
        limits[:, 0] = h[0]
        return np.asarray(composed(limits, _held_within)[0])


def _held_within(then: Array, before: Array) -> Array:
    """Limits after others: both of these held between the later ones."""
    return np.asarray(np.minimum(np.maximum(before, then[0]), then[1]))
