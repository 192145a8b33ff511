"""A periodic line in the y gyro of an MPU-6050 at rest; its first half is what is assumed.

Recording: T. Suarez, ImuCalibration (MIT); 131 counts a degree per second.
"""

from pathlib import Path

from common import Case, at_rest, main, of_channel

from kfgen.log.readers import ColumnMap, read_log


def line(file: Path) -> Case:
    """A line is no part of a noise file, so the half that is assumed says nothing of it."""
    log = read_log(file, columns=ColumnMap.parse("gyro_y = gyr_counts_y [deg/s/131]"))
    log = log.cut(300, log.n)  # it was still being laid down
    return of_channel(log, "gyro_y", at_rest(log, ["gyro_y"], 0, log.n // 2))


if __name__ == "__main__":
    main(str(__doc__), {"line": ("static/mpu6050_static_450s.npz", line)})
