"""Effects of a sensor that moves: errors proportional to what it should have read, to forces, to rates.

Each gives the addition to one axis of a triad from what moved (`Signals`). At rest there is nothing of them
but a constant, so a record at rest never shows them. Entries of a matrix or a vector that stand at exactly
zero are not there: `free` names those that a fit may change.

References
----------
.. [1] P. G. Savage, Strapdown inertial navigation integration algorithm design, part 2, J. Guidance,
   Control, and Dynamics 21(2), 1998, sec. on inertial component errors.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import MISSING, dataclass, fields
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from kfgen.effects.effect import Effect, Parameter, parameter
from kfgen.effects.linear_system import LinearSystem

Array = NDArray[np.float64]

AXES = "xyz"


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
    """

    t: Array
    y: Array
    omega_b: Array | None = None
    f_b: Array | None = None
    R_bn: Array | None = None
    down: float = 1.0
    power: Array | None = None
    warmth: Array | None = None

    @property
    def dt(self) -> float:
        """Sampling period [s]."""
        return float((self.t[-1] - self.t[0]) / (self.t.size - 1))

    def body(self, v_n: tuple[float, ...]) -> Array:
        """A vector of the navigation frame in body axes, shape (n, 3); zero where attitude is unknown."""
        if self.R_bn is None:
            return np.zeros_like(self.y)
        return np.asarray(self.R_bn @ np.array(v_n, dtype=np.float64))


@dataclass(frozen=True)
class InertialError(Effect):
    """An effect that only motion shows."""

    sensors: ClassVar[tuple[str, ...]] = ("gyro", "accel")
    needs: ClassVar[tuple[str, ...]] = ()

    def form(self, drive: Mapping[str, Any] | None = None) -> LinearSystem:
        """Nothing: at rest it is a constant at most, and that is the bias."""
        return LinearSystem()

    def output(self, signals: Signals, axis: int) -> Array:
        """The addition [U] to one axis of the triad, shape (n,)."""
        raise NotImplementedError

    def sentence(self, channel: str, unit: str) -> str:
        """The effect in words: the entries that are there, with their units."""
        row = self.row(unit)
        shown = {k: f"{v:.3g} {u}".rstrip() for k, (v, u) in row.items()}
        there = [p.name for p in free(self)] or [p.name for p in self.estimated()]
        entries = ", ".join(f"{k} = {shown[k]}" for k in there)
        return f"{channel} {self.sentence_template.format(entries=entries, **shown)}"


def free(effect: Effect) -> tuple[Parameter, ...]:
    """The parameters that a fit may change: the estimated ones, but no entries at their default of zero."""
    held = {
        f.name
        for f in fields(effect)
        if f.default is not MISSING
        and f.metadata["kind"] != "setting"
        and getattr(effect, f.name) == f.default
    }
    fitted = (p for p in effect.estimated() if p.kind not in ("solved", "place"))
    return tuple(p for p in fitted if p.name not in held)


@dataclass(frozen=True)
class ScaleFactor(InertialError):
    """``y = (1 + s) u``."""

    coefficient: Any = parameter("%", "signed")

    name: ClassVar[str] = "scale_factor"
    title: ClassVar[str] = "scale factor error"
    separating_experiment: ClassVar[str] = "several rates of both signs"
    sentence_template: ClassVar[str] = "reads {coefficient} too much of what it should"

    def output(self, signals: Signals, axis: int) -> Array:
        """``s u``."""
        return np.asarray(self.coefficient * signals.y[:, axis])


@dataclass(frozen=True)
class ScaleDrift(InertialError):
    """``y = u + s (T - reference) u``: a scale that changes with the temperature T."""

    coefficient: Any = parameter("%/K", "signed")
    reference: Any = parameter("K", "setting", 293.15)

    name: ClassVar[str] = "scale_temperature"
    title: ClassVar[str] = "scale factor follows the temperature"
    separating_experiment: ClassVar[str] = "the same rates, cold and warm"
    sentence_template: ClassVar[str] = "has a scale that changes by {coefficient} from {reference} on"
    needs: ClassVar[tuple[str, ...]] = ("warmth",)

    def output(self, signals: Signals, axis: int) -> Array:
        """``s (T - reference) u``."""
        if signals.warmth is None:
            return np.zeros(signals.t.size)
        away = signals.warmth - float(self.reference)
        return np.asarray(self.coefficient * away * signals.y[:, axis])


@dataclass(frozen=True)
class ScaleAsymmetry(InertialError):
    """``y = u + s |u|``: other scales for positive and negative."""

    coefficient: Any = parameter("%", "signed")

    name: ClassVar[str] = "scale_asymmetry"
    title: ClassVar[str] = "scale factor differs by sign"
    separating_experiment: ClassVar[str] = "two or more rates of each sign"
    sentence_template: ClassVar[str] = (
        "has a scale that differs by {coefficient} to either side of the mean by sign"
    )

    def output(self, signals: Signals, axis: int) -> Array:
        """``s |u|``."""
        return np.asarray(self.coefficient * np.abs(signals.y[:, axis]))


