"""FAST-LIO and FAST-LIO2: variances of samples, ``N^2 / dt`` and ``K^2 / dt``.

Its filter adds ``(dt)^2 Q`` in every step, where `Q` holds these numbers; a step is the time between two samples.

References
----------
.. [1] github.com/hku-mars/FAST_LIO, ``include/IKFoM_toolkit/esekfom/esekfom.hpp``: ``predict`` (read in copies);
   ``src/IMU_Processing.hpp``: ``Q`` (read in copies); ``config/avia.yaml``: names.
"""

from __future__ import annotations

import math

from kfgen.consumers.base import IMU_RATE, Converted, Imu
from kfgen.consumers.yaml_text import yaml_lines

NAME = "fastlio"
TITLE = "FAST-LIO settings"
SOURCE = "hku-mars/FAST_LIO: esekfom.hpp and IMU_Processing.hpp, read in copies of them; config/avia.yaml"
RATE = f"{IMU_RATE}, since its numbers are variances of samples"
NEEDS = ("gyro", "accel")


def convert(imu: Imu) -> Converted:
    """The block ``mapping`` of its settings."""
    factor = math.sqrt(imu.rate or 0.0)
    by = f" / sqrt(dt), dt = {1.0 / imu.rate:.6g} s" if imu.rate else ""
    values = {
        "acc_cov": imu.scalar("accel", "N", "(m/s^2)^2", factor, by, power=2),
        "gyr_cov": imu.scalar("gyro", "N", "(rad/s)^2", factor, by, power=2),
        "b_acc_cov": imu.scalar("accel", "K", "(m/s^3)^2", factor, by, power=2),
        "b_gyr_cov": imu.scalar("gyro", "K", "(rad/s^2)^2", factor, by, power=2),
    }
    lines = [*imu.header(TITLE, SOURCE), "mapping:", *yaml_lines(values, "    ")]
    return Converted("\n".join(lines), values, imu.warnings(TITLE))
