"""`TrueScene`: what the sensors of a model should have read along a motion, before any effect."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kfgen.core.errors import InputError
from kfgen.effects import Effect
from kfgen.effects.inertial.felt import Signals
from kfgen.effects.inertial.vibration import vibration_power
from kfgen.manoeuvre.motion import Motion
from kfgen.manoeuvre.rotations import as_matrix, rotated
from kfgen.manoeuvre.truth import Path, fine_times, level_at, numeric
from kfgen.model.discretise import DiscreteModel
from kfgen.model.filter import FilterModel
from kfgen.model.parts.motion import AFTER, Input
from kfgen.model.parts.reading import speed_squared
from kfgen.model.parts.sensors import Sensor
from kfgen.simulate.interval import FORCE, RATE, by_convention, interval_samples, middle
from kfgen.simulate.rates import rows_of
from kfgen.simulate.true_effects import true_effects
from kfgen.simulate.vibration import Vibration

Array = NDArray[np.float64]
Part = Input | Sensor
ACCELS = tuple(f"accel_{a}" for a in "xyz")


@dataclass(frozen=True)
class TrueScene:
    """A model along a motion.

    Parameters
    ----------
    discrete : DiscreteModel
        Its `rate` is the log's.
    motion : Motion
        At the log's times.
    constants : mapping of str to float
        Truth of the constant states [SI].
    wander : mapping of str to ndarray, shape (n,)
        Courses of what noise alone moves [SI].
    rates : mapping of str to float
        Of the sensors by name [Hz].
    drive : mapping of str to ndarray, shape (n,)
        Drivers of effects [SI].
    shaken : Vibration, optional
        Where no velocity of the model takes it up, the accelerometers show it.
    samples_are : str
        What a sample of the inputs stands for, where it is not as the model has it.
    """

    discrete: DiscreteModel
    motion: Motion
    constants: Mapping[str, float]
    wander: Mapping[str, Array]
    rates: Mapping[str, float]
    drive: Mapping[str, Array]
    shaken: Vibration | None = None
    samples_are: str = ""

    @property
    def model(self) -> FilterModel:
        """The model."""
        return self.discrete.model

    @cached_property
    def ideal(self) -> FilterModel:
        """The model without the errors of its readings."""
        return self.path.ideal

    @cached_property
    def effects(self) -> dict[str, tuple[Effect, ...]]:
        """Of every place, with their true values."""
        return true_effects(self.model, self.constants)

    @property
    def t(self) -> Array:
        """Times of the log [s], shape (n,)."""
        return self.motion.t

    @property
    def dt(self) -> float:
        """Sampling period of the log [s]."""
        return 1.0 / self.discrete.rate

    @property
    def samples(self) -> str:
        """What a sample of the inputs stands for."""
        return self.samples_are or str(self.model.motion.chosen.get("samples", AFTER))

    @cached_property
    def fine(self) -> Array:
        """The even fine grid of the truth, to the end of the last interval [s]."""
        return fine_times(self.t, float(self.t[-1]) + self.dt)

    @cached_property
    def path(self) -> Path:
        """The true motion at the fine times."""
        return Path(self.model, self.motion, self.constants, self.fine)

    def values(self, times: Array) -> dict[str, Array]:
        """Every symbol at times of the path's grid, held at its ends, each of shape (m,)."""
        at = self.path.places(np.clip(times, self.path.t[0], self.path.t[-1]))
        found = self.path.values(at)
        return found | {n: np.interp(times, self.t, w) for n, w in self.wander.items()}

    @cached_property
    def instants(self) -> dict[str, Array]:
        """Every symbol at the log's times."""
        return self.values(self.t)

    @cached_property
    def _inputs(self) -> dict[str, Array]:
        """Samples of the inputs by channel, by what a sample stands for, shape (n,)."""
        channels = [c for i in self.model.motion.inputs for c in i.channels]
        for c in channels:
            if self.model.attitude is None or c not in self.instants:
                raise InputError(
                    f"no manoeuvre says what the input '{c}' of {self.model.name} is",
                    remedy="Simulate a model that moves, or gyro-static with a noise file",
                )
        if not channels:
            return {}
        edges = np.append(self.t, self.fine[-1])
        means = interval_samples(self.path, edges)
        return {c: by_convention(means[c], self.instants[c], self.samples) for c in channels}

    def rows(self, part: Part) -> NDArray[np.intp]:
        """The rows of the log at which a part has a sample."""
        rate = self.rates.get(part.name, self.discrete.rate) if isinstance(part, Sensor) else 0.0
        return rows_of(self.t.size, self.discrete.rate, rate) if rate else np.arange(self.t.size)

    def times(self, part: Part) -> Array:
        """Even times of a part's samples [s]."""
        rows = self.rows(part)
        every = self.dt if rows.size == self.t.size else 1.0 / self.rates[part.name]
        return np.asarray(self.t[0] + np.arange(rows.size) * every)

    def clean(self, part: Part) -> Array:
        """What a part should read at its samples, shape (samples, channels) [SI]."""
        if isinstance(part, Input):
            return np.column_stack([self._inputs[c] for c in part.channels])
        return self.sensed(part, self.t[self.rows(part)])

    def sensed(self, sensor: Sensor, times: Array, arm: Array | None = None) -> Array:
        """What a sensor should read at times (m,): shape (m, channels).

        Parameters
        ----------
        arm : ndarray, shape (3,), optional
            From where its point is to where it really is, in body axes [m].
        """
        rows = numeric(list(self.model.clean(sensor)), self.values(times))
        out = np.column_stack([np.broadcast_to(r, times.size) for r in rows])
        if self.shaken is not None and "v" not in {b.name for b in self.model.blocks}:
            for k, c in enumerate(sensor.channels):
                out[:, k] += self.shaken(times)[:, ACCELS.index(c)] if c in ACCELS else 0.0
        return out if arm is None else out + self._moved_by(sensor, arm, times)

    def _moved_by(self, sensor: Sensor, arm: Array, times: Array) -> Array:
        """What a lever arm adds to a position or a velocity in navigation axes, shape (m, 3)."""
        values = self.values(times)
        at = self.path.places(np.clip(times, self.path.t[0], self.path.t[-1]))
        offset = np.broadcast_to(arm, (times.size, 3))
        if sensor.shows == "v":
            omega = numeric(list(self.ideal.rates(False)["phi"]), values)
            offset = np.cross(np.column_stack([np.broadcast_to(w, times.size) for w in omega]), offset)
        return rotated(self.path.q[at], offset)

    def triad(self, unit: str, name: str) -> Array | None:
        """Rate or specific force in body axes at the log's rows, shape (n, 3); None where the model has none."""
        for i in self.model.motion.inputs:
            if i.unit == unit and not i.scalar:
                return self.clean(i)
        for s in self.model.sensors:
            if s.name == name and len(s.channels) == 3:
                return self.sensed(s, self.t)
        if unit == FORCE and self.shaken is not None:
            return self.shaken(self.t)
        return None

    @cached_property
    def _body(self) -> tuple[Array | None, Array | None, Array | None]:
        """Rate, specific force and its running variance at the log's rows, each (n, 3)."""
        omega, force = self.triad(RATE, "gyro"), self.triad(FORCE, "accel")
        return omega, force, None if force is None else vibration_power(force, self.dt)

    @property
    def vibration(self) -> Array | None:
        """Standard deviation of the specific force about its motion, of all axes together [m/s^2], shape (n,)."""
        power = self._body[2]
        return None if power is None else np.sqrt(power.sum(axis=1))

    def signals(self, part: Part, y: Array) -> Signals:
        """What moved, as effects of a part take it; `y` (samples, channels) is what it should have read."""
        rows, t = self.rows(part), self.times(part)
        omega, force, power = (None if x is None else x[rows] for x in self._body)
        wide = np.zeros((rows.size, max(3, y.shape[1])))
        wide[:, : y.shape[1]] = y
        warmth = self.drive.get("temperature")
        R_bn = self._level(part) if self.model.attitude is not None else None
        speed2 = speed_squared(self.model, self.values(t))
        warm = None if warmth is None else warmth[rows]
        return Signals(t, wide, omega, force, R_bn, 1.0, power, warm, speed_squared=speed2)

    def _level(self, part: Part) -> Array:
        """North-east-down to body axes in the middle of what a part's samples stand for, shape (samples, 3, 3)."""
        off = middle(self.samples) * self.dt if isinstance(part, Input) else 0.0
        times = np.clip(self.t[self.rows(part)] + off, self.path.t[0], self.path.t[-1])
        R_nb = as_matrix(self.path.q[self.path.places(times)])
        return np.swapaxes(level_at(self.model, self.path.known) @ R_nb, 1, 2)

    def passed(self, part: Part, clean: Array, k: int, lags: list[Any], arm: Array | None = None) -> Array:
        """A channel through its lags, from the fine truth, shape (samples,)."""
        fine, step = self.fine, float(self.fine[1] - self.fine[0])
        if isinstance(part, Input):
            now = self.values(fine)[part.channels[k]]
        else:
            now = self.sensed(part, fine, arm)[:, k]
        then = now
        for lag in lags:
            then = lag.passed(then, step)
        away = then - now
        every = round(self.dt / step)
        if isinstance(part, Sensor):
            return clean + away[: self.t.size * every : every][self.rows(part)]
        whole = 0.5 * (away[1:] + away[:-1])
        means = whole[: self.t.size * every].reshape(-1, every).mean(axis=1)
        instants = away[: self.t.size * every : every]
        return clean + by_convention(means, instants, self.samples)
