"""Conventions of the error: how a truth is made of an estimate and its error. The rest is differentiation.

Attitudes compose by a rotation ``Exp(angle)``, on the left (navigation axes) or on the right (body axes);
vectors add their error, and some are turned with the attitude before (`Convention.carried`). Matrices F, G
and H, and the correction of the emitted filter, follow from that.

References
----------
.. [1] J. Solà, Quaternion kinematics for the error-state Kalman filter, 2017, sec. 5.4 and 7.
.. [2] D. O. Benson, A comparison of two approaches to pure-inertial and Doppler-inertial error analysis,
   IEEE TAES 11(4), 1975.
.. [3] B. M. Scherzinger, D. B. Reid, Modified strapdown inertial navigator error models, IEEE PLANS, 1994.
.. [4] A. Barrau, S. Bonnabel, The invariant extended Kalman filter as a stable observer, IEEE TAC 62(4), 2017.
.. [5] F. L. Markley, Attitude error representations for Kalman filtering, JGCD 26(2), 2003.
"""

from __future__ import annotations

from typing import ClassVar

import sympy as sp

from kfgen.model.symbols.rotation import gibbs_quaternion, hamilton, rotated, skew, small_quaternion


class Side:
    """On which side of the estimate the rotation of the error stands."""

    body: ClassVar[bool] = False

    @staticmethod
    def truth(angle: sp.Matrix, R: sp.Matrix) -> sp.Matrix:
        """The true rotation matrix to first order in the angle, shape (3, 3)."""
        raise NotImplementedError

    @staticmethod
    def corrected(error: sp.Matrix, q: sp.Matrix) -> sp.Matrix:
        """The quaternion with an error put in, shape (4, 1)."""
        raise NotImplementedError

    @staticmethod
    def rate(angle: sp.Matrix, R: sp.Matrix, change: sp.Matrix, omega: sp.Matrix) -> sp.Matrix:
        """The angle's rate to first order, shape (3, k).

        Parameters
        ----------
        angle, change : Matrix, shape (3, k)
            Coefficients of the angle, and of the true body rate less the estimated one.
        R, omega : Matrix
            Estimated rotation (3, 3) and body rate (3, 1) [rad/s].
        """
        raise NotImplementedError


class Left(Side):
    """``Exp(angle) R``: with ``R' = R [omega x]``, ``angle' = R (omega - omega_hat)``."""

    @staticmethod
    def truth(angle: sp.Matrix, R: sp.Matrix) -> sp.Matrix:
        """``(I + [angle x]) R``."""
        return (sp.eye(3) + skew(angle)) * R

    @staticmethod
    def corrected(error: sp.Matrix, q: sp.Matrix) -> sp.Matrix:
        """``dq q``."""
        return hamilton(error, q)

    @staticmethod
    def rate(angle: sp.Matrix, R: sp.Matrix, change: sp.Matrix, omega: sp.Matrix) -> sp.Matrix:
        """``R (omega - omega_hat)``."""
        return rotated(R, change)


class Right(Side):
    """``R Exp(angle)``: ``angle' = omega - omega_hat - omega_hat x angle``."""

    body = True

    @staticmethod
    def truth(angle: sp.Matrix, R: sp.Matrix) -> sp.Matrix:
        """``R (I + [angle x])``."""
        return R * (sp.eye(3) + skew(angle))

    @staticmethod
    def corrected(error: sp.Matrix, q: sp.Matrix) -> sp.Matrix:
        """``q dq``."""
        return hamilton(q, error)

    @staticmethod
    def rate(angle: sp.Matrix, R: sp.Matrix, change: sp.Matrix, omega: sp.Matrix) -> sp.Matrix:
        """``omega - omega_hat - omega_hat x angle``."""
        return change - skew(omega) * angle


