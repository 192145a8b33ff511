"""ArduPilot's simulation (SITL): the uniform noise that it adds to each sample while the motors run.

Every sample has a fixed part of +-0.01 m/s^2 and +-0.04 deg/s, and while the motors run a second one of +-``SIM_ACC1_RND``
and of +-``SIM_GYR1_RND`` times the throttle. A uniform number of +-a has the standard deviation ``a / sqrt(3)``.

References
----------
.. [1] github.com/ArduPilot/ardupilot, ``libraries/AP_InertialSensor/AP_InertialSensor_SITL.cpp``: ``generate_gyro``,
   ``generate_accel`` (read at 03ffe768); ``libraries/SITL/SITL.cpp``: names (read in copies).
"""

from __future__ import annotations

import math

from kfgen.consumers.base import SENSORS, Converted, Imu, Value, unused
from kfgen.core.units import from_si

NAME = "ardupilot-sim"
TITLE = "ArduPilot SITL parameters"
SOURCE = "read in ArduPilot/ardupilot: AP_InertialSensor_SITL.cpp; names in copies of SITL.cpp"
RATE = "that of the simulated samples, 1000 Hz for the first sensor"
NEEDS = ()

FULL_THROTTLE = "at full throttle; at a throttle of t it is t times as large"
_NOISE = {
    "SIM_ACC1_RND": ("accel", "m/s^2", 0.01, ""),
    "SIM_GYR1_RND": ("gyro", "deg/s", 0.04, FULL_THROTTLE),
}
"""Sensor, unit, half width of the noise that is always there in that unit, and what is to be said."""


def convert(imu: Imu) -> Converted:
    """A parameter file."""
    values = {name: _value(imu, *entry) for name, entry in _NOISE.items()}
    lines = imu.header(TITLE, SOURCE)
    for name, v in values.items():
        lines.append(f"# {name}: {f'[{v.unit}] ' if v.numbers else ''}{v.words}")
        lines += [f"{name},{v.numbers[0]:.6g}"] if v.numbers else []
    return Converted("\n".join(lines), values, tuple(_warnings(imu)))


def _value(imu: Imu, sensor: str, unit: str, floor: float, said: str) -> Value:
    """Half the width of the second part: the variances of both are that of the sensor's samples."""
    known = imu.known(sensor, "N")
    if not known:
        return Value((), unit, imu.absence(sensor, "N"))
    N, worst = max(known, key=lambda pair: pair[0])
    sd = from_si(imu.safety * N * math.sqrt(imu.rate or 0.0), unit)
    rest = 3.0 * sd**2 - floor**2
    words = f"sqrt(3 N^2 rate - {floor:g}^2); {worst.channel}{imu.safely()}"
    if rest <= 0.0:
        words = (
            f"0: the simulator's own noise, {floor:g} {unit} uniform, is not below that of {worst.channel}"
        )
        return Value((0.0,), unit, words)
    return Value((math.sqrt(rest),), unit, f"{words}{f'; {said}' if said else ''}")


def _warnings(imu: Imu) -> list[str]:
    said = ["the simulator adds this noise only while the motors run"]
    for sensor in SENSORS:
        for r in imu.readings(sensor):
            if r.K or r.drifts:
                said.append(f"{r.channel}: no parameter of {TITLE} holds a drift (SIM_DRIFT_SPEED is a ramp)")
            said += unused(r, TITLE)
    return said
