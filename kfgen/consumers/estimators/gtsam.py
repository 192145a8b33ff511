"""GTSAM's ``PreintegrationCombinedParams``: continuous covariances ``N^2`` and ``K^2`` of each axis.

The text is Python; the lines for C++ stand in its comments. ``integrationCovariance`` and ``biasAccOmegaInt`` are no
noise of the sensor and are left to the user.

References
----------
.. [1] github.com/borglab/gtsam, ``gtsam/navigation/PreintegrationParams.h`` and ``PreintegrationCombinedParams.h``:
   "continuous-time covariance", and the setters (read).
"""

from __future__ import annotations

from kfgen.consumers.base import Converted, Imu, Value
from kfgen.consumers.yaml_text import real

NAME = "gtsam"
TITLE = "GTSAM PreintegrationCombinedParams"
SOURCE = "read in borglab/gtsam: PreintegrationParams.h, PreintegrationCombinedParams.h; run with 4.3.0"
RATE = ""
NEEDS = ("gyro", "accel")


def convert(imu: Imu) -> Converted:
    """Python lines, C++ beside them."""
    values = {
        "gyroscopeCovariance": imu.vector("gyro", "N", "(rad/s)^2/Hz", 2),
        "accelerometerCovariance": imu.vector("accel", "N", "(m/s^2)^2/Hz", 2),
        "biasOmegaCovariance": imu.vector("gyro", "K", "(rad/s^2)^2/Hz", 2),
        "biasAccCovariance": imu.vector("accel", "K", "(m/s^3)^2/Hz", 2),
    }
    lines = [*imu.header(TITLE, SOURCE, per_axis=True), "import gtsam", "import numpy as np", ""]
    lines += ["params = gtsam.PreintegrationCombinedParams.MakeSharedU(9.80665)  # z up; the local gravity"]
    for name, v in values.items():
        lines += _lines(name, v)
    return Converted("\n".join(lines), values, imu.warnings(TITLE))


def _lines(name: str, v: Value) -> list[str]:
    if not v.numbers:
        return [f"# {name}: {v.words}; GTSAM's default is the unit matrix"]
    numbers = ", ".join(map(real, v.numbers))
    setter = f"set{name[0].upper()}{name[1:]}"
    return [
        f"# {name} [{v.unit}]: {v.words}",
        f"params.{setter}(np.diag([{numbers}]))",
        f"# C++: params->{setter}(gtsam::Matrix3(gtsam::Vector3({numbers}).asDiagonal()));",
    ]
