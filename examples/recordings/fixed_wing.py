"""A flight as a log: a fixed wing, its inertial sensor near 146 Hz with uneven steps, its GPS at 5 Hz.

Recording: P. Riseborough, InertialNav (BSD-3), who gives 0.21 and 0.23 s as the delays of its GPS.
"""

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from kfgen.effects import make
from kfgen.effects.noise_model import ChannelNoise, NoiseModel, Term
from kfgen.log.log import Channel, Log
from kfgen.model.filter import FilterModel
from kfgen.model.library import build

EARTH = 6371e3
FIX = 6.9e-3**0.5
"""A fix of 1 m as a density [m/sqrt(Hz)] at the rate of the inertial sensor."""
NOISE = {
    "gyro": ("rad/s", 5e-3),
    "accel": ("m/s^2", 0.3),
    "gnss_p": ("m", 2 * FIX),
    "gnss_v": ("m/s", FIX / 2),
}
"""Densities per sqrt(Hz): an airframe that shakes, fixes good to 2 m and 0.5 m/s."""
UNITS = {
    f"{name}_{a}": unit for name, (unit, _) in NOISE.items() for a in ("NED" if "gnss" in name else "xyz")
}


def model() -> FilterModel:
    """ins15 as assumed."""
    terms = {name: Term(make("white_noise", N=N)) for name, (_, N) in NOISE.items()}
    noise = {c: ChannelNoise(unit, (terms[c[:-2]],)) for c, unit in UNITS.items()}
    return build("ins15", NoiseModel(noise), {"delay": "0.22 s"})


def flight(file: Path) -> tuple[Log, dict[str, float]]:
    """The log, a fix counting at the inertial sample after it, and the first attitude: the autopilot's."""
    with np.load(file) as archive:
        a = {k: np.asarray(archive[k], float) for k in archive.files if k != "meta"}
    arc = np.radians([a["lat"] - a["lat"][0], a["lon"] - a["lon"][0]])
    north, east = EARTH * arc * [[1.0], [np.cos(np.radians(a["lat"][0]))]]
    course = a["gndspd"] * [np.cos(a["course"]), np.sin(a["course"])]
    fixes = np.array([north, east, a["hgt"][0] - a["hgt"], *course, a["vel_d"]])
    inside = a["t_gps"] <= a["t_imu"][-1]
    at, first = np.unique(np.searchsorted(a["t_imu"], a["t_gps"][inside]), return_index=True)
    aiding = np.full((6, a["t_imu"].size), np.nan)
    aiding[:, at] = fixes[:, first]
    values = [*a["gyr"].T, *a["acc"].T, *aiding]
    channels = {c: Channel.of(v, unit) for (c, unit), v in zip(UNITS.items(), values, strict=True)}
    q = Rotation.from_euler("ZYX", a["rpy"][0, ::-1], degrees=True).as_quat(scalar_first=True)
    start = {f"q_{x}": float(v) for x, v in zip("wxyz", q, strict=True)}
    return Log(a["t_imu"], channels, source=file.name), start
