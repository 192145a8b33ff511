"""`RecordedMotion`: the motion that the references of a log say, smooth between their samples."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kfgen.effects.series import noise_of
from kfgen.log.log import Log
from kfgen.manoeuvre.truth import level_at
from kfgen.model.filter import FilterModel
from kfgen.model.symbols.blocks import Vector

Array = NDArray[np.float64]

SPLINE_DEGREE = 5
MAX_NOISE_SHARE = 0.2
"""Share of a sensor's noise up to which a reference is taken as exact."""


def attitude_columns(log: Log) -> Array | None:
    """The reference attitude without jumps of its sign, shape (n, 4); None where a sample of it is missing."""
    names = [f"ref_q_{a}" for a in "wxyz"]
    if any(n not in log.channels for n in names):
        return None
    q = np.column_stack([log.channels[n].values for n in names])
    if not np.isfinite(q).all() or len(q) < 4 * SPLINE_DEGREE:
        return None
    turns = np.where(np.einsum("ni,ni->n", q[1:], q[:-1]) < 0.0, -1.0, 1.0)
    return np.asarray(q * np.concatenate([[1.0], np.cumprod(turns)])[:, None])


@dataclass(frozen=True)
class RecordedMotion:
    """See `kfgen.manoeuvre.motion.Motion`.

    Parameters
    ----------
    t : ndarray, shape (n,)
        Even times [s].
    q : ndarray, shape (n, 4)
        Attitude, body to navigation frame, scalar first, without jumps of sign.
    v : ndarray, shape (n, 3)
        Velocity in navigation axes [m/s]; zeros where the model has none.
    R_ln : ndarray, shape (3, 3)
        Navigation axes to north-east-down.
    """

    t: Array
    q: Array
    v: Array
    R_ln: Array

    @property
    def edges(self) -> Array:
        """None: it is smooth."""
        return np.zeros(0)

    @cached_property
    def _splines(self) -> tuple[Any, Any, Any]:
        from scipy.interpolate import make_interp_spline

        q = make_interp_spline(self.t, self.q, k=SPLINE_DEGREE)
        return q, q.derivative(), make_interp_spline(self.t, self.v, k=SPLINE_DEGREE).derivative()

    @property
    def R_lb(self) -> Array:
        """The attitude at the start, body to north-east-down."""
        from scipy.spatial.transform import Rotation

        return np.asarray(self.R_ln @ Rotation.from_quat(self.q[0], scalar_first=True).as_matrix())

    @property
    def v_l(self) -> Array:
        """The velocity at the start, in north, east and down."""
        return np.asarray(self.R_ln @ self.v[0])

    def rates(self, t: Array) -> tuple[Array, Array, Array]:
        """Body rate and rate of velocity in north, east and down at times (m,); one interval beyond the last at most."""
        q, change, acceleration = (s(t) for s in self._splines)
        w, u = q[:, :1], q[:, 1:]
        turn = w * change[:, 1:] - change[:, :1] * u - np.cross(u, change[:, 1:])
        omega = 2.0 * turn / np.einsum("ni,ni->n", q, q)[:, None]
        return omega, acceleration @ self.R_ln.T, np.zeros_like(omega)


def recorded_motion(log: Log, model: FilterModel) -> RecordedMotion | None:
    """The motion of a log for a model; None where a reference of it is missing or not much finer than the sensors.

    Parameters
    ----------
    log : Log
        Of even time.
    model : FilterModel
        With an attitude; its velocity and position have to be in the log as well.
    """
    q = attitude_columns(log)
    blocks = {b.name: b for b in model.motion.blocks}
    if q is None or model.attitude is None:
        return None
    v = np.zeros((log.n, 3))
    for name in (n for n in ("v", "p") if n in blocks):
        block = blocks[name]
        assert isinstance(block, Vector)
        columns = [log.channels.get(f"ref_{n}") for n in block.nominal_names]
        if any(c is None or not np.isfinite(c.values).all() for c in columns):
            return None
        v = np.column_stack([c.values for c in columns if c is not None]) if name == "v" else v
    if not _is_fine(log, q, v):
        return None
    known: dict[str, Any] = {c.name: c.value for c in model.constants}
    known |= {n: float(log.channels[f"ref_{n}"].values[0]) for n in _recorded_states(log, model)}
    return RecordedMotion(np.asarray(log.t), q, v, level_at(model, known))


def _recorded_states(log: Log, model: FilterModel) -> list[str]:
    names = [n for b in model.blocks if isinstance(b, Vector) for n in b.nominal_names]
    return [
        n for n in names if f"ref_{n}" in log.channels and np.isfinite(log.channels[f"ref_{n}"].values[0])
    ]


def recorded_states(log: Log, model: FilterModel) -> dict[str, Array]:
    """The reference values of a model's states over time, of those that are in the log, by name [SI]."""
    return {n: np.asarray(log.channels[f"ref_{n}"].values) for n in _recorded_states(log, model)}


def _is_fine(log: Log, q: Array, v: Array) -> bool:
    """Whether differences of the references are much finer than what the sensors show."""

    def noise(prefix: str) -> float:
        found = [log.channels[n].values for n in (f"{prefix}_{a}" for a in "xyz") if n in log.channels]
        return min((noise_of(y[np.isfinite(y)]) for y in found), default=np.inf)

    turn = 2.0 * np.sqrt(2.0) * max(noise_of(q[:, k]) for k in range(4)) / log.dt
    push = np.sqrt(2.0) * max(noise_of(v[:, k]) for k in range(3)) / log.dt
    return bool(turn <= MAX_NOISE_SHARE * noise("gyro") and push <= MAX_NOISE_SHARE * noise("accel"))
