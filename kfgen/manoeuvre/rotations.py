"""Rotations as rows of quaternions, scalar first: products, exponentials and their running product."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

SMALL_ANGLE_RAD = 1e-4
"""Below it sines and arctangents are their series [rad]."""


def product(p: Array, q: Array) -> Array:
    """Hamilton products of quaternions, ``p q``.

    Parameters
    ----------
    p, q : ndarray, shape (..., 4)
        Scalar first, broadcast against each other.

    Returns
    -------
    ndarray, shape (..., 4)
    """
    pw, px, py, pz = (p[..., k] for k in range(4))
    qw, qx, qy, qz = (q[..., k] for k in range(4))
    return np.stack(
        [
            pw * qw - px * qx - py * qy - pz * qz,
            pw * qx + px * qw + py * qz - pz * qy,
            pw * qy - px * qz + py * qw + pz * qx,
            pw * qz + px * qy - py * qx + pz * qw,
        ],
        axis=-1,
    )


def inverse(q: Array) -> Array:
    """Inverses of unit quaternions (..., 4)."""
    return np.asarray(q * np.array([1.0, -1.0, -1.0, -1.0]))


def exponential(phi: Array) -> Array:
    """Quaternions of rotation vectors (..., 3) [rad]."""
    angle = np.linalg.norm(phi, axis=-1, keepdims=True)
    with np.errstate(invalid="ignore", divide="ignore"):
        ratio = np.where(angle > SMALL_ANGLE_RAD, np.sin(angle / 2) / angle, 0.5 - angle**2 / 48)
    return np.concatenate([np.cos(angle / 2), ratio * phi], axis=-1)


def logarithm(q: Array) -> Array:
    """Rotation vectors of unit quaternions (..., 4), up to half a turn [rad]."""
    q = np.where(q[..., :1] < 0.0, -q, q)
    sine = np.linalg.norm(q[..., 1:], axis=-1, keepdims=True)
    with np.errstate(invalid="ignore", divide="ignore"):
        ratio = np.where(sine > SMALL_ANGLE_RAD, 2 * np.arctan2(sine, q[..., :1]) / sine, 2 + sine**2 / 3)
    return np.asarray(ratio * q[..., 1:])


def rotated(q: Array, v: Array) -> Array:
    """Vectors turned by unit quaternions.

    Parameters
    ----------
    q : ndarray, shape (..., 4)
        Unit quaternions, scalar first.
    v : ndarray, shape (..., 3)

    Returns
    -------
    ndarray, shape (..., 3)
        ``R v``, in the unit of `v`.
    """
    w, u = q[..., :1], q[..., 1:]
    t = 2.0 * np.cross(u, v)
    return np.asarray(v + w * t + np.cross(u, t))


def as_matrix(q: Array) -> Array:
    """Rotation matrices of unit quaternions (..., 4), shape (..., 3, 3)."""
    return np.stack([rotated(q, np.broadcast_to(e, (*q.shape[:-1], 3))) for e in np.eye(3)], axis=-1)


def cumulative(q: Array) -> Array:
    """Running products ``1, q_0, q_0 q_1, ...`` of unit quaternions (n, 4), shape (n + 1, 4).

    Rows of a square are multiplied up side by side, then each by what came before it.
    """
    n = q.shape[0]
    side = max(int(np.ceil(np.sqrt(n))), 1)
    one = np.array([1.0, 0.0, 0.0, 0.0])
    square = np.concatenate([q, np.broadcast_to(one, (side * side - n, 4))]).reshape(side, side, 4)
    for k in range(1, side):
        square[:, k] = product(square[:, k - 1], square[:, k])
    for k in range(1, side):
        square[k] = product(square[k - 1, -1], square[k])
    out = np.concatenate([one[None], square.reshape(-1, 4)[:n]])
    return np.asarray(out / np.linalg.norm(out, axis=1, keepdims=True))
