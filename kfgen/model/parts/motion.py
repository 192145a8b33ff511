"""Motion models: what drives the state blocks, as time derivatives in symbols.

A motion says what it offers to sensors beside its blocks (`MotionModel.offers`); a sensor says what it needs.

References
----------
.. [1] P. D. Groves, Principles of GNSS, Inertial, and Multisensor Integrated Navigation
   Systems, 2nd ed., 2013, sec. 5.3 and 5.4 (local level), eqs (5.39), (5.44), (5.45), (5.54), (5.56).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import sympy as sp

from kfgen.core.units import STANDARD_GRAVITY
from kfgen.core.wgs84 import EARTH_RATE
from kfgen.model.option import NOTHING, Choice, Configured, Option, Quantity, YesNo
from kfgen.model.parts.attached_error import AttachedError
from kfgen.model.parts.bounded_velocity import ACCELERATION, BOUNDED, SPEED, SPEED_TIME, BoundedVelocity
from kfgen.model.parts.constant import Constant
from kfgen.model.parts.earth import normal_gravity, radii
from kfgen.model.parts.intrinsics import (
    FULL,
    G_SENSITIVITY,
    INTRINSICS_SD,
    MISALIGNMENT,
    SCALE_FACTORS,
    intrinsic_errors,
)
from kfgen.model.register import DelayLine
from kfgen.model.symbols.blocks import Attitude, Block, Vector
from kfgen.model.symbols.convention import Phi, conventions

NED = ("N", "E", "D")

Views = Mapping[str, sp.Matrix]


@dataclass(frozen=True)
class Input:
    """What drives the motion: a triad of channels ``name_x``, ``name_y``, ``name_z``, or one channel.

    Parameters
    ----------
    name, unit, title : str
    bias : str
        Letter of its bias states.
    bias_prior : float
        Standard deviation of the turn-on bias [SI].
    N : float
        White noise density where no noise file says otherwise [SI].
    K : float
        Random walk of the bias where no noise file says otherwise [SI/sqrt(s)].
    left_out : float
        What the model leaves out, as a density [SI/sqrt(Hz)]: the filter adds it to the noise of the
        input, the simulation does not.
    scalar : bool
        One channel of the input's own name.
    quiet : bool
        Zero where a log lacks it: only its noise acts.
    at_rest : str
        The level axis along which the triad points when nothing moves: ``up``, or none.
    """

    name: str
    unit: str
    title: str
    bias: str
    bias_prior: float
    N: float
    K: float = 0.0
    left_out: float = 0.0
    scalar: bool = False
    quiet: bool = False
    at_rest: str = ""

    @property
    def channels(self) -> tuple[str, ...]:
        """The channel names."""
        return (self.name,) if self.scalar else tuple(f"{self.name}_{axis}" for axis in "xyz")


# As noise files of MEMS have them: N and the gyro's K of EuRoC's ADIS16448, the accelerometer's K of PX4's EKF2
# (EKF2_ACC_B_NOISE 0.003 m/s^3 in steps of 8 ms); in an hour such biases go 0.07 deg/s and 0.02 m/s^2.
GYRO = Input("gyro", "rad/s", "angular rate", "bg", 0.02, 1.5e-4, 2e-5)
ACCEL = Input("accel", "m/s^2", "specific force", "ba", 0.2, 2e-3, 3e-4, at_rest="up")
GRAVITY = Constant("g", "m/s^2", STANDARD_GRAVITY, "gravity, positive")

ATTITUDE_ERROR = Option(
    "attitude_error", "how truth is made of estimate and error", Choice(tuple(conventions())), Phi.name
)
AFTER, BEFORE, AT, INCREMENTS = "after", "before", "at", "increments"
SAMPLES = Option(
    "samples",
    "what a sample of the inputs stands for: in a log the interval after it, the one before it, or the instant; for "
    "emitted code also increments of angle and velocity before it, gathered for a prediction",
    Choice((AFTER, BEFORE, AT, INCREMENTS)),
    AFTER,
)
LEFT_OUT = Option(
    "left_out",
    "add what the model leaves out (see derive) to the noise of inputs and sensors",
    YesNo(),
    "true",
)


CONSTANT, NORMAL = "constant", "normal"
GRAVITY_MODEL = Choice((CONSTANT, NORMAL))
LATITUDE = Option("latitude", "geodetic latitude of the origin", Quantity("deg"), "45 deg")
LONGITUDE = Option("longitude", "longitude of the origin", Quantity("deg"), "0 deg")
HEIGHT = Option("height", "height of the origin above the ellipsoid", Quantity("m"), "0 m")
COMMON = (ATTITUDE_ERROR, SAMPLES, SCALE_FACTORS, MISALIGNMENT, G_SENSITIVITY, INTRINSICS_SD)


class MotionModel(Configured):
    """What a motion model declares: its blocks, its inputs, its constants and their rates.

    Attributes
    ----------
    axes : tuple of str
        Of the navigation frame.
    late : tuple of DelayLine
        Inputs that act late.
    is_plant : bool
        Whether it is a model file's, which carries effects inside its equations.
    """

    blocks: tuple[Block, ...] = ()
    inputs: tuple[Input, ...] = ()
    late: tuple[DelayLine, ...] = ()
    constants: tuple[Constant, ...] = ()
    axes: tuple[str, ...] = NED
    is_plant: ClassVar[bool] = False

    def rates(self, x: Views, u: Views) -> dict[str, sp.Matrix]:
        """Time derivative of each block that moves; of an attitude, the body rate ``omega_nb_b`` [rad/s].

        Parameters
        ----------
        x : mapping
            By block name: a vector, or ``R_nb`` of an attitude.
        u : mapping
            By input name: the true triad.
        """
        return {}

    @property
    def errors(self) -> tuple[AttachedError, ...]:
        """Effects that its options attach to its inputs."""
        return ()

    def force_at_rest(self, down: sp.Matrix) -> sp.Matrix:
        """Specific force of a body that is not accelerated, in body axes [m/s^2], shape (3, 1); `down` in the same axes."""
        return -GRAVITY.symbol * down

    def turning(self, x: Views, change: sp.Matrix) -> sp.Matrix:
        """The rotation [rad] of the navigation frame over a small change of ``p``, shape (3, 1)."""
        return sp.zeros(3, 1)

    def offers(self, x: Views, rates: Views) -> dict[str, sp.Matrix]:
        """What sensors may use beside the blocks.

        Parameters
        ----------
        x, rates : mapping
            Blocks, and their rates.

        Returns
        -------
        mapping of str to Matrix
            ``level`` (3, 3), navigation axes to north-east-down here; ``omega`` (3, 1), rate of the body against the
            navigation frame [rad/s]; ``acceleration`` (3, 1), rate of ``v``, or a state [m/s^2]; ``height`` (1, 1) [m].
        """
        offered = {"level": sp.eye(3)}
        if "phi" in rates:
            offered["omega"] = rates["phi"]
        if "v" in rates:
            offered["acceleration"] = rates["v"]
        if "al" in x:
            offered["acceleration"] = x["al"]
        if "p" in x:
            offered["height"] = sp.Matrix([-x["p"][2]])
        return offered


class AtRestMotion(MotionModel):
    """A sensor at rest: nothing moves, every state belongs to an effect."""


class Rotating(MotionModel):
    """Attitude driven by gyros: ``dR_nb/dt = R_nb [omega x]``.

    Scale errors and misalignments of turning gyros, where they are no states, are left out by
    about one part in a thousand of a radian per second in a second.
    """

    options = (
        ATTITUDE_ERROR,
        SAMPLES,
        LEFT_OUT,
        SCALE_FACTORS,
        MISALIGNMENT,
        INTRINSICS_SD,
        ACCELERATION,
        SPEED,
        SPEED_TIME,
    )

    def __init__(self, chosen: Mapping[str, Any] = NOTHING) -> None:
        super().__init__(chosen)
        convention = conventions()[self.chosen["attitude_error"]]
        chosen = self.chosen
        self.moved = (
            BoundedVelocity(chosen["speed"], chosen["speed_time"])
            if chosen["acceleration"] == BOUNDED
            else None
        )
        moving = self.moved.blocks if self.moved else ()
        self.blocks = (Attitude(convention=convention), *moving)
        known = chosen["scale_factors"] and chosen["misalignment"] == FULL
        self.inputs = (replace(GYRO, left_out=1e-3 if chosen["left_out"] and not known else 0.0),)

    @property
    def errors(self) -> tuple[AttachedError, ...]:
        """Scale factors and misalignments of the gyros."""
        return intrinsic_errors(self.chosen, {GYRO.name: GYRO.unit})

    def rates(self, x: Views, u: Views) -> dict[str, sp.Matrix]:
        """The body rate is the gyros'; the velocity's as of `BoundedVelocity`."""
        return {"phi": u["gyro"]} | (self.moved.rates(x) if self.moved else {})


class Inertial(MotionModel):
    """Position, velocity and attitude driven by accelerometers and gyros."""

    inputs = (ACCEL, GYRO)

    def __init__(self, chosen: Mapping[str, Any] = NOTHING) -> None:
        super().__init__(chosen)
        convention = conventions()[self.chosen["attitude_error"]]
        self.blocks = (
            Vector("p", self.axes, "m", "position", 10.0),
            Vector("v", self.axes, "m/s", "velocity", 1.0),
            Attitude(convention=convention, frame=self.axes),
        )

    @property
    def errors(self) -> tuple[AttachedError, ...]:
        """Scale factors, misalignments and g-sensitivity."""
        return intrinsic_errors(self.chosen, {GYRO.name: GYRO.unit, ACCEL.name: ACCEL.unit})


class Strapdown(Inertial):
    """Strapdown navigation in a local level frame, as chosen without Earth rate (MEMS grade) or with it.

    With transport rate the frame stays level along the way: ``p`` is then the change of latitude and longitude
    in metres at the origin, and of height, so that ``L = L_0 + p_N / r_N``.
    """

    options = (
        *COMMON,
        Option("earth_rate", "the Earth turns", YesNo(), "false"),
        Option("transport_rate", "the frame stays level along the way", YesNo(), "false"),
        Option(
            "gravity_model", "constant, or normal gravity of latitude and height", GRAVITY_MODEL, CONSTANT
        ),
        LATITUDE,
        HEIGHT,
    )

    @property
    def constants(self) -> tuple[Constant, ...]:  # type: ignore[override]
        """Gravity and place, as far as they are used."""
        at, height = self.chosen["latitude"], self.chosen["height"]
        rate, transport = self.chosen["earth_rate"], self.chosen["transport_rate"]
        normal = self.chosen["gravity_model"] == NORMAL
        out = [] if normal else [GRAVITY]
        if rate and not transport:
            out.append(Constant("W_N", "rad/s", EARTH_RATE * math.cos(at), "Earth rate, north component"))
            out.append(Constant("W_D", "rad/s", -EARTH_RATE * math.sin(at), "Earth rate, down component"))
        if transport or normal:
            out.append(Constant("latitude", "rad", at, "latitude of the origin"))
            out.append(Constant("height", "m", height, "height of the origin"))
        if transport:
            r_N, r_E = (float(r) for r in radii(sp.Float(math.sin(at))))
            out.append(Constant("r_N", "m", r_N, "radius of the meridian at the origin"))
            out.append(Constant("r_E", "m", r_E * math.cos(at), "radius of the parallel at the origin"))
        return tuple(out)

    def _latitude(self, x: Views) -> sp.Expr:
        L = sp.Symbol("latitude", real=True)
        return L + x["p"][0] / sp.Symbol("r_N", real=True) if self.chosen["transport_rate"] else L

    def _height(self, x: Views) -> sp.Expr:
        return sp.Symbol("height", real=True) - x["p"][2]

    def _gravity(self, x: Views) -> sp.Matrix:
        if self.chosen["gravity_model"] == CONSTANT:
            return sp.Matrix([0, 0, GRAVITY.symbol])
        return sp.Matrix([0, 0, normal_gravity(sp.sin(self._latitude(x)), self._height(x))])

    def _earth_rate(self, x: Views) -> sp.Matrix:
        """``omega_ie_n`` [rad/s]."""
        if not self.chosen["earth_rate"]:
            return sp.zeros(3, 1)
        if self.chosen["transport_rate"]:
            L = self._latitude(x)
            return sp.Matrix([sp.cos(L), 0, -sp.sin(L)]) * EARTH_RATE
        return sp.Matrix([sp.Symbol("W_N", real=True), 0, sp.Symbol("W_D", real=True)])

    def turning(self, x: Views, change: sp.Matrix) -> sp.Matrix:
        """``(dlambda cos L, -dL, -dlambda sin L)`` (eq. (5.44) of [1]_ times dt)."""
        if not self.chosen["transport_rate"]:
            return sp.zeros(3, 1)
        L = self._latitude(x)
        d_latitude = change[0] / sp.Symbol("r_N", real=True)
        d_longitude = change[1] / sp.Symbol("r_E", real=True)
        return sp.Matrix([d_longitude * sp.cos(L), -d_latitude, -d_longitude * sp.sin(L)])

    def _over_ground(self, x: Views) -> sp.Matrix:
        """Rate of ``p`` (eq. (5.56) of [1]_)."""
        v = x["v"]
        if not self.chosen["transport_rate"]:
            return v
        L, h = self._latitude(x), self._height(x)
        R_N, R_E = radii(sp.sin(L))
        r_N, r_E = sp.Symbol("r_N", real=True), sp.Symbol("r_E", real=True)
        return sp.Matrix([v[0] * r_N / (R_N + h), v[1] * r_E / ((R_E + h) * sp.cos(L)), v[2]])

    def rates(self, x: Views, u: Views) -> dict[str, sp.Matrix]:
        """``v' = R_nb f + g - (2 omega_ie + omega_en) x v``, ``omega_nb = omega_ib - R_bn (omega_ie + omega_en)``."""
        p_rate = self._over_ground(x)
        omega_ie, omega_en = self._earth_rate(x), self.turning(x, p_rate)
        v_rate = x["phi"] * u["accel"] + self._gravity(x)
        omega_nb = u["gyro"]
        if self.chosen["earth_rate"] or self.chosen["transport_rate"]:
            v_rate -= (2 * omega_ie + omega_en).cross(x["v"])
            omega_nb -= x["phi"].T * (omega_ie + omega_en)
        return {"p": p_rate, "v": v_rate, "phi": omega_nb}
