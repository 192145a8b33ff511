"""Reads PX4 logs (ULog, .ulg) by pyulog: inertial sensors and the aiding sensors beside them, by their own stamps.

The inertial sensor is `vehicle_imu` (increments, divided by their own intervals), `sensor_combined`, or `sensor_gyro`
with `sensor_accel`: the first that is logged fast enough. Coordinates become metres about the first fix; the height
of the barometer is that above its own at this time.
"""

from __future__ import annotations

import contextlib
import io
import struct
from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kfgen.core.errors import InputError
from kfgen.core.numbers import how_many
from kfgen.core.optional_library import optional_library
from kfgen.log.readers.flight import px4_topics as topics
from kfgen.log.readers.flight.counter import rate_of_counter
from kfgen.log.readers.flight.px4_topics import TopicSource
from kfgen.log.readers.tables.aiding import above_first_fix, gnss_stream, pressure_height
from kfgen.log.readers.tables.clock import Clock
from kfgen.log.readers.tables.library import reading
from kfgen.log.readers.tables.streams import ANY, LogChoice, LogRecording, LogStream
from kfgen.log.readers.tables.table import TableColumn

Array = NDArray[np.float64]

SUFFIXES = (".ulg", ".ulog")
MAGIC = b"ULog\x01\x12\x35"
ENOUGH_HZ = 100.0
"""Rate at which a source is fast enough: a faster one is not preferred to it."""
LOWEST_COVERAGE = 0.9
"""Share of the time that the intervals of increments cover, below which it is said."""
INVALID_US = 2**31 - 1
"""What PX4 writes as time after a stamp where there is no sample."""
DOWN = 25
"""What PX4 writes as the orientation of a range finder that looks down (MAV_SENSOR_ROTATION_PITCH_270)."""
MICROTESLA_PER_GAUSS = 100.0
MOST_VISITS = 1000
"""Times that a place of a file is reached by a seek before the file is given up."""
LEAST_PASCAL = 2000.0
"""Pressures below are in hectopascals: logs before v1.14."""


def recording(path: Path, choice: LogChoice = ANY) -> LogRecording:
    """The streams of a PX4 log, each with its own clock.

    Parameters
    ----------
    path : Path
    choice : LogChoice
        Topic and instance, where there are several.

    Returns
    -------
    LogRecording

    Raises
    ------
    InputError
        It is no ULog, or it has no sensor that is known.
    MissingExtra
        pyulog is not installed.
    """
    ulog = _ulog(path)
    log = _Topics(ulog.data_list, choice, str(path))
    imu, words = log.imu()
    first, streams = log.aiding()
    clocks = {log.title(d): Clock.of(np.asarray(d.data["timestamp"], float) * 1e-6) for d in ulog.data_list}
    samples = "before" if imu and imu[0].name.split()[0] in topics.INTERVAL else "at"
    said = (*_of_file(path, ulog), *words, *first)
    return LogRecording(
        str(path), (*imu, *streams), dict(sorted(clocks.items())), said, samples if imu else ""
    )


def _ulog(path: Path) -> Any:
    pyulog = optional_library("pyulog", "px4", "PX4 logs are read by", str(path))
    damaged = reading("PX4 log", path, "Download the .ulg again from the vehicle")
    with damaged, contextlib.redirect_stdout(io.StringIO()):  # it prints what it skips
        return pyulog.ULog(_Steps(path.read_bytes()))


class _Steps(io.BytesIO):
    """A file in memory that ends a reader that comes back to the same place for ever, as pyulog does in damaged files."""

    def __init__(self, data: bytes) -> None:
        super().__init__(data)
        self.visits: Counter[int] = Counter()

    def seek(self, offset: int, whence: int = 0, /) -> int:
        """The new position; raises `OSError` where it was reached too often."""
        at = super().seek(offset, whence)
        self.visits[at] += 1
        if self.visits[at] > MOST_VISITS:
            raise OSError("its definitions are damaged")
        return at


def _of_file(path: Path, ulog: Any) -> Iterable[str]:
    if ulog.file_corruption:
        yield "parts of the file are damaged and were skipped"
    elif _is_cut(path):
        yield "the file ends within a message: it was cut off, what is before is read"
    if ulog.dropouts:
        total = sum(d.duration for d in ulog.dropouts)
        yield f"the logger lost data {how_many(len(ulog.dropouts), 'time')}, {total / 1e3:.3g} s in all (logged dropouts)"


def _is_cut(path: Path) -> bool:
    """Whether the last message of a ULog (2 bytes size, 1 byte type, then its content) ends after the file."""
    size, at = path.stat().st_size, 16
    with path.open("rb") as file:
        data = file.read()
    while at + 3 <= size:
        at += 3 + int(struct.unpack_from("<H", data, at)[0])
    return at != size


