"""Reads exports of phyphox: a folder (or zip) of CSV files, one a sensor, or one such file.

Axes are those of the phone: right, up, out of the screen. Acceleration without gravity is no specific force and is not read
as one.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from kfgen.log.readers.tables.aiding import above_first_fix, gnss_stream, pressure_height
from kfgen.log.readers.tables.clock import Clock
from kfgen.log.readers.tables.streams import ANY, LogChoice, LogRecording, LogStream
from kfgen.log.readers.tables.table import TableColumn
from kfgen.log.readers.text.csv import raw_table

Array = NDArray[np.float64]

FOLDER = "a folder of phyphox (Gyroscope.csv, Accelerometer.csv, ...)"
HEADER_BYTES = 200
"""Bytes of a file in which its first name stands."""
TIME = "Time (s)"
PASCAL_PER_HECTOPASCAL = 100.0
_SENSORS: Mapping[str, tuple[str, str]] = {
    r"gyroscope": ("gyro", "rad/s"),
    r"accelerometer|acceleration": ("accel", "m/s^2"),
    r"magnetometer|magnetic field": ("mag", "uT"),
}
"""Words that begin a column's or a file's name, the sensor and its unit."""
_AXIS = re.compile(r"(?:(.*?)\s+)?([xyz])\s*\((.*)\)$", re.I)


def parts(path: Path) -> list[Path]:
    """The tables in such a folder; none where it is another kind of folder."""
    return [p for p in sorted(path.glob("*.csv")) if p.is_file() and is_phyphox(p)]


def is_phyphox(path: Path) -> bool:
    """Whether a file is a table as phyphox exports it."""
    with path.open("rb") as file:
        head = file.read(HEADER_BYTES).decode("utf-8-sig", "replace")
    return re.match(rf'"?{re.escape(TIME)}"?[,;\t]', head) is not None


def recording(path: Path, choice: LogChoice = ANY) -> LogRecording:
    """The streams of an export, each with its own clock.

    Parameters
    ----------
    path : Path
        The folder.
    choice : LogChoice
        Has no meaning here.

    Returns
    -------
    LogRecording

    Raises
    ------
    InputError
        A table is damaged: with file, line and column.
    """
    words = ["axes of the phone: right, up, out of the screen"]
    inertial: list[LogStream] = []
    others: list[LogStream] = []
    gnss: list[LogStream] = []
    clocks: dict[str, Clock] = {}
    for part in parts(path):
        table, _ = raw_table(part)
        columns = {name: np.asarray(c.values, float) for name, c in table.columns.items()}
        t = columns.pop(TIME)
        clocks[part.stem] = Clock.of(t)
        words += [f"{part.stem}: {w}" for w in table.warnings]
        found, said = _channels(part.stem, columns)
        words += said
        if any(name.startswith("Latitude") for name in columns):
            fix, place = _gnss(part.stem, t, columns)
            gnss += fix
            words.append(place)
        elif found:
            stream = LogStream(part.stem, t, found)
            (inertial if any(c.startswith("gyro_") for c in found) else others).append(stream)
    others, zero = above_first_fix(others, gnss)
    ordered = sorted(others, key=lambda s: not any(c.startswith("accel_") for c in s.columns))
    return LogRecording(str(path), (*inertial, *ordered, *gnss), clocks, (*words, *([zero] if zero else [])))


def _channels(stem: str, columns: Mapping[str, Array]) -> tuple[dict[str, TableColumn], list[str]]:
    """Channels of a table by the words of its columns, or of its file."""
    found: dict[str, TableColumn] = {}
    for name, values in columns.items():
        match = _AXIS.match(name)
        if match is not None:
            called = match.group(1) or stem
            sensor = next((s for words, s in _SENSORS.items() if re.match(words, called, re.I)), None)
            if sensor and "linear" not in stem.lower():
                found[f"{sensor[0]}_{match.group(2).lower()}"] = TableColumn(values, sensor[1])
        elif name.startswith("Pressure"):
            pascal = values * (PASCAL_PER_HECTOPASCAL if "hPa" in name else 1.0)
            found |= {
                "baro_height": TableColumn(pressure_height(pascal), "m"),
                "pressure": TableColumn(pascal, "Pa"),
            }
    if found or not stem.lower().startswith("linear"):
        return found, []
    return {}, [f"{stem}: acceleration without gravity is no specific force and is left out"]


def _gnss(stem: str, t: Array, columns: Mapping[str, Array]) -> tuple[list[LogStream], str]:
    """Coordinates, and the velocity of speed and direction."""

    def column(*words: str) -> Array:
        named = (v for k, v in columns.items() if k.startswith(words))
        return next(named, np.full(t.size, np.nan))

    position = [np.deg2rad(column("Latitude")), np.deg2rad(column("Longitude")), column("Height", "Altitude")]
    speed, course = column("Velocity", "Speed"), np.deg2rad(column("Direction"))
    velocity = [speed * np.cos(course), speed * np.sin(course)]
    stream, said = gnss_stream(stem, t, np.isfinite(position[0]), position, velocity)
    return ([stream] if stream else []), said
