"""Reads replays of PX4-ECL, and the answers of its filter to them: text with one sample a line, ``time [us],sensor,values`` (`test/sensor_simulator` there).

The order of the coordinates of ``gps``, height [mm], longitude, latitude [1e-7 deg], is that by which they agree with
its velocity.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from kfgen.core.errors import InputError
from kfgen.log.readers.tables.aiding import above_first_fix, gnss_stream
from kfgen.log.readers.tables.streams import LogRecording, LogStream
from kfgen.log.readers.tables.table import LogTable, TableColumn

Array = NDArray[np.float64]
Parsed = TypeVar("Parsed")

LINE = re.compile(
    r"\s*(\d+(?:\.\d+)?)\s*,\s*(imu|mag|baro|gps|airspeed|range|flow|landed|vio|unknown)\s*,(.*)$"
)
"""A sample."""
WHOLE_SHARE = 0.9
"""Share of lines that are samples, above which a text is a replay."""
_FIELDS: Mapping[str, Sequence[tuple[str, str]]] = {
    "imu": [*((f"accel_{a}", "m/s^2") for a in "xyz"), *((f"gyro_{a}", "rad/s") for a in "xyz")],
    "mag": [(f"mag_{a}", "uT") for a in "xyz"],
    "baro": [("baro_height", "m")],
    "airspeed": [("airspeed", "m/s")],
    "range": [("range", "m")],
}
"""Channels of the values of a sensor; the magnetometer is in gauss."""
_STATES = (
    *((f"ref_q_{a}", "") for a in "wxyz"),
    *((f"ref_v_{a}", "m/s") for a in "NED"),
    *((f"ref_p_{a}", "m") for a in "NED"),
)
"""The first states of the filter: attitude (body to north, east, down), velocity, position."""
MICROTESLA_PER_GAUSS = 100.0


def is_replay(lines: Sequence[str]) -> bool:
    """Whether a text is such a replay."""
    first = [line for line in lines[:200] if line.strip()]
    return bool(first) and sum(LINE.match(line) is not None for line in first) > WHOLE_SHARE * len(first)


def is_answer(lines: Sequence[str]) -> bool:
    """Whether a text is the states and variances of the filter."""
    return bool(lines) and lines[0].startswith("Timestamp,state[0],state[1],")


def read_answer(source: str, lines: Sequence[str]) -> LogTable:
    """Attitude, velocity and position of the filter as references.

    Parameters
    ----------
    source : str
        The file's name, for messages.
    lines : sequence of str

    Returns
    -------
    LogTable
        The other states by their names in the file, for ``--columns``.

    Raises
    ------
    InputError
        A line is damaged: with its number; only a last line that is cut off is left out.
    """
    names = [name.strip() for name in lines[0].split(",")]

    def numbers(line: str) -> list[float]:
        cells = line.split(",")[: len(names)]
        if len(cells) < len(names):
            raise ValueError
        return [float(c) for c in cells]

    rows = list(_parsed(source, lines[1:], 2, numbers, "line of numbers"))
    raw = {n: TableColumn(v) for n, v in zip(names, np.array(rows).reshape(-1, len(names)).T, strict=True)}
    columns = {"t": TableColumn(raw["Timestamp"].values, "us")}
    for k, (channel, unit) in enumerate(_STATES):
        columns[channel] = TableColumn(raw[f"state[{k}]"].values, unit)
    said = "attitude, velocity and position of the filter are references, its other states are for --columns"
    return LogTable(source, columns, None, (said,), others=raw)


def read_replay(source: str, lines: Sequence[str]) -> LogTable:
    """A replay on the time axis of its inertial sensor.

    Parameters
    ----------
    source : str
        The file's name, for messages.
    lines : sequence of str

    Returns
    -------
    LogTable

    Raises
    ------
    InputError
        A line is no sample: with its number; only a last line that is cut off is left out.
    """
    rows: dict[str, list[list[float]]] = {}
    for sensor, sample in _parsed(source, lines, 1, _sample, "sample 'time,sensor,values'"):
        rows.setdefault(sensor, []).append(sample)
    tables = {name: _table(samples) for name, samples in rows.items()}
    streams = [_stream(name, tables[name]) for name in _FIELDS if name in tables]
    gnss, said = _gnss(tables.get("gps"))
    streams, zero = above_first_fix(streams, gnss)
    clocks = {name: LogStream(name, a[:, 0] * 1e-6, {}).clock() for name, a in tables.items()}
    return LogRecording(
        source, [*streams, *gnss], clocks, tuple(w for w in (said, zero) if w), "before"
    ).table()


def _sample(line: str) -> tuple[str, list[float]]:
    """The sensor, and its time and values."""
    match = LINE.match(line)
    if match is None:
        raise ValueError
    return match.group(2), [float(match.group(1)), *(float(c) for c in match.group(3).split(","))]


def _parsed(
    source: str, lines: Sequence[str], first: int, parse: Callable[[str], Parsed], wanted: str
) -> Iterator[Parsed]:
    """Every line parsed; empty ones, and a last one that is cut off, are left out, another that is damaged is refused."""
    for k, line in enumerate(lines):
        try:
            yield parse(line)
        except ValueError:
            if not line.strip() or k == len(lines) - 1:
                continue
            raise InputError(
                f"it is no {wanted}", where=f"{source}: line {first + k}", remedy="Correct or remove it"
            ) from None


def _table(samples: Sequence[Sequence[float]]) -> Array:
    """Samples of the usual number of values, shape (n, k)."""
    width = max(map(len, samples))
    return np.array([s for s in samples if len(s) == width], np.float64)


def _stream(name: str, values: Array) -> LogStream:
    scale = MICROTESLA_PER_GAUSS if name == "mag" else 1.0
    fields = zip(_FIELDS[name], values[:, 1:].T)
    return LogStream(name, values[:, 0] * 1e-6, {c: TableColumn(scale * v, unit) for (c, unit), v in fields})


def _gnss(values: Array | None) -> tuple[list[LogStream], str]:
    if values is None or values.shape[1] < 7:
        return [], ""
    height, longitude, latitude = values[:, 1] * 1e-3, values[:, 2] * 1e-7, values[:, 3] * 1e-7
    position = [np.deg2rad(latitude), np.deg2rad(longitude), height]
    fixed = (latitude != 0.0) | (longitude != 0.0)
    stream, said = gnss_stream("gps", values[:, 0] * 1e-6, fixed, position, list(values[:, 4:7].T))
    return ([stream] if stream else []), said
