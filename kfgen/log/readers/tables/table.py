"""From a file's columns to a `Log`: `LogTable`, what a reader found; `ColumnMap`, what the user says the columns are."""

from __future__ import annotations

import mmap
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kfgen.core.channel_names import some_of
from kfgen.core.errors import InputError
from kfgen.core.units import parse_unit
from kfgen.log.log import RATE_RELATIVE_TOLERANCE, Channel, Log, StoredChannel, StoredLog
from kfgen.log.readers.tables.clock import Clock

CHUNK_SAMPLES = 1 << 20
"""Samples in a slice of a mapped file."""
_SETTING = re.compile(
    r"\s*(?:#|//)?\s*(Fs|Sampl(?:e|ing) (?:rate|frequency)|Logging time)\s*[,;=:]\s*([0-9.]+)\s*(kHz|Hz|s)?\s*",
    re.I,
)
_SAMPLES = re.compile(r"\s*#\s*samples\s*[,;=:]\s*(after|before|at)\s*$", re.I)
_ENTRY = re.compile(r"\s*([A-Za-z_]\w*)\s*=\s*([^\[\]=]+?)\s*(?:\[([^\]]*)\])?\s*$")


@dataclass(frozen=True)
class TableColumn:
    """A column as a file has it.

    Parameters
    ----------
    values : ndarray, shape (n,)
        As stored.
    unit : str, optional
        The unit that the file states; None where it states none.
    """

    values: NDArray[np.float64]
    unit: str | None = None


@dataclass(frozen=True)
class LogTable:
    """What a reader found in a file.

    Parameters
    ----------
    source : str
        The file's name, for messages.
    columns : mapping of str to TableColumn
        By the file's own names, or ``#1``, ``#2`` where it has none.
    rate : float, optional
        Sampling rate that the file states [Hz].
    warnings : tuple of str
    stated : float
        Duration that the file states [s]; zero where it states none.
    samples : str
        As in `Log`.
    others : mapping of str to TableColumn
        Columns that are no channel by themselves, which ``--columns`` may map.
    hint : str
        What to type where columns have no names or no units; empty where that is not known.
    topics : mapping of str to Clock
        The clock of everything in a flight log, by topic.
    unplaced : mapping of str to str
        As in `Log`.
    """

    source: str
    columns: Mapping[str, TableColumn]
    rate: float | None = None
    warnings: tuple[str, ...] = field(default=())
    stated: float = 0.0
    samples: str = ""
    others: Mapping[str, TableColumn] = field(default_factory=dict)
    hint: str = ""
    topics: Mapping[str, Clock] = field(default_factory=dict)
    unplaced: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class ColumnMap:
    """``channel=column [unit]`` entries: the file's column (or ``#2``) as a channel in a unit."""

    entries: tuple[tuple[str, str, str | None], ...]

    @staticmethod
    def parse(text: str) -> ColumnMap:
        """Read ``"gyro_x=gx [deg/s/131], accel_x=#1 [g/16384]"``.

        Raises
        ------
        InputError
            An entry is not of that form, or a channel is named twice.
        """
        entries: list[tuple[str, str, str | None]] = []
        for part in text.split(","):
            match = _ENTRY.match(part)
            if match is None:
                raise InputError(
                    f"the entry '{part.strip()}' cannot be read",
                    where="--columns",
                    remedy="Write 'channel=column [unit]', separated by commas",
                )
            channel, column, unit = match.groups()
            if any(channel == known for known, _, _ in entries):
                raise InputError(f"channel '{channel}' is named twice", where="--columns")
            if unit is not None:
                try:
                    parse_unit(unit)
                except InputError as error:
                    raise InputError(error.what, where="--columns", remedy=error.remedy) from None
            entries.append((channel, column, unit))
        return ColumnMap(tuple(entries))


def stated_rate(lines: Sequence[str], n: int) -> tuple[float | None, float, tuple[str, ...]]:
    """The rate [Hz] of header lines like ``Fs,50`` or ``// Sample rate: 50.0Hz``, the ``Logging time,3600`` [s], a warning where they contradict.

    Parameters
    ----------
    lines : sequence of str
        The header.
    n : int
        Samples in the file.

    Returns
    -------
    rate : float or None
        Sampling rate [Hz].
    duration : float
        Stated duration [s]; zero where none is stated.
    warnings : tuple of str
    """
    found: dict[str, float] = {}
    for match in filter(None, map(_SETTING.fullmatch, lines)):
        name = "duration" if match.group(1).lower() == "logging time" else "rate"
        thousands = str(match.group(3)).lower() == "khz"
        found.setdefault(name, float(match.group(2)) * (1000.0 if thousands else 1.0))
    rate, duration = found.get("rate"), found.get("duration", 0.0)
    if rate is None or not 0.0 < rate < float("inf"):
        return None, 0.0, ()
    if duration > 0.0 and abs(n / rate / duration - 1.0) > RATE_RELATIVE_TOLERANCE:
        words = (
            f"the header says {rate:g} Hz, but {n} samples in {duration:g} s are {n / duration:.4g} Hz; "
            "give --rate to say which holds"
        )
        return rate, duration, (words,)
    return rate, duration, ()


def stated_samples(lines: Sequence[str]) -> str:
    """What the samples stand for by a header line like ``# samples: after``; empty where there is none."""
    return next((m.group(1).lower() for line in lines if (m := _SAMPLES.match(line))), "")


