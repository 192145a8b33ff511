"""ArduPilot's EKF3: standard deviations of one step of the filter, ``N / sqrt(dt)`` and ``K / sqrt(dt)``.

Its bias states are ``b dt``, driven by ``sq(sq(dt) * p)``, so ``b`` is driven by ``sq(dt * p)``. The step is the
filter's, 12 ms at most sampling rates (``EKF_TARGET_DT``), which is 83.3 Hz.

References
----------
.. [1] ArduPilot, ``libraries/AP_NavEKF3/AP_NavEKF3_core.cpp``: ``sq(dt*_gyrNoise)``, ``sq(dt*_accNoise)``,
   ``sq(sq(dt) * _gyroBiasProcessNoise)`` (read at ArduPilot/ardupilot 363e7e9e); ``AP_NavEKF3_core.h``: the 12 ms, and
   ``AP_NavEKF3.cpp``: names, units, ranges (read in copies whose release is not known).
"""

from __future__ import annotations

from kfgen.consumers.autopilots.steps import Step, lines, outside, stepped
from kfgen.consumers.base import Converted, Imu

NAME = "ardupilot"
TITLE = "ArduPilot EKF3 parameters"
SOURCE = "read in ArduPilot/ardupilot: AP_NavEKF3_core.cpp; ranges and the 12 ms in copies of it, release not known"
RATE = "that of the filter's steps, 83.3 Hz for its usual 12 ms (EKF_TARGET_DT)"
NEEDS = ()

STEPS = {
    "EK3_GYRO_P_NSE": Step("gyro", "N", "rad/s", 1e-4, 0.1),
    "EK3_ACC_P_NSE": Step("accel", "N", "m/s^2", 0.01, 1.0),
    "EK3_GBIAS_P_NSE": Step("gyro", "K", "rad/s^2", 1e-5, 1e-3),
    "EK3_ABIAS_P_NSE": Step("accel", "K", "m/s^3", 1e-5, 0.02),
}


def convert(imu: Imu) -> Converted:
    """A parameter file."""
    values = stepped(imu, STEPS)
    text = [*imu.header(TITLE, SOURCE), *lines(values, "{name},{value}")]
    said = outside(values, STEPS, "ArduPilot's documents")
    return Converted("\n".join(text), values, (*imu.warnings(TITLE), *said))
