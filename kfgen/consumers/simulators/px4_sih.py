"""PX4's simulation in hardware (SIH): its inertial noise has no parameters; these are the constants in its source.

It adds independent noise of a standard deviation for each axis in every step, ``N sqrt(rate)``; nothing of it drifts.

References
----------
.. [1] github.com/PX4/PX4-Autopilot, ``src/modules/simulation/simulator_sih/sih.cpp``: ``noiseGauss3f``, and
   ``sih_params.yaml``, which has none for the inertial sensor (read at 1dfff54d).
"""

from __future__ import annotations

import math

from kfgen.consumers.base import SENSORS, Converted, Imu, unused

NAME = "px4-sih"
TITLE = "PX4 SIH"
SOURCE = "read in PX4/PX4-Autopilot: simulator_sih/sih.cpp, sih_params.yaml"
RATE = "that of the simulation's steps, 250 Hz unless it was changed"
NEEDS = ()

_LINES = {"acc": ("accel", "m/s^2"), "gyro": ("gyro", "rad/s")}


def convert(imu: Imu) -> Converted:
    """The two calls in its source."""
    by = f" / sqrt(dt), dt = {1.0 / imu.rate:.6g} s" if imu.rate else ""
    factor = math.sqrt(imu.rate or 0.0)
    values = {name: imu.vector(sensor, "N", unit, 1, factor, by) for name, (sensor, unit) in _LINES.items()}
    lines = [f"//{line[1:]}" for line in imu.header(TITLE, SOURCE, per_axis=True)]
    lines.append("// SIH has no parameter of this noise: put these numbers into sih.cpp")
    for name, v in values.items():
        lines.append(f"// {name} [{v.unit}]: {v.words}")
        if v.numbers:
            lines.append(f"{name} += noiseGauss3f({', '.join(f'{_float(n)}' for n in v.numbers)});")
    return Converted("\n".join(lines), values, tuple(_warnings(imu)))


def _float(number: float) -> str:
    """A number of C++ of type float."""
    text = f"{number:.7g}"
    return f"{text if '.' in text or 'e' in text else text + '.0'}f"


def _warnings(imu: Imu) -> list[str]:
    said = []
    for sensor in SENSORS:
        for reading in imu.readings(sensor):
            if reading.K or reading.drifts:
                said.append(f"{reading.channel}: SIH has no drift of the bias; its biases stay as they are")
            said += unused(reading, TITLE)
    return said
