"""ORB-SLAM3's settings: continuous N and K in SI, and the rate that it scales them with.

It multiplies the noises by ``sqrt(IMU.Frequency)`` and divides the walks by it, so the frequency must be that of
the IMU. A number without a point is no real number to its reader.

References
----------
.. [1] github.com/UZ-SLAMLab/ORB_SLAM3, ``Examples/Monocular-Inertial/EuRoC.yaml`` (read);
   ``src/Tracking.cc``, ``IMU::Calib(Tbc, Ng*sf, Na*sf, Ngw/sf, Naw/sf)`` (read in copies).
"""

from __future__ import annotations

from kfgen.consumers.base import IMU_RATE, Converted, Imu
from kfgen.consumers.yaml_text import yaml_lines

NAME = "orbslam3"
TITLE = "ORB-SLAM3 settings"
SOURCE = "read in UZ-SLAMLab/ORB_SLAM3: EuRoC.yaml; src/Tracking.cc in copies of it"
RATE = f"{IMU_RATE} (IMU.Frequency), by which it scales the noise"
NEEDS = ("gyro", "accel")


def convert(imu: Imu) -> Converted:
    """Lines for the settings file."""
    values = {
        "IMU.NoiseGyro": imu.scalar("gyro", "N", "rad/s/sqrt(Hz)"),
        "IMU.NoiseAcc": imu.scalar("accel", "N", "m/s^2/sqrt(Hz)"),
        "IMU.GyroWalk": imu.scalar("gyro", "K", "rad/s^2/sqrt(Hz)"),
        "IMU.AccWalk": imu.scalar("accel", "K", "m/s^3/sqrt(Hz)"),
        "IMU.Frequency": imu.given_rate("--rate, of the IMU"),
    }
    lines = [*imu.header(TITLE, SOURCE), *yaml_lines(values)]
    return Converted("\n".join(lines), values, imu.warnings(TITLE))
