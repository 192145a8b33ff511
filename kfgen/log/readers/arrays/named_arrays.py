"""Named arrays of other programs (HDF5, MAT, Parquet, JSON lines, data frames) as a log: names, clocks and units found.

Arrays of one length share a clock: the one among them that is called as times are, or the sampling rate. Units that
are stated nowhere are assumed where gravity and the field of the Earth confirm them, and said; else they are asked for.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from kfgen.core.channel_names import some_of
from kfgen.core.errors import InputError
from kfgen.core.units import is_unit, parse_unit
from kfgen.log.readers.arrays import array_names
from kfgen.log.readers.arrays.turning_gravity import gyro_unit
from kfgen.log.readers.tables.aiding import above_first_fix, gnss_stream
from kfgen.log.readers.tables.axes import ned_attitude
from kfgen.log.readers.tables.seconds import seconds_per, stamp_unit
from kfgen.log.readers.tables.streams import LogRecording, LogStream
from kfgen.log.readers.tables.table import LogTable, TableColumn

Array = NDArray[np.float64]

MOST_VALUES = 500_000_000
"""Numbers in a file beyond which it is refused: 4 GB."""
_BRACKET = re.compile(r"(.*?)\s*[\[(]([^\])]*[^\])\d][^\])]*)[\])]\s*$")
_ATTITUDE = re.compile(r"(?:.*/)?(?:opt|ref)_(?:quat|q)_?([wxyz])")
"""Names of an attitude that another instrument measured."""
_GUESSES = {
    "accel": (("m/s^2", 5.0, 20.0), ("g", 0.5, 2.0)),
    "mag": (("uT", 15.0, 90.0), ("gauss", 0.15, 0.9), ("mG", 150.0, 900.0)),
    "pressure": (("hPa", 700.0, 1100.0), ("Pa", 7e4, 1.1e5), ("kPa", 70.0, 110.0)),
}
"""Units by the median length of a triad, or of a single quantity's size, between two limits: the last of air."""
_MILLIGAUSS = "mG"
MAX_RATE_RAD_S = 100.0
"""Beyond what gyros of any kind measure: a larger reading is in degrees [rad/s]."""


@dataclass(frozen=True)
class Named:
    """An array with the unit that its file states, if any.

    Parameters
    ----------
    values : ndarray, shape (n,) or (n, k)
    unit : str, optional
    """

    values: Array
    unit: str | None = None


def check_size(values: int, path: Path) -> None:
    """Refuse a file of so many numbers that memory does not hold them.

    Parameters
    ----------
    values : int
        Numbers in the file.
    path : Path
        For the message.

    Raises
    ------
    InputError
        There are more than `MOST_VALUES`.
    """
    if values > MOST_VALUES:
        raise InputError(
            "it has too many numbers for the memory", where=str(path), remedy="Cut it into parts"
        )


def table_of(source: str, arrays: Mapping[str, Named], rate: float | None = None, text: str = "") -> LogTable:
    """Named arrays as a table on one time axis.

    Parameters
    ----------
    source : str
        The file's name, for messages.
    arrays : mapping of str to Named
        By the names of the file; ``gyro_x [deg/s]`` states a unit.
    rate : float, optional
        Sampling rate [Hz] that the file states.
    text : str
        What the file says of itself, in which units may stand.

    Returns
    -------
    LogTable

    Raises
    ------
    InputError
        There is no array of samples in it.
    """
    named, scalars = _columns(arrays)
    rate = rate or next((v for n, v in scalars.items() if array_names.is_rate(n) and 0.0 < v < np.inf), None)
    if not named:
        raise InputError(
            "there is no array of samples in it", where=source, remedy="Give arrays like gyr and acc, and fs"
        )
    groups: dict[int, dict[str, Named]] = {}
    for name, array in named.items():
        groups.setdefault(array.values.size, {})[name] = array
    words: list[str] = []
    streams: list[LogStream] = []
    gnss: list[LogStream] = []
    of_longer: set[str] = set()
    for n, group in sorted(groups.items(), reverse=True):
        t, said = _time(group, rate, n)
        if t is None:
            continue
        own: list[str] = []
        every = _channels(_of_first_sensor(group, own), t, text, own)
        channels = {name: c for name, c in every.items() if name not in of_longer}
        of_longer |= set(every)
        words += [w for w in own if channels or not every] + _shorter(n, set(every) - set(channels))
        fix, place = _gnss(group, t)
        gnss += fix
        new = [w for w in (said, place) if w and (channels or fix)]
        words += [w for w in new if w not in words]
        streams += [LogStream(f"arrays of {n} samples", t, channels)] if channels else []
    streams, zero = above_first_fix(streams, gnss)
    words += [zero] if zero else []
    return _table(source, groups, [*streams, *gnss], rate, tuple(words))


