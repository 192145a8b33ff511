"""Reads ROS 1 bags, ROS 2 bags (.db3, or their folder) and MCAP by rosbags: the standard sensor messages, by the stamps in their headers.

Vehicle axes of ROS are forward, left, up and those of the world east, north, up (REP 103); they become forward, right,
down and north, east, down. Messages are decoded by the standard's own definitions: those in a file are not used, since
they would be compiled.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kfgen.core.errors import InputError
from kfgen.core.optional_library import optional_library
from kfgen.log.readers.tables.aiding import above_first_fix, gnss_stream, pressure_height
from kfgen.log.readers.tables.axes import NED_OF_ENU, ned_attitude
from kfgen.log.readers.tables.clock import Clock
from kfgen.log.readers.tables.library import reading
from kfgen.log.readers.tables.streams import ANY, LogChoice, LogRecording, LogStream
from kfgen.log.readers.tables.table import TableColumn

Array = NDArray[np.float64]

SUFFIXES = (".bag", ".db3", ".mcap")
FOLDER = "a folder of a ROS 2 bag (metadata.yaml with its .db3 or .mcap files)"
METADATA = "metadata.yaml"
MAGIC = (b"#ROSBAG V2.0", b"SQLite format 3\0", b"\x89MCAP0\r\n")
RESTORE = "Restore it with 'rosbag reindex', 'ros2 bag reindex' or 'mcap recover'"
STEEP = 0.5
"""Share of gravity along the third axis above which the axes are said to be forward, right, down already."""
_SIGNS = {"x": 1.0, "y": -1.0, "z": -1.0}
"""A half turn about the first axis: forward, left, up to forward, right, down."""
_TYPES = {
    f"{package}/msg/{name}": name
    for package, names in (
        ("sensor_msgs", "Imu MagneticField FluidPressure NavSatFix Temperature BatteryState"),
        ("nav_msgs", "Odometry"),
    )
    for name in names.split()
}
"""Message types that are read."""


@dataclass
class _Topic:
    """A topic with decoded messages: receipt [s], stamp [s] and numbers of each."""

    name: str
    kind: str
    received: list[float] = field(default_factory=list)
    stamps: list[float] = field(default_factory=list)
    rows: list[tuple[float, ...]] = field(default_factory=list)

    def t(self) -> Array:
        """The stamps of the headers, or the times of receipt where there are none."""
        stamps = np.asarray(self.stamps)
        return stamps if (stamps > 0.0).all() else np.asarray(self.received)

    def values(self) -> Array:
        """Numbers of the messages, shape (numbers, n)."""
        return np.asarray(self.rows, np.float64).T


def parts(path: Path) -> list[Path]:
    """The files of a ROS 2 bag that is a folder, split or not; none where it is another kind of folder."""
    files = [p for p in sorted(path.iterdir()) if p.is_file() and set(p.suffixes) & {".db3", ".mcap"}]
    return [path / METADATA, *files] if files and (path / METADATA).is_file() else []


def recording(path: Path, choice: LogChoice = ANY) -> LogRecording:
    """The streams of a bag, each with its own clock.

    Parameters
    ----------
    path : Path
    choice : LogChoice
        Topic, or which of several topics of inertial sensors by their names' order.

    Returns
    -------
    LogRecording

    Raises
    ------
    InputError
        It is no bag, or it has no sensor message.
    MissingExtra
        rosbags is not installed.
    """
    topics, clocks, words = _topics(path)
    chosen: dict[str, _Topic] = {}
    for kind in _TYPES.values():
        own = [t for t in topics if t.kind == kind and t.rows]
        if own:
            chosen[kind] = _preferred(own, choice, str(path))
            others = [t.name for t in own if t is not chosen[kind]]
            words += (
                [f"{kind} of {chosen[kind].name}; there are {', '.join(others)} too, see --topic"]
                if others
                else []
            )
    words += [
        f"{t.name}: messages without a stamp, times of receipt are used"
        for t in chosen.values()
        if not all(s > 0.0 for s in t.stamps)
    ]
    imu, said = _imu(chosen.pop("Imu", None))
    gnss: list[LogStream] = []
    streams: list[LogStream] = []
    for kind, topic in chosen.items():
        if kind == "NavSatFix":
            gnss, place = _gnss(topic)
            words.append(place)
        else:
            streams.append(LogStream(topic.name, topic.t(), _COLUMNS[kind](topic.values())))
    streams, zero = above_first_fix(streams, gnss)
    words += [*said, *([zero] if zero else [])]
    return LogRecording(str(path), (*imu, *gnss, *streams), clocks, tuple(words))


def _preferred(own: Sequence[_Topic], choice: LogChoice, source: str) -> _Topic:
    """The chosen topic, else the one with the most messages."""
    named = [t for t in own if t.name == choice.topic]
    if named:
        return named[0]
    if choice.instance is not None and own[0].kind == "Imu":
        if not 0 <= choice.instance < len(own):
            raise InputError(
                f"there is no inertial sensor of instance {choice.instance}",
                where=source,
                remedy=f"Count from 0: {', '.join(sorted(t.name for t in own))}",
            )
        return sorted(own, key=lambda t: t.name)[choice.instance]
    return max(own, key=lambda t: len(t.rows))


def _topics(path: Path) -> tuple[list[_Topic], dict[str, Clock], list[str]]:
    """Decoded topics, the clock of every topic, and what is to be said of the file."""
    first = path.suffix.lower() == ".bag"
    bags = optional_library(f"rosbags.rosbag{1 if first else 2}", "ros", "ROS bags are read by", str(path))
    types = optional_library("rosbags.typesys", "ros", "ROS bags are read by", str(path))
    store = types.get_typestore(types.Stores.ROS1_NOETIC if first else types.Stores.ROS2_HUMBLE)
    decode = store.deserialize_ros1 if first else store.deserialize_cdr
    words: list[str] = []
    with reading("bag", path, RESTORE), bags.Reader(path) as bag:
        counts = {c.topic: 0 for c in bag.connections}
        for c in bag.connections:
            counts[c.topic] += c.msgcount
        clocks = {name: Clock.counted(n) for name, n in sorted(counts.items())}
        wanted = [c for c in bag.connections if c.msgtype in _TYPES]
        topics = _decoded(bag.messages(wanted), decode, words) if wanted else []
    return topics, clocks | {t.name: Clock.of(t.t()) for t in topics}, words


def _decoded(messages: Iterator[Any], decode: Callable[[bytes, str], Any], words: list[str]) -> list[_Topic]:
    topics: dict[str, _Topic] = {}
    broken: dict[str, int] = {}
    while True:
        try:
            found = next(messages, None)
        except Exception as error:  # whatever a broken file leads to
            if not topics:
                raise
            words.append(f"the bag is damaged or cut off ({error}); what is before is read")
            break
        if found is None:
            break
        connection, received, raw = found
        kind = _TYPES[connection.msgtype]
        try:
            message = decode(raw, connection.msgtype)
            row = tuple(_NUMBERS[kind](message))
        except Exception:  # a message of another definition, or a damaged one
            broken[connection.topic] = broken.get(connection.topic, 0) + 1
            continue
        topic = topics.setdefault(connection.topic, _Topic(connection.topic, kind))
        topic.received.append(received * 1e-9)
        topic.stamps.append(message.header.stamp.sec + message.header.stamp.nanosec * 1e-9)
        topic.rows.append(row)
    words += [f"{name}: {n} messages cannot be decoded and were left out" for name, n in broken.items()]
    return list(topics.values())


def _xyz(v: Any) -> tuple[float, float, float]:
    return v.x, v.y, v.z


_NUMBERS: Mapping[str, Callable[[Any], Iterable[float]]] = {
    "Imu": lambda m: (*_xyz(m.angular_velocity), *_xyz(m.linear_acceleration)),
    "MagneticField": lambda m: _xyz(m.magnetic_field),
    "FluidPressure": lambda m: (m.fluid_pressure,),
    "NavSatFix": lambda m: (m.latitude, m.longitude, m.altitude, m.status.status),
    "Temperature": lambda m: (m.temperature,),
    "BatteryState": lambda m: (m.voltage, m.current),
    "Odometry": lambda m: (
        *_xyz(m.pose.pose.position),
        *_xyz(m.twist.twist.linear),
        m.pose.pose.orientation.w,
        *_xyz(m.pose.pose.orientation),
    ),
}
"""The numbers of a message."""


def _turned(sensor: str, values: Array, unit: str, factor: float = 1.0) -> dict[str, TableColumn]:
    """Three axes forward, left, up as forward, right, down."""
    return {
        f"{sensor}_{a}": TableColumn(s * factor * v, unit)
        for (a, s), v in zip(_SIGNS.items(), values, strict=True)
    }


def _imu(topic: _Topic | None) -> tuple[list[LogStream], list[str]]:
    if topic is None:
        return [], []
    values = topic.values()
    along = float(np.nanmean(values[5])) / max(float(np.nanmean(np.linalg.norm(values[3:6], axis=0))), 1e-9)
    columns = {**_turned("gyro", values[:3], "rad/s"), **_turned("accel", values[3:6], "m/s^2")}
    said = [f"{topic.name}: axes forward, left, up of ROS became forward, right, down"]
    if along < -STEEP:
        columns = {k: TableColumn(c.values * _SIGNS[k[-1]], c.unit) for k, c in columns.items()}
        said = [f"{topic.name}: gravity says that its third axis is down already; the axes are as logged"]
    return [LogStream(topic.name, topic.t(), columns)], said


def _gnss(topic: _Topic) -> tuple[list[LogStream], str]:
    latitude, longitude, height, status = topic.values()
    position = [np.deg2rad(latitude), np.deg2rad(longitude), height]
    stream, said = gnss_stream(topic.name, topic.t(), status >= 0.0, position, ())
    return ([stream] if stream else []), said


def _pressure(values: Array) -> dict[str, TableColumn]:
    pressure = np.where(values[0] > 0.0, values[0], np.nan)
    return {
        "baro_height": TableColumn(pressure_height(pressure), "m"),
        "pressure": TableColumn(pressure, "Pa"),
    }


def _odometry(values: Array) -> dict[str, TableColumn]:
    """A pose as a reference: position, velocity (logged in body axes) and attitude, body to navigation axes."""
    from scipy.spatial.transform import Rotation  # heavy: only for logs with odometry

    good = np.isfinite(values).all(axis=0) & (np.abs(values[6:]).max(axis=0) > 0.0)
    v, q = np.full((3, good.size), np.nan), np.full((4, good.size), np.nan)
    attitude = Rotation.from_quat(ned_attitude(values[6:])[:, good].T, scalar_first=True)
    v[:, good] = attitude.apply(values[3:6, good].T).T
    q[:, good] = (
        (attitude * Rotation.from_matrix(np.diag(list(_SIGNS.values())))).as_quat(scalar_first=True).T
    )
    p = NED_OF_ENU @ values[:3]
    columns = {f"ref_p_{a}": TableColumn(x, "m") for a, x in zip("NED", p, strict=True)}
    columns |= {f"ref_v_{a}": TableColumn(x, "m/s") for a, x in zip("NED", v, strict=True)}
    return columns | {f"ref_q_{a}": TableColumn(x, "") for a, x in zip("wxyz", q, strict=True)}


_COLUMNS: Mapping[str, Callable[[Array], dict[str, TableColumn]]] = {
    "MagneticField": lambda v: _turned("mag", v, "uT", 1e6),
    "FluidPressure": _pressure,
    "Temperature": lambda v: {"temperature": TableColumn(v[0], "degC")},
    "BatteryState": lambda v: {"voltage": TableColumn(v[0], "V"), "current": TableColumn(-v[1], "A")},
    "Odometry": _odometry,
}
"""Channels of the numbers of messages, by type."""
