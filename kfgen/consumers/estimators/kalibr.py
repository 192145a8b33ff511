"""Kalibr's ``imu.yaml``: continuous densities N and random walks K in SI, and the rate.

Kalibr divides the noise densities by ``sqrt(dt)`` itself and refuses a value that is not positive.

References
----------
.. [1] github.com/ethz-asl/kalibr, ``working_directory/imu.yaml`` (read); ``kalibr_common/ConfigReader.py``,
   ``ImuParameters`` (read in a copy).
"""

from __future__ import annotations

from kfgen.consumers.base import IMU_RATE, Converted, Imu, Value
from kfgen.consumers.yaml_text import yaml_lines

NAME = "kalibr"
TITLE = "Kalibr imu.yaml"
SOURCE = "read in ethz-asl/kalibr: working_directory/imu.yaml; ConfigReader.py in a copy of it"
RATE = f"{IMU_RATE} (update_rate)"
NEEDS = ("gyro", "accel")


def densities(imu: Imu) -> dict[str, Value]:
    """The four numbers under Kalibr's names."""
    return {
        "accelerometer_noise_density": imu.scalar("accel", "N", "m/s^2/sqrt(Hz)"),
        "accelerometer_random_walk": imu.scalar("accel", "K", "m/s^3/sqrt(Hz)"),
        "gyroscope_noise_density": imu.scalar("gyro", "N", "rad/s/sqrt(Hz)"),
        "gyroscope_random_walk": imu.scalar("gyro", "K", "rad/s^2/sqrt(Hz)"),
    }


def convert(imu: Imu) -> Converted:
    """The file."""
    values = {**densities(imu), "update_rate": imu.given_rate("--rate, of the IMU")}
    lines = [*imu.header(TITLE, SOURCE), *yaml_lines(values), "rostopic: /imu0  # yours"]
    return Converted("\n".join(lines), values, imu.warnings(TITLE))
