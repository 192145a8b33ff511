"""What alignment in motion keeps among the supervisor's numbers, and its settings."""

from __future__ import annotations

from kfgen.emit.align import Alignment
from kfgen.model.filter import FilterModel
from kfgen.model.parts.constant import Constant
from kfgen.model.parts.motion import GYRO, Strapdown

SUMS = tuple(f"MOVING_S_{a}" for a in "XYZ")
FIRST = tuple(f"MOVING_V_{a}" for a in "NED")
PLACES = (
    ("MOVING", "alignment in motion: 1 once there is a first velocity"),
    ("MOVING_TIME", "alignment in motion: since the first velocity [s]"),
    *((n, "alignment in motion: sum of the specific force over time [m/s], body axes now") for n in SUMS),
    *((n, "alignment in motion: the first velocity [m/s]") for n in FIRST),
)
SETTINGS = (
    Constant("ALIGN_MIN_SPEED", "m/s", 5.0, "a slower body has no course"),
    Constant("ALIGN_VELOCITY", "m/s", 0.15, "standard deviation of a change of velocity, in motion"),
    Constant("ALIGN_DRIFT", "rad/s", GYRO.bias_prior, "standard deviation of the gyro's bias, in motion"),
)


def moving_places(model: FilterModel) -> tuple[tuple[str, str], ...]:
    """Numbers of the supervisor that this takes; none of a filter without a velocity in a level frame."""
    return PLACES if alignable(model) else ()


def alignable(model: FilterModel) -> bool:
    """Whether a filter can be aligned in motion."""
    return isinstance(model.motion, Strapdown) and Alignment(model).possible
