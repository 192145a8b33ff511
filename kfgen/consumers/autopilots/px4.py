"""PX4's EKF2: standard deviations of one prediction step, ``N / sqrt(dt)`` and ``K / sqrt(dt)``; what a flight found.

The step is that of the filter, not of the sensor: ``EKF2_PREDICT_US``, 10000 us unless it was changed. A magnetometer is
corrected as ``scale ((sample + current comp) - offset)`` in its own axes.

References
----------
.. [1] github.com/PX4/PX4-Autopilot, ``src/modules/ekf2/EKF/covariance.cpp``: ``sq(delta_ang_dt * gyro_noise)`` and
   ``sq(dt * gyro_bias_p_noise)`` on a bias in rad/s (read at 028733e1); ``module.yaml``, ``params_*.yaml``: names,
   units, ranges, defaults and the period (read).
.. [2] the same, ``src/lib/sensor_calibration/Magnetometer.hpp``: ``Correct`` (read).
"""

from __future__ import annotations

import sys

from kfgen.consumers.autopilots.settable_values import SettableValues
from kfgen.consumers.autopilots.settings import (
    VALUE_THAT_FLEW,
    Setting,
    autopilot_file,
    iron_settings,
    noise_of,
    on_axes,
)
from kfgen.consumers.autopilots.steps import Step
from kfgen.consumers.base import Converted, Imu

NAME = "px4"
TITLE = "PX4 EKF2 parameters"
SOURCE = "read in PX4/PX4-Autopilot: ekf2/EKF/covariance.cpp, module.yaml, params_*.yaml, Magnetometer.hpp"
RATE = "that of the filter's steps, 1e6 / EKF2_PREDICT_US, which is 100 Hz by PX4's default of 10000 us"
USUAL_RATE_HZ = 100.0
NEEDS = ()
DOCUMENTS = "PX4's documents"
LINE = "param set {name} {value}"

STEPS = {
    "EKF2_GYR_NOISE": Step("gyro", "N", "rad/s", 1e-4, 0.1, 0.015),
    "EKF2_ACC_NOISE": Step("accel", "N", "m/s^2", 0.01, 1.0, 0.35),
    "EKF2_GYR_B_NOISE": Step("gyro", "K", "rad/s^2", 0.0, 0.01, 1e-3),
    "EKF2_ACC_B_NOISE": Step("accel", "K", "m/s^3", 0.0, 0.01, 3e-3),
}
_SENSOR_AXES = f"in the axes of the sensor: turn it back where CAL_MAG0_ROT is not 0{VALUE_THAT_FLEW}"
_METRES = Setting((), "m", -10.0, 10.0, said="from the vehicle's origin, with EKF2_IMU_POS_* that of the IMU")
SETTINGS = {
    "EKF2_GPS_DELAY": Setting(("gnss.delay",), "ms", 0.0, 300.0, said="above 200 raise EKF2_DELAY_MAX too"),
    "EKF2_MAG_DELAY": Setting(("mag.delay",), "ms", 0.0, 300.0),
    "EKF2_BARO_DELAY": Setting(("baro.delay",), "ms", 0.0, 300.0),
    "EKF2_ASP_DELAY": Setting(("airspeed.delay",), "ms", 0.0, 300.0),
    "EKF2_RNG_DELAY": Setting(("range.delay",), "ms", 0.0, 300.0),
    **on_axes("EKF2_GPS_POS_{axis}", "gnss.arm", _METRES),
    **on_axes(
        "EKF2_IMU_POS_{axis}", "accel.arm", Setting((), "m", -10.0, 10.0, said="from the vehicle's origin")
    ),
    "EKF2_GPS_P_NOISE": Setting(noise_of(*(f"gnss_p_{a}" for a in "NED")), "m", 0.01, 10.0),
    "EKF2_GPS_V_NOISE": Setting(noise_of(*(f"gnss_v_{a}" for a in "NED")), "m/s", 0.01, 5.0),
    "EKF2_BARO_NOISE": Setting(noise_of("baro_height"), "m", 0.01, 15.0),
    "EKF2_MAG_NOISE": Setting(noise_of("mag", *(f"mag_{a}" for a in "xyz")), "gauss", 0.001, 1.0),
    "EKF2_HEAD_NOISE": Setting(noise_of("heading"), "rad", 0.01, 1.0),
    "EKF2_EAS_NOISE": Setting(noise_of("airspeed"), "m/s", 0.5, 5.0),
    "EKF2_RNG_NOISE": Setting(noise_of("range"), "m", 0.01, 10.0),
    **on_axes("CAL_MAG0_{axis}OFF", "mag.offset", Setting((), "gauss", -3.0, 3.0, said=_SENSOR_AXES)),
    **on_axes(
        "CAL_MAG0_{axis}COMP",
        "mag.current",
        Setting((), "gauss/kA", -1e3, 1e3, -1.0, said=_SENSOR_AXES, needs={"CAL_MAG_COMP_TYP": 2}),
    ),
    **iron_settings("CAL_MAG0_{of}SCALE", "CAL_MAG0_{of}ODIAG", 0.1, 3.0),
    **on_axes(
        "CAL_ACC0_{axis}SCALE", "accel.scale", Setting((), "1", 0.1, 3.0, base=1.0, said=VALUE_THAT_FLEW[2:])
    ),
    "EKF2_PCOEF_XP": Setting(("baro.dynamic",), "1", -0.5, 0.5, said="of forward flight"),
    "EKF2_MAG_DECL": Setting(("mag.declination",), "deg", -180.0, 180.0, needs={"EKF2_DECL_TYPE": 0}),
}


def convert(imu: Imu, findings: SettableValues | None = None) -> Converted:
    """Lines for the autopilot's console.

    Parameters
    ----------
    imu : Imu
    findings : SettableValues, optional
        Of a filter file.

    Returns
    -------
    Converted
    """
    return autopilot_file(sys.modules[__name__], imu, findings)