class _Topics:
    """The topics of a log, by name and instance."""

    def __init__(self, data: Sequence[Any], choice: LogChoice, source: str) -> None:
        self.data, self.choice, self.source = data, choice, source
        self.several = {d.name for d in data if d.multi_id > 0}

    def title(self, d: Any) -> str:
        """The topic's name, with its instance where there are several."""
        return f"{d.name} {d.multi_id}" if d.name in self.several else str(d.name)

    def imu(self) -> tuple[tuple[LogStream, ...], list[str]]:
        """The inertial sensor, and what is to be said of it."""
        found, k = self._preferred(topics.IMU), self.choice.instance
        sensors = [d for d in self.data if d.name in ("vehicle_imu", "sensor_gyro")]
        if k is not None and sensors and k not in {d.multi_id for d in sensors}:
            raise InputError(
                f"there is no inertial sensor of instance {k}",
                where=self.source,
                remedy=f"It has {', '.join(map(str, sorted({d.multi_id for d in sensors})))}",
            )
        if found is None:
            return (), []
        source, d = found
        stream = self._stream(source, d)
        words = list(_of_increments(stream, d)) + list(_of_clipping(stream, d))
        if source.topic != "sensor_gyro":
            return (stream,), words
        beside = next((a for a in self.data if a.name == "sensor_accel" and a.multi_id == d.multi_id), None)
        return (stream, *([self._stream(topics.ACCELEROMETER, beside)] if beside else [])), words

    def aiding(self) -> tuple[list[str], list[LogStream]]:
        """What is to be said of them, and the streams of aiding sensors and drivers."""
        words: list[str] = []
        streams = [s for s in (self._aiding(sources) for sources in topics.AIDING.values()) if s is not None]
        streams += [*self._motors(streams), *self._clipping()]
        gnss, said = self._gnss()
        if said:
            words.append(said)
        streams, said = above_first_fix(streams, gnss)
        if said:
            words.append(said)
        return words, [*gnss, *streams]

    def _aiding(self, sources: Sequence[TopicSource]) -> LogStream | None:
        found = self._preferred(sources)
        if found is None:
            return None
        source, d = found
        return _cleaned(self._stream(source, d), d)

    def _motors(self, others: Sequence[LogStream]) -> list[LogStream]:
        """Mean of what the motors are asked for, where no other stream is the throttle."""
        d = next((d for d in self.data if d.name == topics.MOTORS), None)
        if d is None or any("throttle" in s.columns for s in others):
            return []
        asked = np.stack([np.asarray(v, float) for n, v in d.data.items() if n.startswith("control[")])
        running = asked[np.isfinite(asked).any(axis=1)]
        if not running.size:
            return []
        with np.errstate(invalid="ignore"):
            mean = np.nansum(running, axis=0) / np.isfinite(running).sum(axis=0)
        return [LogStream(self.title(d), _stamps(d), {"throttle": TableColumn(mean, "1")})]

    def _clipping(self) -> list[LogStream]:
        """Clipped samples of the accelerometer a second, of all axes, where some are."""
        own = [d for d in self.data if d.name == topics.STATUS and f"{topics.CLIPPED}[0]" in d.data]
        own = [d for d in own if d.multi_id == (self.choice.instance or 0)]
        if not own:
            return []
        axes = [np.asarray(own[0].data[f"{topics.CLIPPED}[{k}]"], float) for k in range(3)]
        clips = rate_of_counter(
            f"{self.title(own[0])} clips", _stamps(own[0]), np.sum(axes, axis=0), "clipping"
        )
        return [clips] if clips else []

    def _gnss(self) -> tuple[list[LogStream], str]:
        found = self._preferred(
            [TopicSource(name, {"gnss_v_N": ("vel_n_m_s", "m/s")}) for name in topics.GNSS]
        )
        if found is None:
            return [], ""
        d = found[1]
        new, f = "latitude_deg" in d.data, d.data
        place = ("latitude_deg", "longitude_deg", "altitude_msl_m") if new else ("lat", "lon", "alt")
        if any(name not in f for name in place):
            return [], ""
        units = (
            (np.pi / 180.0, np.pi / 180.0, 1.0) if new else (1e-7 * np.pi / 180.0, 1e-7 * np.pi / 180.0, 1e-3)
        )
        position = [np.asarray(f[n], float) * u for n, u in zip(place, units, strict=True)]
        velocity = [np.asarray(f[f"vel_{axis}_m_s"], float) for axis in "ned"]
        fixed = np.asarray(f["fix_type"]) >= 3
        stream, said = gnss_stream(self.title(d), _stamps(d), fixed, position, velocity)
        return ([stream] if stream else []), said

    def _preferred(self, sources: Sequence[TopicSource]) -> tuple[TopicSource, Any] | None:
        """The first source that is fast enough, or half as fast as the fastest; a chosen topic before all."""
        candidates = []
        for source in sources:
            own = [d for d in self.data if d.name == source.topic and d.data["timestamp"].size]
            own = [d for d in own if any(f in d.data for f, _ in source.fields.values())]
            same = [d for d in own if d.multi_id == self.choice.instance]
            if own:
                best = (same or sorted(own, key=lambda d: int(d.multi_id)))[0]
                candidates.append((source, best, bool(same)))
        chosen = [c for c in candidates if c[0].topic == self.choice.topic]
        if self.choice.instance is not None:
            candidates = [c for c in candidates if c[2] and c[1].name in self.several] or candidates
        candidates = chosen or candidates
        rates = [np.nan_to_num(Clock.of(_stamps(d)).rate) for _, d, _ in candidates]
        if not rates:
            return None
        wanted = min(0.5 * max(rates), ENOUGH_HZ)
        source, d, _ = next(c for c, rate in zip(candidates, rates, strict=True) if rate >= wanted)
        return source, d

    def _stream(self, source: TopicSource, d: Any) -> LogStream:
        columns: dict[str, TableColumn] = {}
        for channel, (name, unit) in source.fields.items():
            if name not in d.data:
                continue
            values = np.asarray(d.data[name], float)
            for sensor, interval in source.increments.items():
                if channel.startswith(sensor):
                    dt = np.asarray(d.data[interval], float) * 1e-6
                    values = np.divide(values, dt, out=np.full(values.shape, np.nan), where=dt > 0.0)
            columns[channel] = TableColumn(values, unit)
        t = _stamps(d)
        if source.late and source.late in d.data:
            return _late(LogStream(self.title(d), t, columns), np.asarray(d.data[source.late], np.int64))
        return LogStream(self.title(d), t, columns)


