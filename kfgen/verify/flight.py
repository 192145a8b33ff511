"""A simulated flight for a filter: S-turns at 20 m/s, an IMU with turn-on biases, GNSS at 10 Hz, a magnetometer.

The body banks as a coordinated turn wants it, its forward speed and its climb swing; or it is parked. Inertial samples are exact means
of the motion between two samples, plus biases and white noise of a MEMS sensor.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from kfgen.core.units import STANDARD_GRAVITY

Array = NDArray[np.float64]

START_S, AFTER_S = 40.0, 40.0
"""When the fault begins, and how long the flight goes on after it."""
FIX_RATE = 10.0
"""Of GNSS and the magnetometer [Hz]."""
GYRO_BIAS, ACCEL_BIAS, GYRO_N, ACCEL_N = 0.005, 0.05, 1.5e-4, 2e-3
POSITION_SD, VELOCITY_SD, FIELD_SD = 1.5, 0.1, 2e-7


@dataclass(frozen=True)
class TrialFlight:
    """What the filter is given, and the truth.

    Parameters
    ----------
    t : ndarray, shape (n,)
        Beginnings of the steps [s].
    dt : ndarray, shape (n,)
        What the filter is reported of their lengths [s].
    accel, gyro : ndarray, shape (n, 3)
        Means over the steps [m/s^2, rad/s], body axes.
    called : ndarray of bool, shape (n,)
        Whether there is a prediction.
    fixes : ndarray of int, shape (m,)
        Steps after which there is a fix.
    position, velocity, field : ndarray, shape (m, 3)
        Samples [m, m/s, T]; a row that is not a number everywhere and in `absent` is not given.
    absent : ndarray of bool, shape (m,)
        Fixes that do not come.
    truth : ndarray, shape (m, 3)
        True position at the fixes [m]; where they are wrong in a way that nothing else shows, theirs.
    attitude : ndarray, shape (4,)
        At the start, body to navigation axes, scalar first.
    start : ndarray, shape (3,)
        Velocity at the start [m/s].
    """

    t: Array
    dt: Array
    accel: Array
    gyro: Array
    called: NDArray[np.bool_]
    fixes: NDArray[np.int64]
    position: Array
    velocity: Array
    field: Array
    absent: NDArray[np.bool_]
    truth: Array
    attitude: Array
    start: Array

    def copy(self) -> TrialFlight:
        """With arrays of its own."""
        return replace(self, **{k: np.array(v) for k, v in vars(self).items()})


def turning(t: Array) -> tuple[Rotation, Array]:
    """Attitude and velocity over time of S-turns."""
    heading = 1.5 * np.sin(0.25 * t) + 0.02 * t
    rate = 0.375 * np.cos(0.25 * t) + 0.02
    speed = 20.0 + 2.0 * np.sin(0.5 * t)
    bank = np.arctan(speed * rate / STANDARD_GRAVITY)
    v = np.column_stack([speed * np.cos(heading), speed * np.sin(heading), np.sin(0.4 * t)])
    return Rotation.from_euler("ZX", np.column_stack([heading, bank])), v


def parked(t: Array) -> tuple[Rotation, Array]:
    """The same of a body that stands, a little tilted."""
    return Rotation.from_euler("ZX", np.tile([0.7, 0.05], (t.size, 1))), np.zeros((t.size, 3))


Motion = Callable[[Array], tuple[Rotation, Array]]


def flight(
    rate: float, seconds: float, field: Array, rng: np.random.Generator, motion: Motion = turning
) -> TrialFlight:
    """A flight without a fault.

    Parameters
    ----------
    rate : float
        Of the predictions [Hz].
    seconds : float
        Its length [s].
    field : ndarray, shape (3,)
        Magnetic field, navigation axes [T].
    rng : Generator
        Draws biases and noise.
    motion : callable
        Attitude and velocity [m/s] over time [s].
    """
    n, dt = round(seconds * rate), 1.0 / rate
    t: Array = np.arange(n + 1, dtype=np.float64) * dt
    R, v = motion(t)
    turn = (R[:-1].inv() * R[1:]).as_rotvec()
    middle = R[:-1] * Rotation.from_rotvec(turn / 2.0)
    force = middle.inv().apply(np.diff(v, axis=0) / dt - [0.0, 0.0, STANDARD_GRAVITY])
    p = np.cumsum((v[:-1] + v[1:]) / 2.0 * dt, axis=0)
    biases = rng.normal(size=(2, 3)) * [[GYRO_BIAS], [ACCEL_BIAS]]
    gyro = turn / dt + biases[0] + GYRO_N * rate**0.5 * rng.normal(size=(n, 3))
    accel = force + biases[1] + ACCEL_N * rate**0.5 * rng.normal(size=(n, 3))
    each = max(round(rate / FIX_RATE), 1)
    fixes = np.arange(each - 1, n, each)
    noise = rng.normal(size=(3, fixes.size, 3))
    return TrialFlight(
        t[:-1],
        np.full(n, dt),
        accel,
        gyro,
        np.ones(n, dtype=bool),
        fixes,
        p[fixes] + POSITION_SD * noise[0],
        v[fixes + 1] + VELOCITY_SD * noise[1],
        R[fixes + 1].inv().apply(field) + FIELD_SD * noise[2],
        np.zeros(fixes.size, dtype=bool),
        p[fixes],
        R[0].as_quat(scalar_first=True),
        v[0],
    )
