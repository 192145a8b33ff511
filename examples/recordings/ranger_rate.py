"""An hour of a time-of-flight ranger whose header says 50 Hz, while its samples are 55.6 a second.

Recording: T. Suarez, TimeOfFlightCalibration (MIT).
"""

from pathlib import Path

from common import Case, at_rest, main, of_channel

from kfgen.log.readers import ColumnMap, read_log


def ranger(file: Path) -> Case:
    """The second half is what is assumed."""
    log = read_log(file, columns=ColumnMap.parse("distance = dist_mm [mm]"))
    return of_channel(log, "distance", at_rest(log, ["distance"], log.n // 2, log.n))


if __name__ == "__main__":
    main(str(__doc__), {"ranger": ("static/tof_vl53l0x_1h.npz", ranger)})