@dataclass(frozen=True)
class Nonlinearity(InertialError):
    """``y = u + k2 u^2 + k3 u^3``."""

    k2: Any = parameter("1/(U)", "signed", 0.0)
    k3: Any = parameter("1/(U)^2", "signed", 0.0)

    name: ClassVar[str] = "nonlinearity"
    title: ClassVar[str] = "nonlinear scale"
    separating_experiment: ClassVar[str] = "the highest rates of both signs"
    sentence_template: ClassVar[str] = "is nonlinear: {entries}"

    def output(self, signals: Signals, axis: int) -> Array:
        """``k2 u^2 + k3 u^3``."""
        u = signals.y[:, axis]
        return np.asarray(self.k2 * u**2 + self.k3 * u**3)


@dataclass(frozen=True)
class Misalignment(InertialError):
    """``y_i = u_i + sum_j m_ij u_j``: output axis i feels input axis j."""

    xy: Any = parameter("mrad", "signed", 0.0)
    xz: Any = parameter("mrad", "signed", 0.0)
    yx: Any = parameter("mrad", "signed", 0.0)
    yz: Any = parameter("mrad", "signed", 0.0)
    zx: Any = parameter("mrad", "signed", 0.0)
    zy: Any = parameter("mrad", "signed", 0.0)

    name: ClassVar[str] = "misalignment"
    title: ClassVar[str] = "misalignment of the axes"
    separating_experiment: ClassVar[str] = "motion about all three axes"
    sentence_template: ClassVar[str] = "is misaligned (output axis, input axis): {entries}"

    def output(self, signals: Signals, axis: int) -> Array:
        """``sum_j m_ij u_j``."""
        return row_of(self, signals.y, axis)


@dataclass(frozen=True)
class GSensitivity(InertialError):
    """``y_i = u_i + sum_j g_ij f_j``: a rate sensor feels the specific force."""

    xx: Any = parameter("U/g", "signed", 0.0)
    xy: Any = parameter("U/g", "signed", 0.0)
    xz: Any = parameter("U/g", "signed", 0.0)
    yx: Any = parameter("U/g", "signed", 0.0)
    yy: Any = parameter("U/g", "signed", 0.0)
    yz: Any = parameter("U/g", "signed", 0.0)
    zx: Any = parameter("U/g", "signed", 0.0)
    zy: Any = parameter("U/g", "signed", 0.0)
    zz: Any = parameter("U/g", "signed", 0.0)

    name: ClassVar[str] = "g_sensitivity"
    title: ClassVar[str] = "sensitivity to specific force"
    separating_experiment: ClassVar[str] = "rest in six positions and turns between them"
    sentence_template: ClassVar[str] = "feels the specific force (output axis, input axis): {entries}"
    sensors: ClassVar[tuple[str, ...]] = ("gyro",)
    needs: ClassVar[tuple[str, ...]] = ("f_b",)

    def output(self, signals: Signals, axis: int) -> Array:
        """``sum_j g_ij f_j``."""
        return np.zeros(signals.t.size) if signals.f_b is None else row_of(self, signals.f_b, axis)


@dataclass(frozen=True)
class GSquared(InertialError):
    """``y = u + sum_jk g_jk f_j f_k``: a rate sensor feels products of the specific force (anisoinertia)."""

    xx: Any = parameter("U/g^2", "signed", 0.0)
    yy: Any = parameter("U/g^2", "signed", 0.0)
    zz: Any = parameter("U/g^2", "signed", 0.0)
    xy: Any = parameter("U/g^2", "signed", 0.0)
    yz: Any = parameter("U/g^2", "signed", 0.0)
    zx: Any = parameter("U/g^2", "signed", 0.0)

    name: ClassVar[str] = "g_squared"
    title: ClassVar[str] = "sensitivity to the square of the specific force"
    separating_experiment: ClassVar[str] = "rest at many tilts"
    sentence_template: ClassVar[str] = "feels products of two axes of the specific force: {entries}"
    sensors: ClassVar[tuple[str, ...]] = ("gyro",)
    needs: ClassVar[tuple[str, ...]] = ("f_b",)
    prior_penalty_nats: ClassVar[float] = 2.0  # of sensors made today the linear term is the larger one

    def output(self, signals: Signals, axis: int) -> Array:
        """``sum_jk g_jk f_j f_k``."""
        out = np.zeros(signals.t.size)
        if signals.f_b is None:
            return out
        for pair, f2 in products(signals.f_b).items():
            entry = getattr(self, pair)
            if entry:
                out += entry * f2
        return out