class Convention:
    """One way to write the error.

    Attributes
    ----------
    name, title : str
    equation : str
        The truth from estimate (hat) and error.
    letter : str
        Of the attitude error's states.
    side : type of Side
    carried : tuple of str
        Blocks whose estimate is turned before their error is added.
    """

    name: ClassVar[str] = ""
    title: ClassVar[str] = ""
    equation: ClassVar[str] = ""
    letter: ClassVar[str] = "phi"
    side: ClassVar[type[Side]] = Left
    carried: ClassVar[tuple[str, ...]] = ()

    @staticmethod
    def quaternion(angle: sp.Matrix) -> sp.Matrix:
        """The quaternion of the angle, not normalised, shape (4, 1)."""
        return small_quaternion(angle)

    @classmethod
    def angle(cls, own: sp.Matrix, turn: sp.Matrix) -> sp.Matrix:
        """The rotation from estimate to truth.

        Parameters
        ----------
        own : Matrix, shape (3, 1)
            The attitude error's states.
        turn : Matrix, shape (3, 1)
            By how much the error of position turns the navigation frame.
        """
        return own

    @classmethod
    def carrier(cls, own: sp.Matrix, turn: sp.Matrix) -> sp.Matrix:
        """The rotation by which `carried` vectors are turned, shape (3, 1)."""
        return own


class Phi(Convention):
    """Between the true and the estimated navigation axes."""

    name = "phi"
    title = "phi-angle: rotation between true and estimated navigation axes; vectors in true axes"
    equation = "R_nb = Exp(phi) R_nb_hat, v = v_hat + d_v, p = p_hat + d_p"


class Psi(Convention):
    """Between the computer frame, which is navigation axes at the estimated place, and the estimate [2]_."""

    name = "psi"
    title = "psi-angle: rotation against navigation axes at the estimated position (the computer frame)"
    equation = "R_nb = Exp(psi - turn) R_nb_hat, v = Exp(-turn) v_hat + d_v, p = p_hat + d_p, turn = rotation of the navigation frame over d_p"
    letter = "psi"
    carried = ("v",)

    @classmethod
    def angle(cls, own: sp.Matrix, turn: sp.Matrix) -> sp.Matrix:
        """``psi - turn``."""
        return own - turn

    @classmethod
    def carrier(cls, own: sp.Matrix, turn: sp.Matrix) -> sp.Matrix:
        """``-turn``."""
        return -turn


class ModifiedPhi(Convention):
    """The velocity turns with the attitude, so that no specific force stands in F [3]_."""

    name = "modified-phi"
    title = "modified phi-angle: the velocity is turned with the attitude, no specific force in F"
    equation = "R_nb = Exp(phi) R_nb_hat, v = Exp(phi) v_hat + d_v, p = p_hat + d_p"
    carried = ("v",)


class RightInvariant(Convention):
    """Velocity and position turn with the attitude: the error of the group of extended poses [4]_.

    So does the unknown acceleration of `BoundedVelocity`: whatever it is, no heading shows in it.
    """

    name = "right-invariant"
    title = "right-invariant: velocity, position and acceleration are turned with the attitude"
    equation = "R_nb = Exp(phi) R_nb_hat, v = Exp(phi) v_hat + d_v, p = Exp(phi) p_hat + d_p"
    carried = ("v", "p", "vl", "al")


class GlobalQuaternion(Convention):
    """Twice the vector part of the error's quaternion over its scalar part, on navigation axes [5]_."""

    name = "global-quaternion"
    title = "global quaternion: the error's Gibbs vector, doubled, on navigation axes"
    equation = "q_nb = dq(theta) q_nb_hat, dq = (1, theta/2) of unit length, v = v_hat + d_v, p = p_hat + d_p"
    letter = "theta"

    @staticmethod
    def quaternion(angle: sp.Matrix) -> sp.Matrix:
        """By the Gibbs vector."""
        return gibbs_quaternion(angle)


class LocalQuaternion(Convention):
    """The same on body axes [1]_, [5]_."""

    name = "local-quaternion"
    title = "local quaternion: the error's Gibbs vector, doubled, on body axes"
    equation = "q_nb = q_nb_hat dq(theta), dq = (1, theta/2) of unit length, v = v_hat + d_v, p = p_hat + d_p"
    letter = "theta"
    side = Right

    @staticmethod
    def quaternion(angle: sp.Matrix) -> sp.Matrix:
        """By the Gibbs vector."""
        return gibbs_quaternion(angle)


def conventions() -> dict[str, type[Convention]]:
    """Every convention by its name."""
    return {cls.name: cls for cls in Convention.__subclasses__()}
