"""OpenVINS's ``kalibr_imu_chain.yaml``: Kalibr's four numbers under ``imu0``, no intrinsics.

References
----------
.. [1] github.com/rpng/open_vins, ``config/euroc_mav/kalibr_imu_chain.yaml`` (read); the option parser
   ``parse_external("relative_config_imu", "imu0", ...)`` (read in copies).
"""

from __future__ import annotations

from kfgen.consumers.base import IMU_RATE, Converted, Imu
from kfgen.consumers.estimators.kalibr import densities
from kfgen.consumers.yaml_text import yaml_lines

NAME = "openvins"
TITLE = "OpenVINS kalibr_imu_chain.yaml"
SOURCE = "read in rpng/open_vins: config/euroc_mav/kalibr_imu_chain.yaml; its option parser in copies of it"
RATE = f"{IMU_RATE} (update_rate)"
NEEDS = ("gyro", "accel")

_MATRICES = {"T_i_b": (4, 1.0), "Tw": (3, 1.0), "R_IMUtoGYRO": (3, 1.0), "Ta": (3, 1.0)}
_MATRICES |= {"R_IMUtoACC": (3, 1.0), "Tg": (3, 0.0)}


def convert(imu: Imu) -> Converted:
    """The file; OpenCV wants the directive on its first line."""
    values = {**densities(imu), "update_rate": imu.given_rate("--rate, of the IMU")}
    lines = ["%YAML:1.0", "", *imu.header(TITLE, SOURCE), "", "imu0:", *yaml_lines(values, "  ")]
    lines += ["  rostopic: /imu0  # yours", "  time_offset: 0.0"]
    lines += ['  model: "kalibr"  # what follows is no intrinsics: a noise file knows none']
    for name, (size, diagonal) in _MATRICES.items():
        lines.append(f"  {name}:")
        for i in range(size):
            row = ", ".join(str(diagonal if i == j else 0.0) for j in range(size))
            lines.append(f"    - [ {row} ]")
    return Converted("\n".join(lines), values, imu.warnings(TITLE))
