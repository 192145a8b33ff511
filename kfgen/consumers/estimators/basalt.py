"""Basalt's ``calibration.json``: continuous N and K of each axis in SI, which it multiplies by the root of the rate.

JSON has no comments: how the numbers come about is in the answer of the command, not in the file.

References
----------
.. [1] gitlab.com/VladyslavUsenko/basalt-headers, ``include/basalt/calibration/calibration.hpp``: names,
   ``dicrete_time_gyro_noise_std`` and the walks (read in copies).
"""

from __future__ import annotations

import json

from kfgen.consumers.base import IMU_RATE, Converted, Imu, Value

NAME = "basalt"
TITLE = "Basalt calibration.json"
SOURCE = "VladyslavUsenko/basalt-headers: calibration.hpp, read in copies of it"
RATE = f"{IMU_RATE} (imu_update_rate), by which it scales the noise"
NEEDS = ("gyro", "accel")


def convert(imu: Imu) -> Converted:
    """The keys of the inertial sensor, to be put into the calibration of the cameras."""
    values = {
        "imu_update_rate": imu.given_rate("--rate, of the IMU"),
        "accel_noise_std": imu.vector("accel", "N", "m/s^2/sqrt(Hz)"),
        "gyro_noise_std": imu.vector("gyro", "N", "rad/s/sqrt(Hz)"),
        "accel_bias_std": imu.vector("accel", "K", "m/s^3/sqrt(Hz)"),
        "gyro_bias_std": imu.vector("gyro", "K", "rad/s^2/sqrt(Hz)"),
    }
    entries = {name: _entry(v) for name, v in values.items() if v.numbers}
    return Converted(json.dumps({"value0": entries}, indent=4), values, imu.warnings(TITLE))


def _entry(v: Value) -> float | list[float]:
    numbers = [float(f"{n:.7g}") for n in v.numbers]
    return numbers[0] if len(numbers) == 1 else numbers
