"""What PX4 and ArduPilot share: noise as the standard deviation of one step of the filter.

Both add ``(dt p)^2`` to the variance of an angle or a velocity and of a bias in every step, so that the parameters
are ``N / sqrt(dt)`` and ``K / sqrt(dt)`` for a filter of step ``dt``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from kfgen.consumers.base import Imu, Value
from kfgen.core.errors import InputError


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
    """

    sensor: str
    letter: str
    unit: str
    low: float
    high: float


def stepped(imu: Imu, steps: dict[str, Step]) -> dict[str, Value]:
    """The parameters at the filter's rate.

    Parameters
    ----------
    imu : Imu
        Its `rate` is that of the filter's steps [Hz].
    steps : dict of str to Step
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


def outside(values: dict[str, Value], steps: dict[str, Step], title: str) -> list[str]:
    """Warnings of values beyond the range that the autopilot documents.

    Parameters
    ----------
    values : dict of str to Value
    steps : dict of str to Step
        Of the same names.
    title : str
        Whose range it is.

    Returns
    -------
    list of str
    """
    return [
        f"{name} = {values[name].numbers[0]:.3g} {s.unit} is outside the {s.low:g} to {s.high:g} of {title}"
        for name, s in steps.items()
        if values[name].numbers and not s.low <= values[name].numbers[0] <= s.high
    ]


def lines(values: dict[str, Value], pattern: str) -> list[str]:
    """Each parameter in a line, with its words in a comment line before it.

    Parameters
    ----------
    values : dict of str to Value
    pattern : str
        A line with ``{name}`` and ``{value}``.

    Returns
    -------
    list of str
    """
    out = []
    for name, v in values.items():
        out.append(f"# {name}: {f'[{v.unit}] ' if v.numbers else ''}{v.words}")
        if v.numbers:
            out.append(pattern.format(name=name, value=f"{v.numbers[0]:.6g}"))
    return out
