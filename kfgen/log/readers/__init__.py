"""Readers of logs: one module a format, in folders by what writes it, found by its suffixes.

A reader turns a file into a `LogTable`; `kfgen.log.readers.tables.table` turns the table into a
`Log`. To add a format, add one module to one of the folders, with ``SUFFIXES`` and ``read(path)``; with ``MAGIC``, the
bytes that its files begin with, they are known by any name; with ``recording(path, choice)`` instead of ``read`` where
sensors have their own clocks; with ``inside(path, use)`` where a file holds another. A log that is a folder is known by
``parts(path)``, the files of it that are read: none of them where it is another kind of folder.
"""

from __future__ import annotations

import os
import warnings
from pathlib import Path

import numpy as np

from kfgen.core.errors import InputError
from kfgen.core.numbers import is_sampling_rate
from kfgen.log.log import Log, StoredLog
from kfgen.log.readers.arrays.frames import frame_table
from kfgen.log.readers.known import reader_of, readers, sha256_of
from kfgen.log.readers.tables.streams import ANY, LogChoice, LogRecording
from kfgen.log.readers.tables.table import ColumnMap, LogTable, assemble, stored

__all__ = [
    "ColumnMap",
    "LogOrPath",
    "log_of",
    "map_of",
    "read_log",
    "read_long",
    "read_table",
    "reader_of",
    "readers",
    "recording_of",
    "write_log",
]

LogOrPath = Log | str | Path
"""A log, or the path of its file."""
Columns = ColumnMap | str
"""Which column is which channel, or the text that says so: ``gyro_x=gx [deg/s/131], accel_x=#1 [g/16384]``."""

MAX_NUMBERS_IN_MEMORY = 20_000_000
"""Samples of all channels of a log beyond which what was read goes into a file again, from where it is mapped."""
MAX_SAMPLES_IN_MEMORY = 20_000_000
"""Samples of a channel beyond which a mapped file is not read into memory."""


def read_log(
    path: str | Path | object,
    *,
    rate: float | None = None,
    columns: Columns | None = None,
    topic: str = "",
    instance: int | None = None,
) -> Log:
    """Read a log of any known format, or take a table in memory as one.

    Parameters
    ----------
    path : path-like, or a table
        The file; or a mapping of arrays by name, a data frame of pandas or polars, a table of pyarrow, or a data set
        of xarray, with the same names and units as columns of files.
    rate : float, optional
        Sampling rate [Hz]; replaces the file's own time.
    columns : ColumnMap or str, optional
        Which column is which channel, and its unit: ``gyro_x=gx [deg/s/131], accel_x=#1 [g/16384]``.
    topic : str
        Topic or message of a flight log from which channels are read wherever it has them: ``sensor_gyro``.
    instance : int, optional
        Which of several inertial sensors of a flight log, as it counts them.

    Returns
    -------
    Log

    Raises
    ------
    InputError
        The file is missing, empty, of an unknown format, broken or too long for memory; the message names the place.
    MissingExtra
        The library that reads the format is not installed.
    """
    if not isinstance(path, str | os.PathLike):
        return assemble(frame_table(path), map_of(columns), rate, "")
    table, sha256 = read_table(Path(path), rate, LogChoice(topic, instance))
    if _is_too_long(table):
        raise InputError(
            f"a channel has more than the {MAX_SAMPLES_IN_MEMORY:,} samples that are held in memory",
            where=str(path),
            remedy="Give a part of the log; identify, and gap of sensors at rest, read any length",
        )
    return assemble(table, map_of(columns), rate, sha256)


def _is_too_long(table: LogTable) -> bool:
    """Whether a channel of a mapped file is not read into memory."""
    return any(
        isinstance(c.values, np.memmap) and c.values.size > MAX_SAMPLES_IN_MEMORY
        for c in table.columns.values()
    )


