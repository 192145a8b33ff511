"""ArduPilot's EKF3: standard deviations of one step of the filter, ``N / sqrt(dt)`` and ``K / sqrt(dt)``; what a flight found.

Its bias states are ``b dt``, driven by ``sq(sq(dt) * p)``, so ``b`` is driven by ``sq(dt * p)``. The step is the
filter's, 12 ms at most sampling rates (``EKF_TARGET_DT``), which is 83.3 Hz. A compass is corrected as
``D (sample + offset + current mot)`` in body axes, in milligauss.

References
----------
.. [1] ArduPilot, ``libraries/AP_NavEKF3/AP_NavEKF3_core.cpp``: ``sq(dt*_gyrNoise)``, ``sq(dt*_accNoise)``,
   ``sq(sq(dt) * _gyroBiasProcessNoise)`` (read at ArduPilot/ardupilot 363e7e9e); ``AP_NavEKF3_core.h``: the 12 ms, and
   ``AP_NavEKF3.cpp``: names, units, ranges, defaults of copters (read in copies whose release is not known).
.. [2] the same, ``AP_Compass_Backend.cpp``: ``correct_field``; ``AP_GPS.cpp``: ``GPS_DELAY_MS``, ``GPS_POS1`` (read in copies).
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

NAME = "ardupilot"
TITLE = "ArduPilot EKF3 parameters"
SOURCE = "read in ArduPilot/ardupilot: AP_NavEKF3_core.cpp; ranges and the 12 ms in copies of it, release not known"
RATE = "that of the filter's steps, 83.3 Hz for its usual 12 ms (EKF_TARGET_DT)"
USUAL_RATE_HZ = 83.3
NEEDS = ()
DOCUMENTS = "ArduPilot's documents"
LINE = "{name},{value}"

STEPS = {
    "EK3_GYRO_P_NSE": Step("gyro", "N", "rad/s", 1e-4, 0.1, 0.015),
    "EK3_ACC_P_NSE": Step("accel", "N", "m/s^2", 0.01, 1.0, 0.35),
    "EK3_GBIAS_P_NSE": Step("gyro", "K", "rad/s^2", 1e-5, 1e-3, 1e-3),
    "EK3_ABIAS_P_NSE": Step("accel", "K", "m/s^3", 1e-5, 0.02, 0.02),
}
SETTINGS = {
    "GPS_DELAY_MS": Setting(("gnss.delay",), "ms", 0.0, 250.0, said="GPS1_DELAY_MS from 4.6 on"),
    "EK3_HGT_DELAY": Setting(("baro.delay",), "ms", 0.0, 250.0),
    **on_axes("GPS_POS1_{axis}", "gnss.arm", Setting((), "m", -5.0, 5.0, said="GPS1_POS_* from 4.6 on")),
    **on_axes("INS_POS1_{axis}", "accel.arm", Setting((), "m", -5.0, 5.0)),
    "EK3_POSNE_M_NSE": Setting(noise_of("gnss_p_N", "gnss_p_E"), "m", 0.1, 10.0),
    "EK3_VELNE_M_NSE": Setting(noise_of("gnss_v_N", "gnss_v_E"), "m/s", 0.05, 5.0),
    "EK3_VELD_M_NSE": Setting(noise_of("gnss_v_D"), "m/s", 0.05, 5.0),
    "EK3_ALT_M_NSE": Setting(noise_of("baro_height"), "m", 0.1, 100.0),
    "EK3_MAG_M_NSE": Setting(noise_of("mag", *(f"mag_{a}" for a in "xyz")), "gauss", 0.01, 0.5),
    "EK3_EAS_M_NSE": Setting(noise_of("airspeed"), "m/s", 0.5, 5.0),
    "EK3_RNG_M_NSE": Setting(noise_of("range"), "m", 0.1, 10.0),
    **on_axes(
        "COMPASS_OFS_{axis}", "mag.offset", Setting((), "mG", -400.0, 400.0, -1.0, said=VALUE_THAT_FLEW[2:])
    ),
    **on_axes(
        "COMPASS_MOT_{axis}",
        "mag.current",
        Setting((), "mG/A", -1000.0, 1000.0, -1.0, said=VALUE_THAT_FLEW[2:], needs={"COMPASS_MOTCT": 2}),
    ),
    **iron_settings("COMPASS_DIA_{of}", "COMPASS_ODI_{of}", 0.2, 5.0),
    **on_axes(
        "INS_ACCSCAL_{axis}", "accel.scale", Setting((), "1", 0.8, 1.2, base=1.0, said=VALUE_THAT_FLEW[2:])
    ),
    "BARO1_WCF_FWD": Setting(("baro.dynamic",), "1", -1.0, 1.0, needs={"BARO1_WCF_ENABLE": 1}),
    "COMPASS_DEC": Setting(("mag.declination",), "rad", -3.142, 3.142, needs={"COMPASS_AUTODEC": 0}),
}


def convert(imu: Imu, findings: SettableValues | None = None) -> Converted:
    """A parameter file.

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
