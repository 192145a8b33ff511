"""PX4's EKF2: standard deviations of one prediction step, ``N / sqrt(dt)`` and ``K / sqrt(dt)``.

The step is that of the filter, not of the sensor: ``EKF2_PREDICT_US``, 10000 us unless it was changed.

References
----------
.. [1] github.com/PX4/PX4-Autopilot, ``src/modules/ekf2/EKF/covariance.cpp``: ``sq(delta_ang_dt * gyro_noise)`` and
   ``sq(dt * gyro_bias_p_noise)`` on a bias in rad/s (read at 028733e1); ``module.yaml``, ``params_gyro_bias.yaml``,
   ``params_accel_bias.yaml``: names, units, ranges and the period (read).
"""

from __future__ import annotations

from kfgen.consumers.autopilots.steps import Step, lines, outside, stepped
from kfgen.consumers.base import Converted, Imu

NAME = "px4"
TITLE = "PX4 EKF2 parameters"
SOURCE = "read in PX4/PX4-Autopilot: ekf2/EKF/covariance.cpp, module.yaml, params_*_bias.yaml"
RATE = "that of the filter's steps, 1e6 / EKF2_PREDICT_US, which is 100 Hz by PX4's default of 10000 us"
NEEDS = ()

STEPS = {
    "EKF2_GYR_NOISE": Step("gyro", "N", "rad/s", 1e-4, 0.1),
    "EKF2_ACC_NOISE": Step("accel", "N", "m/s^2", 0.01, 1.0),
    "EKF2_GYR_B_NOISE": Step("gyro", "K", "rad/s^2", 0.0, 0.01),
    "EKF2_ACC_B_NOISE": Step("accel", "K", "m/s^3", 0.0, 0.01),
}


def convert(imu: Imu) -> Converted:
    """Lines for the autopilot's console."""
    values = stepped(imu, STEPS)
    text = [*imu.header(TITLE, SOURCE), *lines(values, "param set {name} {value}")]
    return Converted(
        "\n".join(text), values, (*imu.warnings(TITLE), *outside(values, STEPS, "PX4's documents"))
    )
