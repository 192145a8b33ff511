"""Errors of inertial and magnetic sensors in a plant's log: those that compete where sensors move, by their channels' names.

A measurement called ``gyro_z`` is a gyro's, whatever the format of the model: it may have a wrong scale, feel forces or be late.
What the triad should have read is what the plant's model says of it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from kfgen.core.channel_names import AXES, acts_on, sensor_and_axis
from kfgen.effects import Effect
from kfgen.effects.inertial.felt import Signals
from kfgen.effects.inertial.lag import MAX_NOISE_SIGMAS, Lag, unheard
from kfgen.effects.inertial.vibration import vibration_power
from kfgen.effects.plant.terms import PlantEffect
from kfgen.gap.core.drivers import recorded
from kfgen.gap.motion.candidates import MotionCandidates, offers
from kfgen.gap.motion.placed_effects import delayed, is_motion, with_errors
from kfgen.gap.motion.truth import Truth
from kfgen.gap.scene.scene import Placed, ScenePoint
from kfgen.log.log import Log

Array = NDArray[np.float64]

SENSORS = ("gyro", "accel", "mag")


def is_sensor_error(effect: Effect) -> bool:
    """Whether an effect is one of a sensor that moves: its own error, or a drift that adds to what it shows."""
    return not isinstance(effect, PlantEffect)


def without_sensor_errors(point: ScenePoint) -> ScenePoint:
    """A point as the plant itself knows it."""
    return ScenePoint(tuple(p for p in point.placed if not is_sensor_error(p.effect)), point.unknowns)


@dataclass(frozen=True)
class SensorErrors:
    """The sensors of a plant's log.

    Parameters
    ----------
    log : Log
    inputs : mapping of str to ndarray, shape (n,)
        Of the plant [SI]; of those called ``ref_gyro_z`` or ``gyro_z`` a triad is completed.
    noise : mapping of str to float
        Standard deviation of a sample of every measurement [SI].
    own : tuple of Placed
        The errors that the model has.
    """

    log: Log
    inputs: Mapping[str, Array]
    noise: Mapping[str, float]
    own: tuple[Placed, ...] = ()

    @cached_property
    def channels(self) -> tuple[str, ...]:
        """The measurements of gyros, accelerometers and magnetometers."""
        return tuple(n for n in self.noise if sensor_and_axis(n)[0] in SENSORS)

    def added(self, shown: Mapping[str, Array], points: Sequence[ScenePoint]) -> Mapping[str, Array]:
        """What the channels show with the errors at points, each of shape (n, points).

        Parameters
        ----------
        shown : mapping of str to ndarray, shape (n, points)
            What they should read.
        points : sequence of ScenePoint
        """
        errors = [[p for p in (*self.own, *q.placed) if is_sensor_error(p.effect)] for q in points]
        if not any(errors):
            return shown
        out = {n: np.array(v) for n, v in shown.items()}
        for j, placed in enumerate(errors):
            for name in out if placed else ():
                here = [p.effect for p in placed if acts_on(p.where, name)]
                if here:
                    out[name][:, j] = self._read(name, {n: v[:, j] for n, v in shown.items()}, here)
        return out

    def _read(self, name: str, shown: Mapping[str, Array], effects: Sequence[Effect]) -> Array:
        """What one channel reads, shape (n,); where its lag reaches before the record, what it reads without it if that may
        be, else what was measured.
        """
        sensor, axis = sensor_and_axis(name)
        felt = delayed(self._signals(sensor, shown), effects)
        y = with_errors(felt, axis, effects, self._drive)
        unknown = unheard(felt.t, effects)
        if not unknown.any():
            return y
        others = [e for e in effects if not isinstance(e, Lag)]
        plain = with_errors(self._signals(sensor, shown), axis, others, self._drive)
        away = np.abs(np.nan_to_num(self.log.channels[name].values) - plain)
        there = np.where(away > MAX_NOISE_SIGMAS * self.noise[name], self._measured(name), plain)
        return np.where(unknown, there, y)

    def _measured(self, name: str) -> Array:
        """What was measured less assumed noise, always the same, shape (n,)."""
        noise = np.random.default_rng(0).standard_normal(self.log.n) * self.noise[name]
        return np.asarray(np.nan_to_num(self.log.channels[name].values) - noise)

    @cached_property
    def _drive(self) -> dict[str, Array]:
        return recorded(self.log)

    def _triad(self, sensor: str, shown: Mapping[str, Array]) -> tuple[Array, tuple[int, ...]]:
        """What a triad should read, shape (n, 3), and its axes that are known; the others are zero."""
        out, known = np.zeros((self.log.n, 3)), []
        for k, a in enumerate(AXES):
            names = (f"{sensor}_{a}", f"ref_{sensor}_{a}")
            found = next((src[n] for n in names for src in (shown, self.inputs) if n in src), None)
            if found is not None:
                out[:, k] = found
                known.append(k)
        if not known and sensor in shown:
            out[:, 0], known = shown[sensor], [0]
        return out, tuple(known)

    def _signals(self, sensor: str, shown: Mapping[str, Array]) -> Signals:
        y, _ = self._triad(sensor, shown)
        omega, turned = self._triad("gyro", shown)
        force, pushed = self._triad("accel", shown)
        t = np.linspace(0.0, self.log.duration, self.log.n)
        f_b = force if pushed else None
        power = vibration_power(force, self.log.dt) if len(pushed) == 3 else None
        return Signals(
            t, y, omega if turned else None, f_b, power=power, warmth=self._drive.get("temperature")
        )

    def candidates(self, shown: Mapping[str, Array], placed: Sequence[Placed]) -> list[list[Placed]]:
        """Every addition that the motion allows, with typical sizes to start from.

        Parameters
        ----------
        shown : mapping of str to ndarray, shape (n,)
            What the assumed model says of the channels.
        placed : sequence of Placed
            What is there already.
        """
        if not self.channels:
            return []
        moves = {n: self._moves(n, shown[n]) for n in self.channels}
        moved, still = (
            tuple((n, *sensor_and_axis(n)) for n in self.channels if moves[n] is is_) for is_ in (True, False)
        )
        sensors = dict.fromkeys(sensor_and_axis(n)[0] for n in self.channels)
        found = {s: self._triad(s, shown) for s in sensors}
        felt = self._signals(next(iter(sensors)), shown)
        truth = Truth(
            felt.t, {s: y for s, (y, _) in found.items()}, {s: axes for s, (_, axes) in found.items()},
            np.ones(self.log.n, dtype=bool), omega_b=felt.omega_b, f_b=felt.f_b, power=felt.power, warmth=felt.warmth,
        )  # fmt: skip
        spread = max((self.noise[n] for n in self.channels if sensor_and_axis(n)[0] == "mag"), default=0.0)
        mag = np.zeros((self.log.n, 3))
        for n in (n for n in self.channels if sensor_and_axis(n)[0] == "mag"):
            mag[:, sensor_and_axis(n)[1]] = np.nan_to_num(self.log.channels[n].values) - shown[n]
        bench = MotionCandidates(truth, moved, still, truth.good, mag, spread, None, self._drive)
        return offers(bench, [*self.own, *placed])

    def _moves(self, name: str, shown: Array) -> bool:
        power = float(np.sum((shown - shown.mean()) ** 2))
        return is_motion(float(np.sqrt(power)) / self.noise[name])
