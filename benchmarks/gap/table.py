"""`Table`: a three-axis motion, known exactly at every time, as sums of sines.

Rates, their derivatives, and accelerations are evaluated in closed form, so that a delayed or filtered
motion is exact and not interpolated. The attitude (body to a navigation frame with x north, y east,
z down) is integrated from the rates by rotations of a twentieth of the sample time.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from case import Array
from scipy.spatial.transform import Rotation

GRAVITY = 9.80665
SUBSTEPS = 20
"""Rotations between two samples when the attitude is integrated."""


@dataclass(frozen=True)
class Sines:
    """Three axes of ``sum a sin(2 pi f t + p)``; arrays (3, k)."""

    amplitude: Array
    frequency: Array
    phase: Array

    def at(self, t: Array, derivative: int = 0) -> Array:
        """Values or a derivative, (n, 3)."""
        w = 2.0 * np.pi * self.frequency
        turned = np.einsum("n,ik->nik", t, w) + self.phase + 0.5 * np.pi * derivative
        return np.asarray((np.sin(turned) * self.amplitude * w**derivative).sum(axis=2))

    def lagged(self, t: Array, tau: float) -> Array:
        """Behind one pole of time constant tau, settled."""
        w = 2.0 * np.pi * self.frequency
        gain = self.amplitude / np.sqrt(1.0 + (w * tau) ** 2)
        return Sines(gain, self.frequency, self.phase - np.arctan(w * tau)).at(t)


@dataclass(frozen=True)
class Table:
    """A motion.

    Parameters
    ----------
    rates : Sines
        Body rates [rad/s].
    shaking : Sines
        Acceleration over the ground, body axes [m/s^2].
    start : Rotation
        Attitude at time 0, body to navigation frame.
    """

    name: str
    t: Array
    rates: Sines
    shaking: Sines
    start: Rotation

    @property
    def dt(self) -> float:
        """Sample time [s]."""
        return float(self.t[1] - self.t[0])

    def attitude(self) -> Rotation:
        """At every sample, body to navigation frame."""
        h, n = self.dt / SUBSTEPS, self.t.size
        middle = self.t[:-1, None] + (np.arange(SUBSTEPS) + 0.5) * h
        steps = Rotation.from_rotvec(self.rates.at(middle.ravel()) * h).as_quat().reshape(n - 1, SUBSTEPS, 4)
        turn = Rotation.from_quat(steps[:, 0])
        for k in range(1, SUBSTEPS):
            turn = turn * Rotation.from_quat(steps[:, k])
        return _running(self.start, turn)

    def force(self, attitude: Rotation) -> Array:
        """Specific force in body axes [m/s^2], (n, 3)."""
        up = attitude.inv().apply(np.array([0.0, 0.0, -GRAVITY]))
        return np.asarray(self.shaking.at(self.t) + up)


def rich(rng: np.random.Generator, duration: float, rate: float) -> Table:
    """Four incommensurate frequencies on each axis, up to 2 rad/s."""
    f = np.exp(rng.uniform(np.log(0.07), np.log(3.0), (3, 4)))
    a = rng.uniform(0.2, 0.6, (3, 4)) * np.sqrt(0.2 / (0.2 + f))
    shaking = Sines(
        rng.uniform(0.3, 1.0, (3, 3)), rng.uniform(0.1, 2.0, (3, 3)), rng.uniform(-np.pi, np.pi, (3, 3))
    )
    return _table("rich", duration, rate, Sines(a, f, rng.uniform(-np.pi, np.pi, (3, 4))), shaking, rng)


def poor(rng: np.random.Generator, duration: float, rate: float) -> Table:
    """One axis, one frequency; the table leans at random and does not shake."""
    f = np.full((3, 1), rng.uniform(0.3, 0.8))
    a = np.array([[rng.uniform(0.8, 1.5)], [0.0], [0.0]])
    return _table("poor", duration, rate, Sines(a, f, np.zeros((3, 1))), Sines(0.0 * a, f, 0.0 * a), rng)


def _table(
    name: str, duration: float, rate: float, rates: Sines, shaking: Sines, rng: np.random.Generator
) -> Table:
    t = np.arange(int(duration * rate)) / rate
    start = Rotation.from_rotvec(rng.uniform(-0.5, 0.5, 3) * np.array([1.0, 1.0, 4.0]))
    return Table(name, t, rates, shaking, start)


def _running(start: Rotation, turns: Rotation) -> Rotation:
    """Every partial product ``start * turns[0] * ... * turns[k]``, by doubling."""
    q = np.concatenate([start.as_quat()[None], turns.as_quat()])
    reach = 1
    while reach < len(q):
        q[reach:] = (Rotation.from_quat(q[:-reach]) * Rotation.from_quat(q[reach:])).as_quat()
        reach *= 2
    return Rotation.from_quat(q)