def _shorter(n: int, left: Collection[str]) -> list[str]:
    """What is said of arrays that are left out for longer ones of the same channels: another recording in the file."""
    if not left:
        return []
    return [
        f"{some_of(sorted(left))} of arrays of {n:,} samples are left out: longer arrays have them, and another recording "
        "needs a file of its own"
    ]


def _table(
    source: str,
    groups: Mapping[int, Mapping[str, Named]],
    streams: list[LogStream],
    rate: float | None,
    words: tuple[str, ...],
) -> LogTable:
    longest = groups[max(groups)]
    raw = {name: TableColumn(a.values, a.unit) for name, a in longest.items()}
    if not streams:
        return LogTable(source, raw, rate, words)
    order = sorted(
        streams, key=lambda s: (not any(c.startswith(("gyro_", "accel_")) for c in s.columns), -s.t.size)
    )
    if len(order) == 1 and not any(array_names.is_time(n) for n in longest):
        return LogTable(source, order[0].columns, rate, words, others=raw)
    table = LogRecording(source, order, {}, words).table()
    same = order[0].t.size == max(groups) == table.columns["t"].values.size
    return replace(table, others=raw if same else {})


def _columns(arrays: Mapping[str, Named]) -> tuple[dict[str, Named], dict[str, float]]:
    """Arrays of one dimension, triads split into axes; and the single numbers."""
    columns: dict[str, Named] = {}
    scalars: dict[str, float] = {}
    for whole, array in arrays.items():
        match = _BRACKET.match(whole) if array.unit is None else None
        name, unit = (match.group(1), match.group(2)) if match else (whole, array.unit)
        values = array.values
        if values.ndim == 2 and 1 in values.shape:
            values = values.reshape(-1)
        if values.size == 1:
            scalars[name] = float(values.reshape(-1)[0])
        elif values.ndim == 1 and values.size:
            columns[name] = Named(values, unit)
        elif values.ndim == 2 and values.shape[0] > values.shape[1]:
            axes = {3: "xyz", 4: "wxyz"}.get(values.shape[1], "0123456789")
            columns |= {
                f"{name}_{a}": Named(values[:, k], unit) for k, a in enumerate(axes[: values.shape[1]])
            }
    return columns, scalars


def _stated_time(unit: str | None) -> str:
    """The unit of stamps that is stated, if it is one of time; empty otherwise: their values then say what they are."""
    return unit if unit and seconds_per(unit) is not None else ""


def _time(group: Mapping[str, Named], rate: float | None, n: int) -> tuple[Array | None, str]:
    """Stamps [s] of a group: of the array that is called as times are and increases, or by the rate."""
    times = [
        k
        for k, a in group.items()
        if array_names.is_time(k) and np.all(np.diff(a.values[np.isfinite(a.values)]) >= 0.0)
    ]
    times = [k for k in times if np.ptp(group[k].values[np.isfinite(group[k].values)]) > 0.0]
    if times:
        exact = [k for k in times if array_names.plain(k).endswith("header.stamp")]
        exact = exact or [k for k in times if array_names.plain(k) in ("t", "time", "timestamp")]
        by_name = {k: _stated_time(group[k].unit) or stamp_unit(k, group[k].values) for k in exact or times}
        name = min(by_name, key=lambda k: by_name[k] != "s")
        unit = by_name[name]
        return group[name].values * parse_unit(unit).factor, f"times are those of '{name}' [{unit}]"
    return (np.arange(n) / rate, "") if rate else (None, "")


