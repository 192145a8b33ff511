"""Readers of log files: one module a format, found by its suffixes.

A reader turns a file into a `LogTable`; `kfgen.log.readers.table` turns the table into a
`Log`. To add a format, add one module here with ``SUFFIXES`` and ``read(path)``.
"""

from __future__ import annotations

import hashlib
import importlib
import pkgutil
from functools import cache
from pathlib import Path
from types import ModuleType

import numpy as np

from kfgen.core.errors import InputError
from kfgen.core.numbers import is_sampling_rate
from kfgen.log.log import Log, StoredLog
from kfgen.log.readers.table import ColumnMap, LogTable, assemble, stored

__all__ = ["ColumnMap", "LogOrPath", "log_of", "read_log", "read_long", "readers", "write_log"]

LogOrPath = Log | str | Path
"""A log, or the path of its file."""
Columns = ColumnMap | str
"""Which column is which channel, or the text that says so: ``gyro_x=gx [deg/s/131], accel_x=#1 [g/16384]``."""

MAX_SAMPLES_IN_MEMORY = 20_000_000
"""Samples of a channel beyond which a mapped file is not read into memory."""
READ_BLOCK_BYTES = 1 << 20
"""Bytes of a file that are looked at in one piece."""


@cache
def readers() -> dict[str, ModuleType]:
    """The reader of each file suffix, from every module of this package that declares one."""
    found: dict[str, ModuleType] = {}
    for info in pkgutil.iter_modules(__path__):
        module = importlib.import_module(f"{__name__}.{info.name}")
        for suffix in getattr(module, "SUFFIXES", ()):
            found[suffix] = module
    return found


def read_log(path: str | Path, *, rate: float | None = None, columns: Columns | None = None) -> Log:
    """Read a log of any known format.

    Parameters
    ----------
    path : path-like
        The file.
    rate : float, optional
        Sampling rate [Hz]; replaces the file's own time.
    columns : ColumnMap or str, optional
        Which column is which channel, and its unit: ``gyro_x=gx [deg/s/131], accel_x=#1 [g/16384]``.

    Returns
    -------
    Log

    Raises
    ------
    InputError
        The file is missing, empty, of an unknown format or broken; the message names the place.
    """
    table, sha256 = _table(Path(path), rate)
    return assemble(table, _map_of(columns), rate, sha256)


def read_long(
    path: str | Path, *, rate: float | None = None, columns: Columns | None = None
) -> Log | StoredLog:
    """Read a log of any known format; one that is mapped and too long for memory stays in its file.

    Parameters
    ----------
    path : path-like
        The file.
    rate : float, optional
        Sampling rate [Hz]; replaces the file's own time.
    columns : ColumnMap, optional
        Which column is which channel, and its unit.

    Returns
    -------
    Log or StoredLog
        `StoredLog` where a channel of a mapped file has more than `MAX_SAMPLES_IN_MEMORY` samples.

    Raises
    ------
    InputError
        As `read_log`.
    """
    table, sha256 = _table(Path(path), rate)
    long = any(
        isinstance(c.values, np.memmap) and c.values.size > MAX_SAMPLES_IN_MEMORY
        for c in table.columns.values()
    )
    return (stored if long else assemble)(table, _map_of(columns), rate, sha256)


def _map_of(columns: Columns | None) -> ColumnMap | None:
    return ColumnMap.parse(columns) if isinstance(columns, str) else columns


def log_of(log: LogOrPath) -> Log:
    """A log over time, read where a path is given; raises `InputError` for an Allan curve."""
    found = log if isinstance(log, Log) else read_log(log)
    if found.axis != "t":
        raise InputError("it is an Allan curve and no log", where=found.source, remedy="Give the log itself")
    return found


def _table(path: Path, rate: float | None) -> tuple[LogTable, str]:
    """What the reader of a file found in it, and its SHA-256."""
    if not path.is_file():
        raise InputError("no such file", where=str(path), remedy="Check the path")
    reader = readers().get(path.suffix.lower())
    if reader is None:
        raise InputError(
            f"'{path.suffix}' is no format that is read",
            where=str(path),
            remedy=f"Known are {', '.join(sorted(readers()))}",
        )
    with path.open("rb") as file:
        if not any(block.strip() for block in iter(lambda: file.read(READ_BLOCK_BYTES), b"")):
            raise InputError("the file is empty", where=str(path), remedy="Give a log with samples")
        file.seek(0)
        sha256 = hashlib.file_digest(file, "sha256").hexdigest()
    if rate is not None and not is_sampling_rate(rate):
        raise InputError(
            f"a rate of {rate:g} Hz is no sampling rate", remedy="Give --rate a positive number of hertz"
        )
    return reader.read(path), sha256


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
        raise InputError(
            f"'{path.suffix}' is no format that is written", where=str(path), remedy="Give a .csv or .npz"
        )
    writer.write(log, path)
