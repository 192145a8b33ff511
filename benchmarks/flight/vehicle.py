"""Motions of four vehicles, in plain numpy and scipy: nothing of kfgen is asked.

A path is a smooth spline of time; the attitude follows from it as a vehicle of that kind would fly or drive it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import make_interp_spline
from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]

GRAVITY_M_S2 = 9.80665
REST_S = 3.0
"""At rest before the motion starts, for the alignment."""
EASE_S = 6.0
"""Over which the motion starts."""


@dataclass(frozen=True)
class Motion:
    """A motion at fine times.

    Parameters
    ----------
    t : ndarray, shape (n,)
        Even [s].
    p, v, a : ndarray, shape (n, 3)
        North, east, down.
    R_nb : Rotation
        Of n attitudes, body to navigation.
    """

    t: Array
    p: Array
    v: Array
    a: Array
    R_nb: Rotation

    @property
    def omega_b(self) -> Array:
        """Body rate, shape (n, 3) [rad/s]."""
        dt = self.t[1] - self.t[0]
        turn = (self.R_nb[:-1].inv() * self.R_nb[1:]).as_rotvec() / dt
        return np.asarray(np.vstack([turn, turn[-1:]]))

    @property
    def f_b(self) -> Array:
        """Specific force, shape (n, 3) [m/s^2]."""
        return np.asarray(self.R_nb.inv().apply(self.a - np.array([0.0, 0.0, GRAVITY_M_S2])))


def _course(rng: np.random.Generator, t: Array, every_s: float, sd: float) -> Array:
    """A random smooth course, at rest at the beginning."""
    knots = np.arange(0.0, t[-1] + 4.0 * every_s, every_s)
    values = sd * rng.standard_normal(knots.size)
    ease = np.clip((t - REST_S) / EASE_S, 0.0, 1.0)
    ease = ease**3 * (10.0 - 15.0 * ease + 6.0 * ease**2)
    return np.asarray(make_interp_spline(knots, values, k=5)(t) * ease)


def _integrated(v: Array, t: Array) -> tuple[Array, Array]:
    dt = t[1] - t[0]
    p = np.vstack([np.zeros(3), np.cumsum(0.5 * (v[1:] + v[:-1]), axis=0) * dt])
    return p, np.gradient(v, dt, axis=0)


def _from_axes(x: Array, z: Array) -> Rotation:
    """Body axes from directions of its x (nearly) and its z (exactly), in the navigation frame."""
    z = z / np.linalg.norm(z, axis=1)[:, None]
    y = np.cross(z, x)
    y /= np.linalg.norm(y, axis=1)[:, None]
    return Rotation.from_matrix(np.stack([np.cross(y, z), y, z], axis=2))


def _quadrotor(rng: np.random.Generator, t: Array) -> tuple[Array, Array]:
    v = np.column_stack([_course(rng, t, 7.0, 4.0), _course(rng, t, 7.0, 4.0), _course(rng, t, 9.0, 1.0)])
    yaw = _course(rng, t, 8.0, 1.5)
    return v, yaw


def _wing(rng: np.random.Generator, t: Array) -> tuple[Array, Array]:
    speed = 18.0 + _course(rng, t, 11.0, 2.0)
    ease = np.clip((t - REST_S) / EASE_S, 0.0, 1.0)
    speed = speed * ease**3 * (10.0 - 15.0 * ease + 6.0 * ease**2)
    dt = t[1] - t[0]
    yaw = np.cumsum(_course(rng, t, 9.0, 0.3)) * dt
    v = np.column_stack([speed * np.cos(yaw), speed * np.sin(yaw), _course(rng, t, 10.0, 1.5)])
    return v, yaw


def _car(rng: np.random.Generator, t: Array) -> tuple[Array, Array]:
    ease = np.clip((t - REST_S) / EASE_S, 0.0, 1.0)
    speed = (9.0 + _course(rng, t, 8.0, 4.0)) * ease**3 * (10.0 - 15.0 * ease + 6.0 * ease**2)
    yaw = np.cumsum(_course(rng, t, 6.0, 0.02) * np.clip(speed, 0.0, None)) * (t[1] - t[0])
    v = np.column_stack([speed * np.cos(yaw), speed * np.sin(yaw), _course(rng, t, 12.0, 0.15)])
    return v, yaw


def _walker(rng: np.random.Generator, t: Array) -> tuple[Array, Array]:
    ease = np.clip((t - REST_S) / EASE_S, 0.0, 1.0)
    yaw = np.cumsum(_course(rng, t, 5.0, 0.4)) * (t[1] - t[0])
    v = np.column_stack([1.4 * ease * np.cos(yaw), 1.4 * ease * np.sin(yaw), 0.2 * ease * np.sin(11.0 * t)])
    return v, yaw


VEHICLES = {"quadrotor": _quadrotor, "wing": _wing, "car": _car, "walker": _walker}


def motion(vehicle: str, duration_s: float, rate_hz: float, rng: np.random.Generator) -> Motion:
    """A vehicle's motion from rest, at fine times."""
    t = np.arange(int((duration_s + 1.0) * rate_hz)) / rate_hz
    v, yaw = VEHICLES[vehicle](rng, t)
    p, a = _integrated(v, t)
    x = np.column_stack([np.cos(yaw), np.sin(yaw), np.zeros(t.size)])
    down = np.array([0.0, 0.0, 1.0])
    if vehicle in ("quadrotor", "wing"):  # thrust, or lift, along the body's z
        z = np.array([0.0, 0.0, GRAVITY_M_S2]) - a
        if vehicle == "wing":
            along = np.sum(z * x, axis=1)[:, None] * x
            z = z - along
    else:
        wobble = 0.03 if vehicle == "car" else 0.12
        z = down + np.column_stack([_course(rng, t, 1.5, wobble), _course(rng, t, 1.5, wobble), 0.0 * t])
    return Motion(t, p, v, a, _from_axes(x, z))
