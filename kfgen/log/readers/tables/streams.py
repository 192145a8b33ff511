"""Logs whose sensors have clocks of their own: `LogStream`, samples of one clock; `LogRecording`, all streams of a file.

A `Log` has one time axis. That of a recording is the one of its inertial sensor (of its fastest stream where it has
none); a sample of another stream stands in the row nearest its own time stamp, and the other rows have none.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from kfgen.core.errors import InputError
from kfgen.core.numbers import how_many, moment
from kfgen.log.readers.tables.clock import Clock
from kfgen.log.readers.tables.table import LogTable, TableColumn

Array = NDArray[np.float64]

LOWEST_RATE_HZ = 40.0
"""Rate of an inertial sensor below which a filter misses motion."""


@dataclass(frozen=True)
class LogChoice:
    """Which of several sources of the same channels is wanted.

    Parameters
    ----------
    topic : str
        Topic or message from which channels are read wherever it has them; empty leaves it to the reader.
    instance : int, optional
        Which of several sensors of a kind, counted as the log counts them; None leaves it to the reader.
    """

    topic: str = ""
    instance: int | None = None


ANY = LogChoice()
"""What the reader prefers."""


@dataclass(frozen=True)
class LogStream:
    """Samples of one clock.

    Parameters
    ----------
    name : str
        Topic or message, and its instance where there are several.
    t : ndarray, shape (n,)
        Time stamps of the samples [s], as they follow each other in the file.
    columns : mapping of str to TableColumn
        By the names of channels.
    """

    name: str
    t: Array
    columns: Mapping[str, TableColumn]

    def ordered(self) -> tuple[LogStream, str]:
        """The stream without stamps that repeat or go back, and what was left out in words."""
        latest = np.maximum.accumulate(np.concatenate([[-np.inf], self.t[:-1]]))
        good = np.isfinite(self.t) & (self.t > latest)
        if good.all():
            return self, ""
        columns = {k: TableColumn(c.values[good], c.unit) for k, c in self.columns.items()}
        words = f"{self.name}: {good.size - good.sum()} of {good.size} samples left out, their stamps repeat or go back"
        return LogStream(self.name, self.t[good], columns), words

    def clock(self) -> Clock:
        """The facts of its stamps."""
        return Clock.of(self.t)

    def known(self) -> LogStream:
        """The stream without the samples at which no channel has a value."""
        some = np.zeros(self.t.size, bool)
        for column in self.columns.values():
            some |= np.isfinite(column.values)
        if some.all():
            return self
        return LogStream(
            self.name, self.t[some], {k: TableColumn(c.values[some], c.unit) for k, c in self.columns.items()}
        )


@dataclass(frozen=True)
class LogRecording:
    """What a reader found in a file whose streams have clocks of their own.

    Parameters
    ----------
    source : str
        The file's name, for messages.
    streams : sequence of LogStream
        Those with channels; the first, where it has an inertial sensor, gives the time axis.
    topics : mapping of str to Clock
        The clock of everything in the file, with channels or not.
    warnings : tuple of str
    samples : str
        As in `Log`.
    """

    source: str
    streams: Sequence[LogStream]
    topics: Mapping[str, Clock] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()
    samples: str = ""

    def table(self) -> LogTable:
        """The streams on one time axis.

        Raises
        ------
        InputError
            No stream has a sample.
        """
        words = list(self.warnings)
        streams = []
        for stream in self.streams:
            kept, said = stream.known().ordered()
            words += [said] if said else []
            streams += [kept] if kept.t.size else []
        if not streams:
            raise InputError(
                "none of its messages is a sensor that is known",
                where=self.source,
                remedy=f"It has {_few(list(self.topics))}; see 'kfgen list LOG'",
            )
        if not _inertial(streams[0]):
            streams.sort(key=lambda s: -s.t.size)
        base = streams[0]
        words += [f"channels by their own clocks: {'; '.join(_sentence(s) for s in streams)}"]
        words += _of_base(base)
        placed = [_Placed.of(base.t, stream) for stream in streams[1:]]
        columns = {"t": TableColumn(base.t, "s"), **base.columns}
        for one in placed:
            columns.update({k: v for k, v in one.columns.items() if k not in columns})
        words += _of_placed(placed)
        warnings = tuple(words)
        return LogTable(
            self.source,
            columns,
            None,
            warnings,
            samples=self.samples,
            topics=self.topics,
            unplaced=_unplaced(base, placed),
        )


def _inertial(stream: LogStream) -> bool:
    return any(name.startswith(("gyro_", "accel_")) for name in stream.columns)


def _few(names: Sequence[str], at_most: int = 12) -> str:
    more = len(names) - at_most
    return ", ".join(names[:at_most]) + (f" and {more} more" if more > 0 else "") or "no message"


def _sentence(stream: LogStream) -> str:
    sensors = dict.fromkeys(_sensor(name) for name in stream.columns)
    return f"{', '.join(sensors)} of {stream.name} at {Clock.of(stream.t).rate:.3g} Hz"


def _sensor(channel: str) -> str:
    """A channel without its axis."""
    sensor, _, axis = channel.rpartition("_")
    return sensor if axis in ("x", "y", "z", "w", "N", "E", "D") and sensor else channel


def _of_base(base: LogStream) -> list[str]:
    clock = Clock.of(base.t)
    words = []
    if clock.gaps:
        words.append(
            f"{base.name}: {how_many(clock.gaps, 'gap')} in {clock.end - clock.start:.4g} s, "
            f"the longest step {clock.longest:.3g} s at t = {moment(clock.longest_at)} s"
        )
    if clock.rate < LOWEST_RATE_HZ and _inertial(base):
        words.append(
            f"{base.name}: {clock.rate:.3g} Hz is too slow for a moving filter (below {LOWEST_RATE_HZ:g} Hz); "
            "log the inertial sensor faster"
        )
    return words


@dataclass(frozen=True)
class _Placed:
    """The channels of a stream in the rows of a time axis.

    `moved` are the times by which stamps were moved [s], of `lost` samples of `n` there is no row; `span` is that of its
    stamps [s].
    """

    name: str
    columns: Mapping[str, TableColumn]
    moved: Array
    n: int
    lost: int
    span: tuple[float, float]

    @staticmethod
    def of(t: Array, stream: LogStream) -> _Placed:
        """Each sample in the row nearest its stamp, within a period; of two in a row the nearer one."""
        row = np.zeros(stream.t.size, int)
        if t.size > 1:
            row = np.clip(np.searchsorted(t, stream.t), 1, t.size - 1)
            row -= stream.t - t[row - 1] < t[row] - stream.t
        moved = t[row] - stream.t
        near = np.abs(moved) <= Clock.of(t).period if t.size > 1 else np.ones(moved.size, bool)
        order = np.flatnonzero(near)[
            np.argsort(-np.abs(moved[near]), kind="stable")
        ]  # the nearest is written last
        columns = {}
        for name, column in stream.columns.items():
            values = np.full(t.size, np.nan)
            values[row[order]] = np.asarray(column.values, float)[order]
            columns[name] = TableColumn(values, column.unit)
        lost = stream.t.size - np.unique(row[near]).size
        span = float(stream.t[0]), float(stream.t[-1])
        return _Placed(stream.name, columns, moved[near], stream.t.size, lost, span)


def _unplaced(base: LogStream, placed: Sequence[_Placed]) -> dict[str, str]:
    """By channel, how the times of a stream differ from those of the time axis, where none of its samples has a row."""
    axis = f"those of {base.name} from {moment(base.t[0])} to {moment(base.t[-1])} s"
    return {
        channel: f"the stamps of {p.name} are from {moment(p.span[0])} to {moment(p.span[1])} s, {axis}"
        for p in placed
        if not p.moved.size
        for channel in p.columns
        if channel not in base.columns
    }


def _of_placed(placed: Sequence[_Placed]) -> list[str]:
    """How far stamps were moved, and which samples are without a row."""
    moved = [(float(np.abs(p.moved).max()), p.name) for p in placed if p.moved.size]
    if not moved:
        return []
    most, where = max(moved)
    words = [
        f"samples of the other clocks are in the nearest row, moved by at most {1e3 * most:.3g} ms ({where})"
    ]
    lost = [
        f"{p.lost} of {p.n} of {', '.join(dict.fromkeys(map(_sensor, p.columns)))}" for p in placed if p.lost
    ]
    if lost:
        words.append(f"samples left out, without a row of their own within a period: {'; '.join(lost)}")
    return words
