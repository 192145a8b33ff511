"""LIO-SAM: continuous N and K in SI, which it squares for GTSAM; a bias may move by ``K sqrt(dt)`` between two scans.

References
----------
.. [1] github.com/TixiaoShan/LIO-SAM, ``src/imuPreintegration.cpp``: covariances "in continuous", and
   ``sqrt(deltaTij) * noiseModelBetweenBias`` (read in copies); ``config/params.yaml``: names.
"""

from __future__ import annotations

from kfgen.consumers.base import Converted, Imu
from kfgen.consumers.yaml_text import yaml_lines

NAME = "liosam"
TITLE = "LIO-SAM params.yaml"
SOURCE = "TixiaoShan/LIO-SAM: src/imuPreintegration.cpp, read in copies of it; config/params.yaml"
RATE = ""
NEEDS = ("gyro", "accel")


def convert(imu: Imu) -> Converted:
    """The settings of the inertial sensor."""
    values = {
        "imuAccNoise": imu.scalar("accel", "N", "m/s^2/sqrt(Hz)"),
        "imuGyrNoise": imu.scalar("gyro", "N", "rad/s/sqrt(Hz)"),
        "imuAccBiasN": imu.scalar("accel", "K", "m/s^3/sqrt(Hz)"),
        "imuGyrBiasN": imu.scalar("gyro", "K", "rad/s^2/sqrt(Hz)"),
    }
    lines = [*imu.header(TITLE, SOURCE), "lio_sam:", *yaml_lines(values, "  ")]
    lines.append("  imuGravity: 9.80665  # [m/s^2] the local gravity; yours")
    return Converted("\n".join(lines), values, imu.warnings(TITLE))
