"""A simulated quadrotor that climbs and comes down, and no reference: what the innovations of a filter say of its receiver.

Recording: PX4-ECL's replay (PX4/PX4-ECL, BSD-3), which does not say how late its fixes are. An independent fit in which
position and velocity are late together has 0.200 +- 0.016 s, or a drift: there is one climb.
"""

from pathlib import Path

from common import Case, main, of_log

import kfgen as kf


def climb(file: Path) -> Case:
    """As anybody would type it: the log, and the filter as it is built."""
    return of_log(kf.read_log(file), kf.build("ins15"))


if __name__ == "__main__":
    main(str(__doc__), {"climb": ("flights/ecl_iris_gps_replay.csv", climb)})