def products(f_b: Array) -> dict[str, Array]:
    """Products of two axes of a triad, shape (n, 3), by the entries of `GSquared`."""
    return {
        a + b: f_b[:, AXES.index(a)] * f_b[:, AXES.index(b)] for a, b in ("xx", "yy", "zz", "xy", "yz", "zx")
    }


@dataclass(frozen=True)
class VibrationRectification(InertialError):
    """A bias proportional to the running variance of the specific force.

    An accelerometer rectifies its own axis; any other sensor the sum of all.
    """

    coefficient: Any = parameter("U/g^2", "signed")
    own: float = parameter("", "setting", 0.0)

    name: ClassVar[str] = "vibration_rectification"
    title: ClassVar[str] = "vibration is rectified into a bias"
    separating_experiment: ClassVar[str] = "shaking at rest, strong and weak"
    sentence_template: ClassVar[str] = "turns vibration into a bias of {coefficient}"
    needs: ClassVar[tuple[str, ...]] = ("power",)

    def output(self, signals: Signals, axis: int) -> Array:
        """``k s^2``."""
        if signals.power is None:
            return np.zeros(signals.t.size)
        power = signals.power[:, axis] if self.own else signals.power.sum(axis=1)
        return np.asarray(self.coefficient * power)


@dataclass(frozen=True)
class LeverArm(InertialError):
    """An accelerometer at `r` from where its specific force is known: ``omega x (omega x r) + alpha x r``."""

    x: Any = parameter("m", "signed", 0.0)
    y: Any = parameter("m", "signed", 0.0)
    z: Any = parameter("m", "signed", 0.0)

    name: ClassVar[str] = "lever_arm"
    title: ClassVar[str] = "lever arm"
    separating_experiment: ClassVar[str] = "turns about all axes, fast and slow"
    sentence_template: ClassVar[str] = "sits off the point of reference by {entries}"
    sensors: ClassVar[tuple[str, ...]] = ("accel",)
    needs: ClassVar[tuple[str, ...]] = ("omega_b",)

    def output(self, signals: Signals, axis: int) -> Array:
        """The acceleration by rotation."""
        from scipy.interpolate import CubicSpline

        w = signals.omega_b
        if w is None:
            return np.zeros(signals.t.size)
        j, k = (axis + 1) % 3, (axis + 2) % 3
        # A spline: the difference over two samples loses 1 % of the acceleration at a twenty-fifth of the rate.
        alpha = CubicSpline(signals.t, w, axis=0)(signals.t, 1)
        r = (self.x, self.y, self.z)
        wr = w[:, j] * r[j] + w[:, k] * r[k]
        turning = w[:, axis] * wr - (w[:, j] ** 2 + w[:, k] ** 2) * r[axis]
        return np.asarray(turning + alpha[:, j] * r[k] - alpha[:, k] * r[j])


@dataclass(frozen=True)
class GravityError(InertialError):
    """Gravity is greater by `value` than the truth took it to be."""

    value: Any = parameter("U", "signed")

    name: ClassVar[str] = "gravity_error"
    title: ClassVar[str] = "error of gravity"
    separating_experiment: ClassVar[str] = "rest in six positions"
    sentence_template: ClassVar[str] = "feels a gravity that is greater by {value}"
    sensors: ClassVar[tuple[str, ...]] = ("accel",)
    needs: ClassVar[tuple[str, ...]] = ("R_bn",)

    def output(self, signals: Signals, axis: int) -> Array:
        """``-R_bn (0, 0, value)``, the third axis being down."""
        return np.asarray(-self.value * signals.body((0.0, 0.0, signals.down))[:, axis])


@dataclass(frozen=True)
class EarthRate(InertialError):
    """The turning of the earth, which the truth left out; on the axes of the navigation frame."""

    x: Any = parameter("U", "signed", 0.0)
    y: Any = parameter("U", "signed", 0.0)
    z: Any = parameter("U", "signed", 0.0)

    name: ClassVar[str] = "earth_rate"
    title: ClassVar[str] = "rotation of the earth"
    separating_experiment: ClassVar[str] = "rest in several headings"
    sentence_template: ClassVar[str] = "feels the rotation of the earth: {entries}"
    sensors: ClassVar[tuple[str, ...]] = ("gyro",)
    needs: ClassVar[tuple[str, ...]] = ("R_bn",)

    def output(self, signals: Signals, axis: int) -> Array:
        """``R_bn omega_ie``."""
        return np.asarray(signals.body((self.x, self.y, self.z))[:, axis])


def row_of(effect: InertialError, u: Array, axis: int) -> Array:
    """One row of an effect's matrix (entries ``xx`` ... ``zz``) times a triad, shape (n,)."""
    out = np.zeros(u.shape[0])
    for j in range(3):
        entry = getattr(effect, AXES[axis] + AXES[j], 0.0)
        if entry:
            out += entry * u[:, j]
    return out
