"""Autopilots whose noise is a deviation for one step of their filter.

Both add ``(dt p)^2`` to the variance of an angle or a velocity and of a bias in every step, so that the deviations
are ``N / sqrt(dt)`` and ``K / sqrt(dt)`` for a filter of step ``dt``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from kfgen.consumers.base import Imu, Value
from kfgen.core.errors import InputError


@dataclass(frozen=True)
class Step:
    """A parameter: whose it is, its letter and unit, and the range that the autopilot documents."""

    sensor: str
    letter: str
    unit: str
    low: float
    high: float


def stepped(imu: Imu, steps: dict[str, Step]) -> dict[str, Value]:
    """The parameters at the filter's rate; a noise file without either sensor is refused."""
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
    """Values beyond what the autopilot documents."""
    return [
        f"{name} = {values[name].numbers[0]:.3g} {s.unit} is outside the {s.low:g} to {s.high:g} of {title}"
        for name, s in steps.items()
        if values[name].numbers and not s.low <= values[name].numbers[0] <= s.high
    ]


def lines(values: dict[str, Value], pattern: str) -> list[str]:
    """Each parameter by `pattern`, its words in a comment line before it."""
    out = []
    for name, v in values.items():
        out.append(f"# {name}: {f'[{v.unit}] ' if v.numbers else ''}{v.words}")
        if v.numbers:
            out.append(pattern.format(name=name, value=f"{v.numbers[0]:.6g}"))
    return out