def assemble(table: LogTable, columns: ColumnMap | None, rate: float | None, sha256: str) -> Log:
    """A `Log` from a `LogTable`: names mapped, units converted, time found.

    Parameters
    ----------
    table : LogTable
    columns : ColumnMap or None
        Which column is which channel; None takes every column by its own name.
    rate : float or None
        Sampling rate [Hz] that replaces the time and the rate of the file.
    sha256 : str
        Hash of the file.

    Returns
    -------
    Log
        A column ``tau`` without ``t`` makes it a published Allan deviation.

    Raises
    ------
    InputError
        A mapped column is missing, a unit is unknown or missing, or there is no time.
    """
    chosen = _chosen(table, columns)
    if columns is None and table.hint and all(name.startswith("#") for name in chosen):
        raise InputError("its columns have no names", where=table.source, remedy=table.hint)
    tau = chosen.pop("tau", None) if "t" not in chosen else None
    time = tau or chosen.pop("t", None)
    channels = {name: Channel.of(c.values, _unit(table, name, c)) for name, c in chosen.items()}
    if not channels:
        raise InputError(
            "there is no channel in it",
            where=table.source,
            remedy="Name its columns 'gyro_x [deg/s]', or map them with --columns",
        )
    n = next(iter(channels.values())).values.size
    warnings = table.warnings if rate is None else ()
    stated = table.stated if rate is None and time is None else 0.0
    if rate is not None and time is not None:
        warnings += (f"the time column is replaced by --rate {rate:g} Hz",)
    rate = rate or (table.rate if time is None else None)
    if rate is None and time is None:
        raise InputError(
            "it has neither a column t nor a rate",
            where=table.source,
            remedy="Give --rate, or map the time: --columns 't=... [s], ...'",
        )
    if tau is not None:
        if not (np.diff(tau.values) > 0.0).all():
            raise InputError(
                "the averaging times do not increase", where=table.source, remedy="Sort the curve"
            )
        return Log(_time(table, tau), channels, table.source, sha256, table.warnings, axis="tau")
    t = np.arange(n) / rate if rate else _time(table, time)
    return Log(
        t,
        channels,
        table.source,
        sha256,
        warnings,
        stated=stated,
        samples=table.samples,
        unplaced=table.unplaced,
    )


def stored(table: LogTable, columns: ColumnMap | None, rate: float | None, sha256: str) -> StoredLog:
    """A `StoredLog` from a `LogTable` whose columns are mapped files.

    Parameters
    ----------
    table : LogTable
    columns : ColumnMap or None
        Which column is which channel; None takes every column by its own name.
    rate : float or None
        Sampling rate [Hz]; None takes that of the file.
    sha256 : str
        Hash of the file.

    Returns
    -------
    StoredLog

    Raises
    ------
    InputError
        As `assemble`, and when there is no rate.
    """
    chosen = _chosen(table, columns)
    rate = rate or table.rate
    if rate is None or "t" in chosen:
        raise InputError(
            "a log of this length is read with a sampling rate only",
            where=table.source,
            remedy="Give --rate, and map the channels without the time",
        )
    channels = {
        name: StoredChannel(partial(chunks, c.values), c.values.size, _unit(table, name, c))
        for name, c in chosen.items()
    }
    return StoredLog(1.0 / rate, channels, table.source, sha256, table.warnings)


def chunks(values: NDArray[Any], size: int = CHUNK_SAMPLES) -> Iterator[NDArray[Any]]:
    """Slices of a row, one after the other; what was read of a mapped file is given back to the system.

    Without that, the whole file would in the end count as memory of this process.

    Parameters
    ----------
    values : ndarray, shape (n,)
        An array, or a column of a mapped file.
    size : int
        Samples in a slice. Use a slice before the next one is taken.

    Returns
    -------
    iterator of ndarray
    """
    mapped: Any = values
    while isinstance(mapped, np.ndarray):
        mapped = mapped.base
    advice = getattr(mmap, "MADV_DONTNEED", None) if isinstance(mapped, mmap.mmap) else None
    for start in range(0, values.shape[0], size):
        yield values[start : start + size]
        if advice is not None:
            mapped.madvise(advice)


def _chosen(table: LogTable, columns: ColumnMap | None) -> dict[str, TableColumn]:
    if columns is None:
        return dict(table.columns)
    known = {**table.others, **table.columns}
    names = list(known)
    chosen: dict[str, TableColumn] = {}
    for channel, wanted, unit in columns.entries:
        name = wanted
        if re.fullmatch(r"#\d{1,9}", wanted) and 1 <= int(wanted[1:]) <= len(names):
            name = names[int(wanted[1:]) - 1]
        if name not in known:
            raise InputError(
                f"column '{wanted}' is missing", where=table.source, remedy=f"It has {some_of(names)}"
            )
        column = known[name]
        chosen[channel] = TableColumn(column.values, column.unit if unit is None else unit)
    if "t" in table.columns:
        chosen.setdefault("t", table.columns["t"])
    return chosen


def _unit(table: LogTable, name: str, column: TableColumn) -> str:
    if column.unit is None and re.fullmatch(r"(ref_)?q_[wxyz]", name):
        return ""  # an attitude's numbers have no other unit
    if column.unit is None:
        raise InputError(
            f"column '{name}' has no unit",
            where=table.source,
            remedy=table.hint
            or f"Name it '{name} [unit]', or say --columns '{name}={name} [unit]'; a number without a unit is in [1]",
        )
    try:
        parse_unit(column.unit)
    except InputError as error:
        raise InputError(error.what, where=f"{table.source}: column '{name}'", remedy=error.remedy) from None
    return column.unit


def _time(table: LogTable, time: TableColumn | None) -> NDArray[np.float64]:
    assert time is not None
    unit = parse_unit(_unit(table, "t", TableColumn(time.values, time.unit or "s")))
    if not unit.same_dimension(parse_unit("s")):
        raise InputError(
            f"the column t is in '{time.unit}', which is no time", where=table.source, remedy="Write t [s]"
        )
    return np.asarray(time.values * unit.factor, dtype=np.float64)