def _of_first_sensor(group: Mapping[str, Named], words: list[str]) -> dict[str, Named]:
    """The arrays of a group; where several folders have the same channels, as many sensors in one file, of the first one."""
    folder_of: dict[object, str] = {}
    others: dict[str, tuple[str, str]] = {}
    kept = {}
    for name, array in group.items():
        folder, axis, single = name.rpartition("/")[0], array_names.axis_of(name), array_names.single(name)
        channel = axis[:2] if axis else single[0] if single else name
        if folder_of.setdefault(channel, folder) == folder:
            kept[name] = array
        else:
            others.setdefault(folder, (folder_of[channel], name))
    if others:
        first, name = next(iter(others.values()))
        words.append(
            f"{first} is read, and not {some_of(others)}, which have channels of the same names: map another sensor's "
            f"with --columns, as in '{name}'"
        )
    return kept


def _channels(group: Mapping[str, Named], t: Array, text: str, words: list[str]) -> dict[str, TableColumn]:
    """The arrays of a group that have the usual name of a channel."""
    units: dict[str, dict[str, tuple[Array, str]]] = {}
    singles: dict[str, TableColumn] = {}
    attitude: dict[str, Array] = {}
    unread: list[str] = []
    for name, array in group.items():
        axis, single = array_names.axis_of(name), array_names.single(name)
        quaternion = _ATTITUDE.fullmatch(name.lower())
        if axis is not None:
            stated = array.unit or axis[2] or _in_text(name, text)
            units.setdefault(axis[0], {})[axis[1]] = (array.values, stated)
        elif single is not None:
            unit = array.unit or single[1] or _guessed_of(single[0], array.values, words)
            if unit or single[0] not in _GUESSES:
                singles[single[0]] = TableColumn(array.values, unit)
            else:
                unread.append(name)
        elif quaternion:
            attitude[quaternion.group(1)] = array.values
        elif array.unit is not None and is_unit(array.unit) and not array_names.is_time(name):
            singles[name] = TableColumn(array.values, array.unit)
        elif not array_names.is_time(name):
            unread.append(name)
    if unread and (units or singles or attitude):
        words.append(f"{some_of(unread)}: the names say no channel; map what is wanted with --columns")
    if set(attitude) == set("wxyz"):
        q = np.stack([attitude[axis] for axis in "wxyz"])
        q = ned_attitude(q) if "ENU" in text else q
        singles |= {f"ref_q_{axis}": TableColumn(q[k], "") for k, axis in enumerate("wxyz")}
    channels: dict[str, TableColumn] = {}
    for sensor in units:
        channels |= _triad(sensor, units, t, words)
    return channels | singles


def _triad(
    sensor: str, units: Mapping[str, Mapping[str, tuple[Array, str]]], t: Array, words: list[str]
) -> dict[str, TableColumn]:
    axes = units[sensor]
    guess = _guessed(sensor, units, t)
    columns = {}
    for axis, (values, stated) in axes.items():
        unit, factor = stated or guess or None, 1.0
        if unit == _MILLIGAUSS:
            unit, factor = "uT", 0.1
        columns[f"{sensor}_{axis}"] = TableColumn(values * factor, unit)
    if any(not stated for _, stated in axes.values()):
        if guess:
            words.append(f"{sensor}: no unit is stated, {guess} is assumed; say another with --columns")
        elif sensor == "mag":
            words.append(
                "mag: no unit is stated and its size is not that of the Earth's field; map it with --columns"
            )
            return {}
    return columns


