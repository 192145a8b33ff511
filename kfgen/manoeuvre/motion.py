"""A motion to be made: rates at any time, from a start."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Motion(Protocol):
    """A motion to be made.

    Attributes
    ----------
    t : ndarray, shape (n,)
        Even times at which it is wanted [s].
    edges : ndarray, shape (k,)
        Times at which its rates jump or bend [s].
    R_lb : ndarray, shape (3, 3)
        Attitude at the start, body to north-east-down.
    v_l : ndarray, shape (3,)
        Velocity at the start [m/s].
    """

    @property
    def t(self) -> Array:
        """The times at which it is wanted."""
        ...

    @property
    def edges(self) -> Array:
        """Where its rates jump or bend."""
        ...

    @property
    def R_lb(self) -> Array:
        """The attitude at the start."""
        ...

    @property
    def v_l(self) -> Array:
        """The velocity at the start."""
        ...

    def rates(self, t: Array) -> tuple[Array, Array, Array]:
        """Body rate [rad/s]; rate of velocity [m/s^2] in north, east and down, and in body axes; at times (n,)."""
        ...


@dataclass(frozen=True)
class MotionProfile:
    """A motion by samples, straight between them.

    Parameters
    ----------
    t : ndarray, shape (n,)
        Even times [s].
    omega_b : ndarray, shape (n, 3)
        Rate of the body against the navigation frame [rad/s].
    a_l : ndarray, shape (n, 3)
        Rate of velocity in north, east and down at the origin [m/s^2].
    R_lb : ndarray, shape (3, 3)
        Attitude at the start, body to north-east-down.
    v_l : ndarray, shape (3,)
        Velocity at the start [m/s].
    """

    t: Array
    omega_b: Array
    a_l: Array
    R_lb: Array
    v_l: Array

    @property
    def edges(self) -> Array:
        """Every sample."""
        return self.t

    def rates(self, t: Array) -> tuple[Array, Array, Array]:
        """At times (n,), each (n, 3); there is no part in body axes."""
        omega, a = (
            np.column_stack([np.interp(t, self.t, values[:, k]) for k in range(3)])
            for values in (self.omega_b, self.a_l)
        )
        return omega, a, np.zeros_like(a)
