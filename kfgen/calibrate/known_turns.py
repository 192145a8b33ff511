"""The world of known turns: a rate sensor turned by known angles about one axis at a time, and its rests.

The integral of a rate over a turn is the angle, over a rest nothing; beside them stands a constant bias for
each axis. Only the axis of a turn is compared: the others see how it was held, which nobody knows.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from kfgen.core.channel_names import AXES
from kfgen.core.errors import InputError
from kfgen.effects.inertial.errors import ScaleAsymmetry, ScaleFactor
from kfgen.effects.inertial.felt import Signals
from kfgen.effects.inertial.inertial_error import InertialError
from kfgen.effects.noise_model import NoiseModel
from kfgen.gap.scene.scene import Placed, ScenePoint, Unknown
from kfgen.log.log import Log

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Turn:
    """A stretch of a log in which the sensor was turned by `angle` [rad] about `axis`, or rested (angle zero)."""

    start: float
    stop: float
    axis: int
    angle: float


@dataclass(frozen=True)
class TurnScene:
    """Integrals of rates against known angles; see `kfgen.gap.scene.scene.Scene`.

    Parameters
    ----------
    turns : tuple of Turn
    integral : ndarray, shape (m,)
        Of each turn's rate [rad].
    lasted : ndarray, shape (m,)
        [s].
    deviation : ndarray, shape (m,)
        Of the integral's noise and of the angle [rad].
    """

    turns: tuple[Turn, ...]
    integral: Array
    lasted: Array
    deviation: Array

    @property
    def channels(self) -> tuple[str, ...]:
        """The axes that were turned, as one."""
        return ("gyro",)

    @property
    def lengths(self) -> tuple[int, ...]:
        """Turns and rests."""
        return (len(self.turns),)

    @property
    def dt(self) -> float:
        """Median length [s]."""
        return float(np.median(self.lasted))

    @property
    def span(self) -> tuple[float, float]:
        """First and last time [s]."""
        return min(t.start for t in self.turns), max(t.stop for t in self.turns)

    @property
    def unknowns(self) -> tuple[Unknown, ...]:
        """A bias for each axis."""
        return tuple(Unknown(f"bias of gyro_{AXES[i]}", "rad/s", 0.0, np.inf) for i in self.axes)

    @property
    def axes(self) -> tuple[int, ...]:
        """The axes that were turned or rested."""
        return tuple(sorted({t.axis for t in self.turns}))

    def residuals(self, points: Sequence[ScenePoint]) -> Array:
        """Integral less what it should be, over its standard deviation, shape (m, points)."""
        out = np.empty((len(self.turns), len(points)))
        for k, point in enumerate(points):
            bias = dict(zip(self.axes, point.unknowns))
            should = np.array([self._angle(t, point.placed) for t in self.turns])
            drift = np.array([float(bias[t.axis]) for t in self.turns]) * self.lasted
            out[:, k] = (self.integral - should - drift) / self.deviation
        return out

    @staticmethod
    def _angle(turn: Turn, placed: Sequence[Placed]) -> float:
        """The integral under effects that are linear in the rate, so also in the angle."""
        felt = np.zeros((2, 3))
        felt[:, turn.axis] = turn.angle
        signals = Signals(np.arange(2.0), felt)
        here = (p.effect for p in placed if p.where in ("gyro", f"gyro_{AXES[turn.axis]}"))
        wrong = sum(float(e.output(signals, turn.axis)[0]) for e in here if isinstance(e, InertialError))
        return turn.angle + wrong

    def candidates(self, placed: Sequence[Placed]) -> list[list[Placed]]:
        """A scale for each axis that was turned, and its difference by sign where it was turned both ways."""
        found = []
        for i in self.axes:
            angles = [t.angle for t in self.turns if t.axis == i and t.angle]
            if angles:
                found.append(Placed(ScaleFactor(1e-3), f"gyro_{AXES[i]}"))
            if angles and min(angles) < 0.0 < max(angles):
                found.append(Placed(ScaleAsymmetry(1e-3), f"gyro_{AXES[i]}"))
        there = {(type(p.effect), p.where) for p in placed}
        return [[p] for p in found if (type(p.effect), p.where) not in there]


def turn_scene(log: Log, noise: NoiseModel, turns: Sequence[Turn], sd: float) -> TurnScene:
    """The world of known turns of a log.

    Parameters
    ----------
    turns : sequence of Turn
        Turns and rests, within the log; the sign of an angle is taken from the reading.
    sd : float
        Standard deviation [rad] to which a turn's angle is known.

    Raises
    ------
    InputError
        Time is uneven, a channel is missing or has holes, or a turn lies outside the log.
    """
    dt = log.uniform_dt()
    signed, integral, lasted, deviation = [], [], [], []
    for turn in turns:
        i, j = np.searchsorted(log.t, [turn.start, turn.stop])
        if j - i < 2:
            raise InputError(f"the turn at {turn.start:g} s lies outside the log", where=log.source)
        name = f"gyro_{AXES[turn.axis]}"
        total, T = float(log.values(name)[i:j].sum()) * dt, float(j - i) * dt
        random = (e for e in noise.channel(name).effects if not e.coefficients())
        variance = sum(float(e.density(np.array([0.5 / T]))[0]) for e in random) * T
        signed.append(replace(turn, angle=float(np.copysign(turn.angle, total)) if turn.angle else 0.0))
        integral.append(total)
        lasted.append(T)
        deviation.append(float(np.sqrt(variance + (sd if turn.angle else 0.0) ** 2)))
    return TurnScene(tuple(signed), np.array(integral), np.array(lasted), np.array(deviation))
