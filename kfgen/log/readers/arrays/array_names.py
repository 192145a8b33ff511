"""What arrays of other programs are called: channels by the usual names of triads, axes and single quantities."""

from __future__ import annotations

import re

CHANNELS: tuple[tuple[int, str, str, str], ...] = (
    (3, r"gyro_rad", "gyro", "rad/s"),
    (3, r"gyro_?dps|gyr_?dps", "gyro", "deg/s"),
    (3, r"gyr|gyro|gyros|gyroscope|ang_?rate|angular_?(velocity|rate)|omega|w|g", "gyro", ""),
    (3, r"accelerometer_m_s2", "accel", "m/s^2"),
    (3, r"acc|accel|accels|accelerometer|(linear_)?acceleration|specific_force|a|f", "accel", ""),
    (3, r"magnetometer_ga", "mag", "gauss"),
    (3, r"mag|magn|magnetometer|magnetic(_field)?|m", "mag", ""),
    (3, r"ref_gyro|ref_accel|ref_mag", "", ""),
    (1, r"(imu_)?temp(erature)?(_(imu|gyro|c|degc))?", "temperature", "degC"),
    (1, r"baro_pressure_pa", "pressure", "Pa"),
    (1, r"(bar(o(meter)?)?_?)?press(ure)?|bar(ometer)?", "pressure", ""),
    (1, r"hgt_?baro|baro_?(alt|hgt|height|altitude)(_meter|_m)?|alt_?baro", "baro_height", "m"),
    (1, r"true_airspeed_m_s|airspeed|air_?speed|v?tas|v?eas|ias", "airspeed", "m/s"),
    (1, r"(battery_)?current(_a)?", "current", "A"),
    (1, r"(battery_)?voltage(_v)?", "voltage", "V"),
    (1, r"throttle", "throttle", "1"),
    (1, r"movement", "movement", ""),
)
"""Axes, pattern of a name without its axis, the sensor or channel, and the unit that the name says."""

GNSS: tuple[tuple[str, str], ...] = (
    (r"lat(itude)?(_?deg)?", "latitude"),
    (r"(lon|lng|long)(itude)?(_?deg)?", "longitude"),
    (r"hgt|height|alt(itude)?(_(msl|ellipsoid))?(_m)?", "height"),
    (r"(gps_|gnss_)?vel?_?n(orth)?(_m_s)?", "v_N"),
    (r"(gps_|gnss_)?vel?_?e(ast)?(_m_s)?", "v_E"),
    (r"(gps_|gnss_)?vel?_?d(own)?(_m_s)?", "v_D"),
    (r"course(_?deg)?|cog(_rad)?", "course"),
    (r"(gnd|ground)_?(spd|speed)|sog", "speed"),
    (r"fix_type", "fix"),
)
"""Pattern of a name in a group of arrays that has coordinates, and what it is."""

RATE_NAMES = r"fs|f_s|sampling_?rate|sample_?rate|sampling_?frequency|rate(_hz)?|frequency"
"""Pattern of the names of sampling rates [Hz]."""
TIME_NAMES = r"(.*[_.])?(t|time|times|stamp|timestamp|timestamp_sample|seconds|sec|epoch)(_?(s|ms|us|ns|sec))?|t_[a-z]+|[a-z]+(time|timestamp)"
"""Pattern of the names of times."""
_AXES = {"x": "x", "y": "y", "z": "z", "0": "x", "1": "y", "2": "z"}
_AXIS = re.compile(r"(.+?)[_.]?(?:\[([0-2])\]|(?<![0-9])([xyz])|[_.]([0-2]))$")
_PREFIX = re.compile(r"^(imu|data|sensor|sensors|raw|mti|ahrs|body|opt|field)\d?[_./]+")


def plain(name: str) -> str:
    """A name in small letters, without the folder it is in and a prefix that says nothing."""
    last = re.split(r"[/]", name)[-1].strip().lower().replace(" ", "_").replace("-", "_")
    return _PREFIX.sub("", last)


def _known(name: str, axes: int) -> tuple[str, str] | None:
    """The sensor or channel of a name without its axis, and the unit that it says; None for other names."""
    rows = (row[1:] for row in CHANNELS if row[0] == axes)
    return next(((what or name, unit) for pattern, what, unit in rows if re.fullmatch(pattern, name)), None)


def triad(name: str) -> tuple[str, str] | None:
    """The sensor of an array of three columns, and the unit that its name says; None for other names."""
    return _known(plain(name), 3)


def axis_of(name: str) -> tuple[str, str, str] | None:
    """The sensor, its axis and the unit that the name says, of one axis' array; None for other names."""
    match = _AXIS.fullmatch(plain(name).replace("rate_of_turn", "w"))
    if match is None:
        return None
    found = triad(match.group(1).rstrip("_."))
    axis = next(g for g in match.groups()[1:] if g is not None)
    return None if found is None else (found[0], _AXES[axis], found[1])


def single(name: str) -> tuple[str, str] | None:
    """The channel of an array of one quantity, and its unit; None for other names."""
    return _known(plain(name), 1)


def gnss(name: str) -> str:
    """What of GNSS an array is; empty for other names."""
    known = plain(name)
    return next((what for pattern, what in GNSS if re.fullmatch(pattern, known)), "")


def is_time(name: str) -> bool:
    """Whether an array is called as times are."""
    return re.fullmatch(TIME_NAMES, plain(name)) is not None


def is_rate(name: str) -> bool:
    """Whether a number is called as sampling rates are."""
    return re.fullmatch(RATE_NAMES, plain(name)) is not None
