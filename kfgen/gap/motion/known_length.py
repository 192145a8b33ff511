"""The world of a known length: an accelerometer at rest in many poses, a magnetometer turned in a field.

No reference is needed: at rest the specific force is as long as gravity, and a field that is constant in space
keeps its length however the sensor is turned. Effects are linear in what should have been read,
``y = (I + M) u + b``; undone, ``|u|`` is compared with that length [1]_. A turn of all axes together leaves it as it
is, so of a matrix only one triangle can be known.

References
----------
.. [1] I. Frosio, F. Pedersini, N. A. Borghese, Autocalibration of MEMS accelerometers, IEEE Trans.
   Instrumentation and Measurement 58(6), 2009, eq. (5).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from kfgen.core.channel_names import AXES
from kfgen.core.units import STANDARD_GRAVITY, parse_unit
from kfgen.effects import Effect, make
from kfgen.effects.inertial.errors import Misalignment, ScaleFactor
from kfgen.effects.inertial.felt import Signals
from kfgen.effects.inertial.inertial_error import InertialError, free
from kfgen.effects.inertial.magnetic import HardIron, SoftIron
from kfgen.effects.noise_model import NoiseModel
from kfgen.gap.scene.scene import Placed, ScenePoint, Unknown
from kfgen.identify.screening.rests import rests
from kfgen.log.log import Log

Array = NDArray[np.float64]

MIN_POSES = 4
"""Poses, or spread of samples, below which nothing is compared."""
UPPER = ("xy", "xz", "yz")
START_RELATIVE_ERROR = 1e-3
MIN_SENSITIVITY_SHARE = 1e-6
"""Of the largest sensitivity: the least that a triad has in any direction, for it reads the others else."""
MAX_RESIDUAL = 1e6
"""Standard deviations by which a triad is off that is blind in a direction."""


@dataclass(frozen=True)
class NormScene:
    """Readings whose true length is constant; see `kfgen.gap.scene.scene.Scene`.

    Parameters
    ----------
    sensor : str
        ``accel`` or ``mag``.
    unit : str
    t : ndarray, shape (m,)
        Times of the readings [s].
    y : ndarray, shape (m, 3)
        Readings, or their means over poses [SI].
    variance : ndarray, shape (m, 3)
        Of their noise [SI^2].
    length : float
        What should have been read [SI]; zero where it is unknown.
    """

    sensor: str
    unit: str
    t: Array
    y: Array
    variance: Array
    length: float = 0.0

    is_reading_by_reading = True

    @property
    def channels(self) -> tuple[str, ...]:
        """The triad, as one."""
        return (self.sensor,)

    @property
    def lengths(self) -> tuple[int, ...]:
        """Readings."""
        return (self.t.size,)

    @property
    def dt(self) -> float:
        """Median time from reading to reading [s]."""
        return float(np.median(np.diff(self.t)))

    @property
    def span(self) -> tuple[float, float]:
        """First and last time [s]."""
        return float(self.t[0]), float(self.t[-1])

    @cached_property
    def unknowns(self) -> tuple[Unknown, ...]:
        """The length of the field, where it is unknown."""
        if self.length:
            return ()
        mean = float(np.linalg.norm(self.y, axis=1).mean())
        return (Unknown("length of the field", parse_unit(self.unit).si, mean, np.inf),)

    def residuals(self, points: Sequence[ScenePoint]) -> Array:
        """``(|u| - length)`` over its standard deviation, shape (m, points)."""
        return np.array([self._residual(p) for p in points]).T

    def _residual(self, point: ScenePoint) -> Array:
        A, b = self.reading(point.placed)
        values = np.linalg.svd(A, compute_uv=False)
        if not values[-1] > MIN_SENSITIVITY_SHARE * values[0]:
            return np.full(self.t.size, MAX_RESIDUAL)
        inverse = np.linalg.inv(A)
        u = (self.y - b) @ inverse.T
        size = np.linalg.norm(u, axis=1)
        towards = (u / size[:, None]) @ inverse  # derivative of |u| in y
        deviation = np.sqrt(np.sum(towards**2 * self.variance, axis=1))
        length = self.length or float(point.unknowns[0])
        return np.asarray((size - length) / deviation)

    def reading(self, placed: Sequence[Placed]) -> tuple[Array, Array]:
        """``A = I + M`` and ``b`` of what is read, shapes (3, 3) and (3,)."""
        probes = np.vstack([np.zeros(3), np.eye(3)])
        felt = Signals(np.arange(4.0), probes)
        out = probes.copy()
        for p in placed:
            for i in range(3):
                if p.where not in (self.sensor, f"{self.sensor}_{AXES[i]}"):
                    continue
                if isinstance(p.effect, InertialError):
                    out[:, i] += p.effect.output(felt, i)
                elif p.effect.name == "bias":
                    out[:, i] += float(getattr(p.effect, "value", 0.0))
        return (out[1:] - out[0]).T, out[0]

    def candidates(self, placed: Sequence[Placed]) -> list[list[Placed]]:
        """Biases, scales and one triangle of a misalignment; or hard and soft iron."""
        size = float(np.linalg.norm(self.y, axis=1).mean())
        found: list[Placed] = []
        if self.sensor == "mag":
            h = START_RELATIVE_ERROR * size
            entries = ("xx", "yy", *UPPER)  # the size of the field measures the third axis
            found.append(Placed(HardIron(h, h, h), "mag"))
            found += [Placed(SoftIron(**{e: START_RELATIVE_ERROR}), "mag") for e in entries]
            found.append(Placed(SoftIron(**dict.fromkeys(entries, START_RELATIVE_ERROR)), "mag"))
        else:
            for a in AXES:
                name = f"{self.sensor}_{a}"
                found.append(Placed(make("bias", value=START_RELATIVE_ERROR * size), name))
                found.append(Placed(ScaleFactor(START_RELATIVE_ERROR), name))
            found += [
                Placed(Misalignment(**{e: START_RELATIVE_ERROR}), f"{self.sensor}_{e[0]}") for e in UPPER
            ]
        return [[p] for p in found if not any(_same(p, old) for old in placed)]


def _same(new: Placed, old: Placed) -> bool:
    """Whether an effect is placed already, with the same entries or more."""
    named = {p.name for p in free(new.effect)} <= {p.name for p in free(old.effect)}
    return type(new.effect) is type(old.effect) and old.where == new.where and named


def norm_scene(log: Log, noise: NoiseModel, sensor: str = "accel") -> NormScene | None:
    """The world of a known length; none where the sensor was never turned or has no noise model.

    Parameters
    ----------
    sensor : str
        ``accel``: means over the poses of rest; ``mag``: every sample.

    Raises
    ------
    InputError
        Time is uneven, or a channel has holes.
    """
    names = [f"{sensor}_{a}" for a in AXES]
    if not all(n in log.channels and n in noise.channels for n in names):
        return None
    dt = log.uniform_dt()
    effects = [noise.channel(n).effects for n in names]
    y = np.array([log.values(n) for n in names]).T
    unit = log.channels[names[0]].unit
    if sensor == "mag":
        variance = np.tile([_variance(e, dt) for e in effects], (log.n, 1))
        scene = NormScene(sensor, unit, np.asarray(log.t), y, variance)
    else:
        poses = rests(log, sensor)
        if len(poses) < MIN_POSES:
            return None
        variance = np.array([[_variance(e, (j - i) * dt) for e in effects] for i, j in poses])
        means = np.array([y[i:j].mean(axis=0) for i, j in poses])
        middle = np.array([log.t[(i + j) // 2] for i, j in poses])
        length = STANDARD_GRAVITY if parse_unit(unit).same_dimension(parse_unit("m/s^2")) else 0.0
        scene = NormScene(sensor, unit, middle, means, variance, length)
    return scene if _turned(scene) else None


def _variance(effects: Sequence[Effect], T: float) -> float:
    """Variance of a mean over `T` [s]: the density where such a mean looks, over its length."""
    f = np.array([0.5 / T])
    return float(sum(e.density(f)[0] for e in effects if not e.coefficients()) / T)


def _turned(scene: NormScene) -> bool:
    """Whether readings spread over directions: the least of their spreads is far above the noise."""
    away = scene.y - scene.y.mean(axis=0)
    least = np.sqrt(np.linalg.eigvalsh(away.T @ away / scene.t.size)[0])
    noise = np.sqrt(scene.variance.mean())
    return bool(least > max(10.0 * noise, 0.1 * np.linalg.norm(away, axis=1).max()))