def read_long(
    path: str | Path,
    *,
    rate: float | None = None,
    columns: Columns | None = None,
    topic: str = "",
    instance: int | None = None,
) -> Log | StoredLog:
    """Read a log of any known format; one that is mapped and too long for memory stays in its file.

    Parameters
    ----------
    path : path-like
        The file.
    rate : float, optional
        Sampling rate [Hz]; replaces the file's own time.
    columns : ColumnMap or str, optional
        Which column is which channel, and its unit.
    topic : str
        Topic or message of a flight log from which channels are read wherever it has them.
    instance : int, optional
        Which of several inertial sensors of a flight log.

    Returns
    -------
    Log or StoredLog
        `StoredLog` where a channel of a mapped file has more than `MAX_SAMPLES_IN_MEMORY` samples.

    Raises
    ------
    InputError
        As `read_log`.
    """
    table, sha256 = read_table(Path(path), rate, LogChoice(topic, instance))
    if _is_too_long(table):
        return stored(table, map_of(columns), rate, sha256)
    log = assemble(table, map_of(columns), rate, sha256)
    del table
    return log.on_disk() if log.n * len(log.channels) > MAX_NUMBERS_IN_MEMORY else log


def recording_of(path: Path, choice: LogChoice = ANY) -> LogRecording | None:
    """The streams of a file with clocks of their own; None of a format that has one clock.

    Parameters
    ----------
    path : Path
    choice : LogChoice
        Topic and instance, where there are several.

    Returns
    -------
    LogRecording or None

    Raises
    ------
    InputError, MissingExtra
        As `read_log`.
    """
    reader = reader_of(path)
    if hasattr(reader, "inside"):
        inner: LogRecording | None = reader.inside(path, lambda content: recording_of(content, choice))
        return inner
    found: LogRecording | None = reader.recording(path, choice) if hasattr(reader, "recording") else None
    return found


def map_of(columns: Columns | None) -> ColumnMap | None:
    """The map of a text that says which column is which channel."""
    return ColumnMap.parse(columns) if isinstance(columns, str) else columns


def log_of(log: LogOrPath) -> Log:
    """A log over time, read where a path is given; raises `InputError` for an Allan curve."""
    found = log if isinstance(log, Log) else read_log(log)
    if found.axis != "t":
        raise InputError("it is an Allan curve and no log", where=found.source, remedy="Give the log itself")
    return found


def read_table(path: Path, rate: float | None, choice: LogChoice = ANY) -> tuple[LogTable, str]:
    """What the reader of a file found in it, before columns are mapped.

    Parameters
    ----------
    path : Path
    rate : float, optional
        Sampling rate [Hz], which is checked here only.
    choice : LogChoice
        Topic and instance, where there are several.

    Returns
    -------
    table : LogTable
    sha256 : str
        Hash of the file.

    Raises
    ------
    InputError, MissingExtra
        As `read_log`.
    """
    reader_of(path)
    sha256 = sha256_of(path)
    if rate is not None and not is_sampling_rate(rate):
        raise InputError(f"--rate must be positive (got {rate:g})", remedy="Give the sampling rate in hertz")
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore", RuntimeWarning)  # of numbers that a damaged file holds
        return _found(path, choice), sha256


def _found(path: Path, choice: LogChoice) -> LogTable:
    """What the reader of a file found in it, on one time axis."""
    reader = reader_of(path)
    if hasattr(reader, "inside"):
        inner: LogTable = reader.inside(path, lambda content: _found(content, choice))
        return inner
    if hasattr(reader, "recording"):
        recording: LogRecording = reader.recording(path, choice)
        return recording.table()
    if choice != ANY:
        raise InputError(
            "the log has one clock and neither topics nor instances",
            where=str(path),
            remedy="Leave --topic and --instance out, and choose columns with --columns",
        )
    table: LogTable = reader.read(path)
    return table


def write_log(log: Log, path: str | Path) -> None:
    """Write a log in the format of the path's suffix.

    Parameters
    ----------
    log : Log
    path : path-like
        With the suffix ``.csv`` or ``.npz``; an older file is replaced.

    Raises
    ------
    InputError
        No format that can be written has that suffix.
    """
    path = Path(path)
    writer = readers().get(path.suffix.lower())
    if writer is None or not hasattr(writer, "write"):
        raise InputError(f"cannot write '{path.suffix}' files", where=str(path), remedy="Give a .csv or .npz")
    writer.write(log, path)
