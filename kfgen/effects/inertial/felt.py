"""What a triad should have felt: arrays over time for data, symbols for filters."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from kfgen.core.errors import InputError
from kfgen.core.recent_results import RecentResults

if TYPE_CHECKING:
    from scipy.interpolate import CubicSpline

Array = NDArray[np.float64]
T = TypeVar("T")

SPLINES_KEPT = 4
"""Splines of signals that are kept."""


@dataclass(frozen=True)
class Felt:
    """What a triad should have felt, by components: arrays over time, or symbols of a filter.

    Parameters
    ----------
    u : tuple of 3
        What it should have read [U].
    omega, force : tuple of 3, optional
        Body rate [rad/s] and specific force [m/s^2].
    R_bn : tuple of 3 tuples of 3, optional
        Navigation to body axes.
    down : tuple of 3, optional
        The direction of gravity in body axes.
    power : tuple of 3, optional
        Running variance of the specific force by axis [m^2/s^4].
    temperature : array or symbol, optional
        [K]
    t : ndarray, optional
        Times [s], where there are any.
    alpha : tuple of 3, optional
        Derivative of the body rate [rad/s^2]; from the rate over times where it is not given.
    speed_squared : array or symbol, optional
        Of the velocity over ground [m^2/s^2].
    """

    u: tuple[Any, ...]
    omega: tuple[Any, ...] | None = None
    f: tuple[Any, ...] | None = None
    R_bn: tuple[tuple[Any, ...], ...] | None = None
    down: tuple[Any, ...] | None = None
    power: tuple[Any, ...] | None = None
    temperature: Any = None
    t: Any = None
    alpha: tuple[Any, ...] | None = None
    speed_squared: Any = None

    @property
    def rate(self) -> tuple[Any, ...]:
        """The body rate; raises `InputError` where it is unknown."""
        return self._known(self.omega, "the body rate")

    @property
    def force(self) -> tuple[Any, ...]:
        """The specific force; raises `InputError` where it is unknown."""
        return self._known(self.f, "the specific force")

    @property
    def axes(self) -> tuple[tuple[Any, ...], ...]:
        """Rows of the rotation from navigation to body axes; raises `InputError` where it is unknown."""
        return self._known(self.R_bn, "the attitude")

    @property
    def downwards(self) -> tuple[Any, ...]:
        """Down in body axes; raises `InputError` where it is unknown."""
        return self._known(self.down, "the attitude")

    @property
    def vibration_power(self) -> tuple[Any, ...]:
        """The running variance of the specific force; raises `InputError` where it is unknown."""
        return self._known(self.power, "the power of the vibration")

    @property
    def squared_speed(self) -> Any:
        """The square of the speed; raises `InputError` where it is unknown."""
        return self._known(self.speed_squared, "the speed")

    @cached_property
    def angular_acceleration(self) -> tuple[Any, ...]:
        """The derivative of the body rate, by a spline over times where it is not given.

        The difference over two samples loses 1 % of the acceleration at a twenty-fifth of the rate.
        """
        if self.alpha is not None or self.t is None:
            return self._known(self.alpha, "the angular acceleration")
        from scipy.interpolate import CubicSpline

        return tuple(CubicSpline(self.t, w)(self.t, 1) for w in self.rate)

    @staticmethod
    def _known(value: T | None, what: str) -> T:
        if value is None:
            raise InputError(
                f"{what} is unknown here, and an effect needs it", remedy="Take the effect out there"
            )
        return value


def spline_of(x: Array, before: int = 0) -> CubicSpline:
    """The cubic spline through signals that go on before the first as they do after it, for so many samples.

    Parameters
    ----------
    x : ndarray, shape (n, ...)
        At 0, 1, 2, ...
    before : int
    """
    from scipy.interpolate import CubicSpline

    whole = np.concatenate([2.0 * x[:1] - x[before:0:-1], x]) if before else x
    return CubicSpline(np.arange(len(whole), dtype=np.float64), whole, axis=0)


class Splined(Protocol):
    """Gives the spline of signals, see `spline_of`."""

    def __call__(self, x: Array, before: int = 0) -> CubicSpline:
        """Of these signals, and so many samples before the first."""


@dataclass(frozen=True)
class Signals:
    """What moved, as one triad should have felt it.

    Parameters
    ----------
    t : ndarray, shape (n,)
        Even times [s].
    y : ndarray, shape (n, 3)
        What the triad should have read [U].
    omega_b, f_b : ndarray, shape (n, 3), optional
        Rate [rad/s] and specific force [m/s^2] in body axes.
    R_bn : ndarray, shape (n, 3, 3), optional
        Navigation to body axes.
    down : float
        Direction of gravity on the third navigation axis: 1 for north-east-down, -1 for east-north-up.
    power : ndarray, shape (n, 3), optional
        Running variance of the specific force [m^2/s^4].
    warmth : ndarray, shape (n,), optional
        Temperature [K].
    arm_order : int
        Derivative of a place that the sensor measures: 0 of a position, 1 of a velocity, 2 of a specific force.
    speed_squared : ndarray, shape (n,), optional
        Of the velocity over ground [m^2/s^2].
    """

    t: Array
    y: Array
    omega_b: Array | None = None
    f_b: Array | None = None
    R_bn: Array | None = None
    down: float = 1.0
    power: Array | None = None
    warmth: Array | None = None
    arm_order: int = 2
    speed_squared: Array | None = None

    @cached_property
    def _splines(self) -> RecentResults[CubicSpline]:
        return RecentResults(SPLINES_KEPT)

    def spline(self, x: Array, before: int = 0) -> CubicSpline:
        """The spline of one of these arrays, see `spline_of`: a fit tries many lags of the same signals."""
        return self._splines.recalled((id(x), before), lambda: spline_of(x, before))

    @cached_property
    def felt(self) -> Felt:
        """The same by components, as expressions of errors take it."""

        def columns(x: Array | None) -> tuple[Any, ...] | None:
            return None if x is None else tuple(x[:, k] for k in range(3))

        down = None if self.R_bn is None else tuple(self.down * self.R_bn[:, k, 2] for k in range(3))
        axes = (
            None
            if self.R_bn is None
            else tuple(tuple(self.R_bn[:, i, j] for j in range(3)) for i in range(3))
        )
        return Felt(
            columns(self.y) or (),
            columns(self.omega_b),
            columns(self.f_b),
            axes,
            down,
            columns(self.power),
            self.warmth,
            self.t,
            speed_squared=self.speed_squared,
        )

    @property
    def dt(self) -> float:
        """Sampling period [s]."""
        return float((self.t[-1] - self.t[0]) / (self.t.size - 1))

    def body(self, v_n: tuple[float, ...]) -> Array:
        """A vector of the navigation frame in body axes, shape (n, 3); zero where attitude is unknown."""
        if self.R_bn is None:
            return np.zeros_like(self.y)
        return np.asarray(self.R_bn @ np.array(v_n, dtype=np.float64))
