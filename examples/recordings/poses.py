"""Accelerometers of two MPU-9150 at rest in many poses: bias, scale and angles between the axes, no reference needed.

Recordings: M. Kok, imu-calib (MIT), whose own table has for the first one bias 0.103, 0.097, 0.345 m/s^2 and
scale 0.36, 0.32, 0.62 % with g = 9.81 m/s^2; with standard gravity every scale is 0.03 % larger.
"""

from pathlib import Path

from common import AXES, Case, at_rest, main, of_scene

from kfgen.gap.motion.known_length import norm_scene
from kfgen.identify.screening.rests import rests
from kfgen.log.readers import read_log


def posed(file: Path) -> Case:
    """As quiet as in the longest pose is what is assumed, and no error of scale or bias."""
    log = read_log(file)
    names = [f"accel_{a}" for a in AXES]
    log = log.select(names)
    start, stop = max(rests(log, "accel"), key=lambda p: p[1] - p[0])
    _, said, answer = of_scene(log, norm_scene(log, at_rest(log, names, start, stop)))
    return said, answer


if __name__ == "__main__":
    main(str(__doc__), {f"poses-{k}": (f"effects/mpu9150_calib_imu{k}.npz", posed) for k in (0, 1)})