def _guessed(sensor: str, units: Mapping[str, Mapping[str, tuple[Array, str]]], t: Array) -> str:
    """The unit of a triad by its size; that of a gyro by how gravity turns, or where the accelerometer's is SI, unless no
    gyro reads as much in it; else empty.
    """
    axes, beside = units[sensor], units.get("accel", {})
    if sensor == "gyro":
        turned = _by_gravity(axes, beside, t) if len(axes) == len(beside) == 3 else ""
        si = beside and (
            _guessed("accel", units, t) == "m/s^2" or all(u == "m/s^2" for _, u in beside.values())
        )
        fast = any(
            np.max(np.abs(v), initial=0.0, where=np.isfinite(v)) > MAX_RATE_RAD_S for v, _ in axes.values()
        )
        return turned or (("deg/s" if fast else "rad/s") if si else "")
    if sensor not in _GUESSES or len(axes) != 3:
        return ""
    size = float(np.nanmedian(np.sqrt(sum(v**2 for v, _ in axes.values()))))
    return _unit_of_size(sensor, size)


def _unit_of_size(kind: str, size: float) -> str:
    """The unit in which a quantity is so large; empty where none is known."""
    return next((unit for unit, low, high in _GUESSES.get(kind, ()) if low < size < high), "")


def _guessed_of(channel: str, values: Array, words: list[str]) -> str:
    """The unit of a single quantity by its size, which is said; empty where none is of that size."""
    unit = _unit_of_size(channel, float(np.nanmedian(np.abs(values))))
    if unit:
        words.append(f"{channel}: no unit is stated, {unit} is assumed; say another with --columns")
    return unit


def _by_gravity(
    gyro: Mapping[str, tuple[Array, str]], accel: Mapping[str, tuple[Array, str]], t: Array
) -> str:
    w, f = (np.column_stack([axes[a][0] for a in "xyz"]) for axes in (gyro, accel))
    return gyro_unit(t, f, w)


def _in_text(name: str, text: str) -> str:
    """The unit that a text says of a name: `imu_gyr` in rad/s."""
    stem = re.escape(re.sub(r"_[xyz]$", "", name))
    match = re.search(rf"`?{stem}`?\s+in\s+([^\s,;)]+)", text)
    return match.group(1) if match else ""


def _gnss(group: Mapping[str, Named], t: Array) -> tuple[list[LogStream], str]:
    """Coordinates and velocities of a group as metres about the first."""
    found = {what: a.values for name, a in group.items() if (what := array_names.gnss(name))}
    if not {"latitude", "longitude", "height"} <= set(found):
        return [], ""
    latitude, longitude = found["latitude"], found["longitude"]
    if np.nanmax(np.abs(latitude)) > 1000.0:  # whole numbers of 1e-7 degrees, as receivers write them
        latitude, longitude = latitude * 1e-7, longitude * 1e-7
    fixed = found["fix"] >= 3.0 if "fix" in found else (latitude != 0.0) | (longitude != 0.0)
    position = [np.deg2rad(latitude), np.deg2rad(longitude), found["height"]]
    stream, said = gnss_stream("coordinates", t, fixed, position, _velocity(found, position, t))
    return ([stream] if stream else []), said


def _velocity(found: Mapping[str, Array], position: list[Array], t: Array) -> list[Array]:
    """Velocity north, east, down, of speed and course where it is not logged; degrees where the positions say so."""
    if {"v_N", "v_E", "v_D"} <= set(found):
        return [found[f"v_{axis}"] for axis in "NED"]
    if not {"course", "speed"} <= set(found):
        return []
    dt, moved = np.diff(t), np.diff(position[0])
    ways = [found["speed"] * np.cos(found["course"] * unit) for unit in (1.0, np.pi / 180.0)]
    wrong = [float(np.nansum((moved * 6.37e6 - 0.5 * (v[1:] + v[:-1]) * dt) ** 2)) for v in ways]
    course = found["course"] * (1.0, np.pi / 180.0)[int(np.argmin(wrong))]
    down = [found["v_D"]] if "v_D" in found else []
    return [found["speed"] * np.cos(course), found["speed"] * np.sin(course), *down]
