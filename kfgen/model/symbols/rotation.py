"""Attitude in symbols: the rotation matrix as nine atoms, and its quaternion.

The entries of ``R_nb`` stay symbols through every derivation; they are computed from the
quaternion once, where code is emitted.

References
----------
.. [1] J. Solà, Quaternion kinematics for the error-state Kalman filter, 2017,
   eqs (12), (115), (101).
"""

from __future__ import annotations

import sympy as sp

from kfgen.model.symbols.expanded import expanded


def skew(a: sp.Matrix) -> sp.Matrix:
    """The matrix with ``skew(a) b = a x b``, shape (3, 3)."""
    x, y, z = a
    return sp.Matrix([[0, -z, y], [z, 0, -x], [-y, x, 0]])


def atoms(name: str) -> sp.Matrix:
    """The symbols of a rotation matrix, shape (3, 3)."""
    return sp.Matrix(3, 3, lambda i, j: sp.Symbol(f"{name}_{i}{j}", real=True))


def matrix_of(q: sp.Matrix) -> sp.Matrix:
    """The rotation matrix of a unit quaternion, scalar first (eq. (115) of [1]_)."""
    w, x, y, z = q
    return sp.Matrix(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def rotated(R: sp.Matrix, b: sp.Matrix) -> sp.Matrix:
    """``R b`` with ``R R' = I`` used up: of ``b = R' c + d`` it is ``c + R d``, shape (3, k).

    Parameters
    ----------
    R : Matrix, shape (3, 3)
        Symbols of a rotation.
    b : Matrix, shape (3, k)
    """
    through, rest = sp.zeros(3, b.cols), expanded(b)
    for j in range(b.cols):
        for i in range(3):
            shares = {rest[k, j].diff(R[i, k]) for k in range(3)}
            if len(shares) == 1 and not (share := shares.pop()).free_symbols & set(R):
                through[i, j] = share
                rest[:, j] = sp.Matrix([rest[k, j].xreplace({R[i, k]: sp.Integer(0)}) for k in range(3)])
    return through + R * rest


def hamilton(p: sp.Matrix, q: sp.Matrix) -> sp.Matrix:
    """The Hamilton product, scalar first (eq. (12) of [1]_)."""
    pw, px, py, pz = p
    qw, qx, qy, qz = q
    return sp.Matrix(
        [
            pw * qw - px * qx - py * qy - pz * qz,
            pw * qx + px * qw + py * qz - pz * qy,
            pw * qy - px * qz + py * qw + pz * qx,
            pw * qz + px * qy - py * qx + pz * qw,
        ]
    )


def small_quaternion(theta: sp.Matrix) -> sp.Matrix:
    """The quaternion of a small rotation vector [rad], to fourth order, not normalised."""
    s = theta.dot(theta)
    return sp.Matrix([1 - s / 8 + s * s / 384, *(theta * (sp.Rational(1, 2) - s / 48))])


def gibbs_quaternion(theta: sp.Matrix) -> sp.Matrix:
    """The quaternion whose doubled Gibbs vector is `theta` [rad], not normalised."""
    return sp.Matrix([sp.Integer(1), *(theta / 2)])


def turned(theta: sp.Matrix, v: sp.Matrix) -> sp.Matrix:
    """``Exp(theta) v`` to fourth order in the angle [rad], shape (3, 1): Rodrigues' formula."""
    s, cross = theta.dot(theta), theta.cross(v)
    return v + cross * (1 - s / 6) + theta.cross(cross) * (sp.Rational(1, 2) - s / 24)
