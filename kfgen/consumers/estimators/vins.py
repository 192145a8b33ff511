"""VINS-Fusion and VINS-Mono: standard deviations of samples, although their files do not say so.

The pre-integration takes each step from two samples, half of each, as if every step had two of its own: a step adds
``(dt n)^2 / 2`` to the variance of an angle or a velocity. It is ``N^2 dt`` for ``n = N sqrt(2/dt)``. The walks add
``(dt w)^2`` in every step, so ``w = K / sqrt(dt)``.

References
----------
.. [1] github.com/HKUST-Aerial-Robotics/VINS-Fusion, ``vins_estimator/src/factor/integration_base.h``: the matrices ``V``
   and ``noise`` (read at 939f0128); ``config/euroc/euroc_mono_imu_config.yaml``: names.
"""

from __future__ import annotations

import math

from kfgen.consumers.base import IMU_RATE, Converted, Imu
from kfgen.consumers.yaml_text import yaml_lines

NAME = "vins"
TITLE = "VINS-Fusion settings"
SOURCE = "read in HKUST-Aerial-Robotics/VINS-Fusion: factor/integration_base.h, config/euroc"
RATE = f"{IMU_RATE}, since its numbers are standard deviations of samples"
NEEDS = ("gyro", "accel")


def convert(imu: Imu) -> Converted:
    """The settings of the inertial sensor; OpenCV wants the directive on its first line."""
    rate = imu.rate or 0.0
    dt = f"dt = {1.0 / rate:.6g} s" if rate else ""
    sample, walk = (math.sqrt(2.0 * rate), f" sqrt(2/dt), {dt}"), (math.sqrt(rate), f" / sqrt(dt), {dt}")
    values = {
        "acc_n": imu.scalar("accel", "N", "m/s^2", *sample),
        "gyr_n": imu.scalar("gyro", "N", "rad/s", *sample),
        "acc_w": imu.scalar("accel", "K", "m/s^3", *walk),
        "gyr_w": imu.scalar("gyro", "K", "rad/s^2", *walk),
    }
    lines = ["%YAML:1.0", "", *imu.header(TITLE, SOURCE), *yaml_lines(values)]
    lines.append("g_norm: 9.80665  # [m/s^2] the local gravity; yours")
    return Converted("\n".join(lines), values, imu.warnings(TITLE))
