"""A walk with a hand-held receiver and inertial sensor, and no reference: what the filter's own innovations say.

Recording: T. Everett, GNSS_IMU (BSD-3): an RTK solution good to a centimetre, 4 Hz; the inertial sensor 0.05 m beside the
antenna, its axes turned; no clock offset was found by hand, and the noise of the sensor's data sheet was taken four times.
"""

from pathlib import Path

import numpy as np
from common import AXES, Array, Case, main, of_log
from scipy.spatial.transform import Rotation

import kfgen as kf
from kfgen.effects import make
from kfgen.effects.noise_model import ChannelNoise, NoiseModel, Term
from kfgen.log.log import Channel, Log

MOUNTED = Rotation.from_euler("xyz", [180.0, 0.0, -90.0], degrees=True)
STANDARD_GRAVITY = 9.80665
UNITS = {"gyro": "rad/s", "accel": "m/s^2", "gnss_p": "m", "gnss_v": "m/s"}
NOISE = NoiseModel(
    {
        "gyro": ChannelNoise("rad/s", (Term(make("white_noise", N=2.6e-4)),)),
        "accel": ChannelNoise("m/s^2", (Term(make("white_noise", N=2.7e-2)),)),
        "gnss_p": ChannelNoise("m", (Term(make("sample_noise", sd=0.015)),)),
        "gnss_v": ChannelNoise("m/s", (Term(make("sample_noise", sd=0.05)),)),
    }
)


def recorded(file: Path) -> Log:
    """Both recordings as one log: samples of the receiver in the nearest rows of the inertial sensor."""
    raw = np.loadtxt(file, delimiter=",")
    gnss = kf.read_log(file.parent / "rtk_walk_gnss.pos")
    t, fixes = raw[:, 0] - raw[0, 0], np.asarray(gnss.t) - raw[0, 0]
    triads: dict[str, Array] = {
        "accel": MOUNTED.apply(raw[:, 1:4] * STANDARD_GRAVITY),
        "gyro": MOUNTED.apply(raw[:, 4:7]),
    }
    channels = {
        f"{s}_{a}": Channel.of(v[:, k], UNITS[s]) for s, v in triads.items() for k, a in enumerate(AXES)
    }
    inside = (fixes > 0.0) & (fixes < t[-1])
    rows = np.array([int(np.argmin(np.abs(t - x))) for x in fixes[inside]])
    for sensor in ("gnss_p", "gnss_v"):
        for a in "NED":
            values = np.full(t.size, np.nan)
            values[rows] = gnss.channels[f"{sensor}_{a}"].values[inside]
            channels[f"{sensor}_{a}"] = Channel.of(values, UNITS[sensor])
    return Log(t, channels, source=file.name)


def walk(file: Path) -> Case:
    """The receiver's velocity is smoothed and later than its position, and fixes are half as noisy as assumed."""
    return of_log(recorded(file), kf.build("ins15", noise=NOISE))


if __name__ == "__main__":
    main(str(__doc__), {"walk": ("flights/rtk_walk_imu.csv", walk)})
