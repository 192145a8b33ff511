"""A gyro that warms up: the noise of its last 100 s is what is assumed about the whole record.

Recording: S. Shrikanth (MIT); 8.75 mdps a count. 200 Hz is a guess, for the source states no rate.
"""

from pathlib import Path

from common import Case, at_rest, main, of_channel

from kfgen.log.readers import ColumnMap, read_log


def warm_up(file: Path) -> Case:
    """Beside the warm-up: a slow random bias, two lines of a fan or a supply, and a roll-off."""
    log = read_log(file, rate=200.0, columns=ColumnMap.parse("gyro_x = gyr_counts [deg/s*0.00875]"))
    return of_channel(log, "gyro_x", at_rest(log, ["gyro_x"], log.n - 20_000, log.n))


if __name__ == "__main__":
    main(str(__doc__), {"warm-up": ("static/gyro_875mdps_warmup.npz", warm_up)})
