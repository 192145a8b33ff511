"""What a sensor of a filter reads: its prediction at the antenna, as late as it is, with the errors of its axes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import sympy as sp

from kfgen.core.channel_names import sensor_and_axis
from kfgen.effects.filter_role import AntennaOffset, ReadingError, ReadingLag
from kfgen.effects.inertial.felt import Felt
from kfgen.effects.inertial.inertial_error import arm_rate
from kfgen.model.parts.attached_error import AttachedError
from kfgen.model.parts.motion import MotionModel
from kfgen.model.parts.sensor import Sensor

if TYPE_CHECKING:
    from kfgen.model.filter import FilterModel

Views = Mapping[str, sp.Matrix]
VIBRATION = sp.Symbol("vibration", real=True)
"""Standard deviation of the specific force of all axes together [m/s^2], a driver."""
TEMPERATURE = sp.Symbol("temperature", real=True)
"""[K], a driver."""


def felt_in(value: sp.Matrix, view: Views, motion: MotionModel, force: sp.Matrix | None = None) -> Felt:
    """What a triad should have felt, in the symbols of a filter.

    Parameters
    ----------
    value : Matrix, shape (m, 1)
        What it should have read.
    view : mapping of str to Matrix
        Blocks, and what the motion offers.
    motion : MotionModel
        Says what gravity is.
    force : Matrix, shape (3, 1), optional
        Specific force, where an input measures it; else that of gravity alone where there is an attitude.
    """
    axes = down = None
    if "phi" in view:
        R_bl = view["phi"].T * view["level"].T if "level" in view else view["phi"].T
        axes = tuple(tuple(R_bl[i, j] for j in range(3)) for i in range(3))
        down = tuple(R_bl[i, 2] for i in range(3))
        if force is None:
            force = motion.force_at_rest(sp.Matrix(down))
    omega = tuple(view["omega"]) if "omega" in view else None
    padded = (*value, *(sp.Integer(0),) * (3 - len(value)))
    power = (VIBRATION**2, sp.Integer(0), sp.Integer(0))
    speed2 = view["v"].dot(view["v"]) if "v" in view else None
    felt = Felt(padded, omega, tuple(force) if force is not None else None, axes, down, power, TEMPERATURE)
    return replace(felt, speed_squared=speed2)


def speed_squared(model: FilterModel, values: Mapping[str, Any]) -> Any:
    """The square of the speed [m^2/s^2]; None of a model without a velocity.

    Parameters
    ----------
    model : FilterModel
    values : mapping of str to ndarray, shape (n,)
        Its state by name.
    """
    names = next((b.nominal_names for b in model.blocks if b.name == "v"), ())
    return sum(values[n] ** 2 for n in names) if names else None


def reading(sensor: Sensor, view: Views, errors: Sequence[AttachedError], motion: MotionModel) -> sp.Matrix:
    """The expected measurement with the errors of its reading, shape (m, 1).

    Parameters
    ----------
    sensor : Sensor
    view : mapping of str to Matrix
        Blocks, and what the motion offers.
    errors : sequence of AttachedError
        All of the filter.
    motion : MotionModel
    """
    mine = [e for e in errors if any(e.acts_on(c) for c in sensor.channels)]
    lags = [e for e in mine if isinstance(e.role, ReadingLag)]
    z = sensor.predict(view)
    rate = sensor.rate(view) if lags else None
    for e in (e for e in mine if isinstance(e.role, AntennaOffset)):
        arm, omega = (e.symbolic.x, e.symbolic.y, e.symbolic.z), tuple(view.get("omega", sp.zeros(3, 1)))
        z = z + view["phi"] * sp.Matrix(arm_rate(arm, omega, (0, 0, 0), sensor.arm_order))
        if rate is not None:
            rate = rate + view["phi"] * sp.Matrix(arm_rate(arm, omega, (0, 0, 0), sensor.arm_order + 1))
    for e in lags:
        assert rate is not None
        on = sp.Matrix([int(e.acts_on(c)) for c in sensor.channels])
        z = z - rate.multiply_elementwise(on) * e.symbolic.seconds
    others = [e for e in mine if isinstance(e.role, ReadingError)]
    if not others:
        return z
    return z + _wrong(sensor.channels, others, felt_in(_placed(sensor.channels, z), view, motion))


def _placed(channels: Sequence[str], value: sp.Matrix) -> sp.Matrix:
    """A value of one axis at its place in a triad."""
    (first, *more) = axes_of(channels)
    return value if more else sp.Matrix([sp.Integer(0)] * first + [value[0]])


def undone(
    channels: Sequence[str],
    shown: sp.Matrix,
    errors: Sequence[AttachedError],
    motion: MotionModel,
    view: Views,
    force: sp.Matrix | None,
) -> sp.Matrix:
    """A triad without the errors of its readings, by substitution: once for what starts from nothing, else twice.

    Parameters
    ----------
    channels : sequence of str
    shown : Matrix, shape (m, 1)
        What it shows.
    errors : sequence of AttachedError
        All of the filter.
    motion : MotionModel
    view : mapping of str to Matrix
        Blocks.
    force : Matrix, shape (3, 1), optional
        Specific force, where an input measures it.
    """
    mine = [e for e in errors if any(e.acts_on(c) for c in channels)]
    value = shown
    for _ in range(0 if not mine else 1 if all(e.is_small for e in mine) else 2):
        value = shown - _wrong(channels, mine, felt_in(value, view, motion, force))
    return value


def axes_of(channels: Sequence[str]) -> tuple[int, ...]:
    """The axes of a sensor's channels: of one alone the one that its name ends with, else in order.

    Parameters
    ----------
    channels : sequence of str
    """
    return (sensor_and_axis(channels[0])[1],) if len(channels) == 1 else tuple(range(len(channels)))


def _wrong(channels: Sequence[str], errors: Sequence[AttachedError], felt: Felt) -> sp.Matrix:
    """The sum of the errors of each axis, shape (m, 1)."""
    return sp.Matrix(
        [
            sum((e.symbolic.error(felt, k) for e in errors if e.acts_on(c)), sp.Integer(0))
            for k, c in zip(axes_of(channels), channels)
        ]
    )
