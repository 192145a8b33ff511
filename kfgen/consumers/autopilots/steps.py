"""What PX4 and ArduPilot share: noise as the standard deviation of one step of the filter.

Both add ``(dt p)^2`` to the variance of an angle or a velocity and of a bias in every step, so that the parameters
are ``N / sqrt(dt)`` and ``K / sqrt(dt)`` for a filter of step ``dt``. That is the sensor's noise at rest. In flight the
filter meets more: vibration, scale errors and misalignment times the motion, sampling; so the defaults of both are ten to
a hundred times what a good sensor shows on a bench.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from kfgen.consumers.base import Imu, Value
from kfgen.core.errors import InputError

IN_FLIGHT = (
    "a log at rest has neither vibration nor scale errors. Take it as the least, keep the default until test ratios in "
    "flight stay far below one, or measure what a flight needs: kfgen run FILTER FLIGHT --tune"
)
"""What is to be known of noise from a bench in a filter that flies."""
MUCH_SMALLER = 0.5
"""Share of the default below which a number from a bench is explained."""


@dataclass(frozen=True)
class Step:
    """A parameter of an autopilot.

    Parameters
    ----------
    sensor : str
        ``gyro`` or ``accel``.
    letter : str
        ``N`` or ``K``.
    unit : str
    low, high : float
        The range that the autopilot documents, in `unit`.
    default : float
        What it flies with, in `unit`.
    """

    sensor: str
    letter: str
    unit: str
    low: float
    high: float
    default: float


def stepped(imu: Imu, steps: Mapping[str, Step]) -> dict[str, Value]:
    """The parameters at the filter's rate.

    Parameters
    ----------
    imu : Imu
        Its `rate` is that of the filter's steps [Hz].
    steps : mapping of str to Step
        By the autopilot's names.

    Returns
    -------
    dict of str to Value

    Raises
    ------
    InputError
        The noise file has neither sensor.
    """
    if not any(imu.readings(s.sensor) for s in steps.values()):
        raise InputError(
            "the noise file has neither a gyroscope nor an accelerometer channel",
            where=imu.origin,
            remedy="Channels are called gyro_x, gyro_y, gyro_z, accel_x, accel_y, accel_z; or take --to table",
        )
    factor = math.sqrt(imu.rate or 0.0)
    by = f" / sqrt(dt), dt = {1.0 / imu.rate:.6g} s" if imu.rate else ""
    return {name: imu.scalar(s.sensor, s.letter, s.unit, factor, by) for name, s in steps.items()}


def outside(values: Mapping[str, Value], steps: Mapping[str, Step], title: str) -> list[str]:
    """Warnings of values beyond the range that the autopilot documents, and of those far below what it flies with.

    Parameters
    ----------
    values : mapping of str to Value
    steps : mapping of str to Step
        Of the same names.
    title : str
        Whose range it is.

    Returns
    -------
    list of str
    """
    known = {name: (values[name].numbers[0], s) for name, s in steps.items() if values[name].numbers}
    said = [
        f"{name} = {number:.3g} {s.unit} is outside the {s.low:g} to {s.high:g} of {title}"
        for name, (number, s) in known.items()
        if not s.low <= number <= s.high
    ]
    small = [
        f"{name} is 1/{s.default / number:.2g} of the default {s.default:g}"
        for name, (number, s) in known.items()
        if s.letter == "N" and number < MUCH_SMALLER * s.default
    ]
    return [*said, *([f"{'; '.join(small)}: {IN_FLIGHT}"] if small else [])]


def lines(values: Mapping[str, Value], pattern: str) -> list[str]:
    """Each parameter in a line, with its words in a comment line before it.

    Parameters
    ----------
    values : mapping of str to Value
    pattern : str
        A line with ``{name}`` and ``{value}``.

    Returns
    -------
    list of str
    """
    out = []
    for name, v in values.items():
        out.append(f"# {name}: {f'[{v.unit}] ' if v.numbers and v.unit else ''}{v.words}")
        if v.numbers:
            out.append(pattern.format(name=name, value=f"{v.numbers[0]:.6g}"))
    return out