def _stamps(d: Any) -> Array:
    """When a sensor took the samples of a topic [s]; when they were published where that is not logged."""
    t = np.asarray(d.data["timestamp"], float)
    sampled = np.asarray(d.data.get("timestamp_sample", np.zeros(t.size)), float)
    return np.where(sampled > 0.0, sampled, t) * 1e-6


def _late(stream: LogStream, late_us: NDArray[np.int64]) -> LogStream:
    """Samples of another sensor that stand in a topic's rows, each once and at its own time."""
    valid = late_us != INVALID_US
    t, first = np.unique((stream.t[valid] * 1e6).round() + late_us[valid], return_index=True)
    columns = {k: TableColumn(c.values[valid][first], c.unit) for k, c in stream.columns.items()}
    return LogStream(stream.name, t * 1e-6, columns)


def _cleaned(stream: LogStream, d: Any) -> LogStream:
    """Values that PX4 writes where it knows none, and older units, as kfgen has them."""
    columns = {k: np.asarray(c.values, float) for k, c in stream.columns.items()}
    units = {k: c.unit for k, c in stream.columns.items()}
    for name in [k for k, unit in units.items() if unit == "gauss"]:
        columns[name], units[name] = columns[name] * MICROTESLA_PER_GAUSS, "uT"
    if "current" in columns:
        columns["current"] = np.where(columns["current"] < 0.0, np.nan, columns["current"])
    if "voltage" in columns:
        columns["voltage"] = np.where(columns["voltage"] <= 0.0, np.nan, columns["voltage"])
    if "range" in columns:
        r = columns["range"]
        good = (r >= np.asarray(d.data["min_distance"])) & (r <= np.asarray(d.data["max_distance"]))
        columns["range"] = np.where(good & (np.asarray(d.data.get("orientation", DOWN)) == DOWN), r, np.nan)
    if "throttle" in columns and d.name == "vehicle_thrust_setpoint":
        thrust = [np.nan_to_num(np.asarray(d.data[f"xyz[{k}]"], float)) for k in range(3)]
        columns["throttle"] = np.linalg.norm(thrust, axis=0)
    if "pressure" in columns and np.nanmedian(columns["pressure"]) < LEAST_PASCAL:
        columns["pressure"] = columns["pressure"] * 100.0
    if "pressure" in columns and "baro_height" not in columns:
        columns["baro_height"], units["baro_height"] = pressure_height(columns["pressure"]), "m"
    return LogStream(stream.name, stream.t, {k: TableColumn(v, units[k]) for k, v in columns.items()})


def _of_increments(stream: LogStream, d: Any) -> Iterable[str]:
    name = topics.INTERVAL.get(d.name, "")
    period = Clock.of(stream.t).period
    if name not in d.data or not np.isfinite(period):
        return
    interval = float(np.median(np.asarray(d.data[name], float)))
    interval *= 1e-6 if interval > 1.0 else 1.0
    if interval < LOWEST_COVERAGE * period:
        yield (
            f"{stream.name}: each sample is the mean over {1e3 * interval:.3g} ms, one of them is logged every "
            f"{1e3 * period:.3g} ms; the motion between is not in the log (set SDLOG_PROFILE to high rate)"
        )


def _of_clipping(stream: LogStream, d: Any) -> Iterable[str]:
    for name in topics.CLIPPING:
        clipped = int(np.count_nonzero(np.asarray(d.data[name]))) if name in d.data else 0
        if clipped:
            yield f"{stream.name}: {clipped} of {stream.t.size} samples are flagged as clipped ({name})"
