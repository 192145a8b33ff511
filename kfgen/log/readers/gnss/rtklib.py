"""Reads solutions of RTKLIB (.pos): coordinates or a baseline, and the velocity where it is written.

Times are seconds since 1970 of the calendar that the file names (GPS time, UTC), without leap seconds between them.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from kfgen.core.errors import InputError
from kfgen.log.readers.tables.aiding import gnss_stream
from kfgen.log.readers.tables.streams import ANY, LogChoice, LogRecording, LogStream
from kfgen.log.readers.tables.table import TableColumn

Array = NDArray[np.float64]

SUFFIXES = (".pos",)
WEEK_S = 604800.0
GPS_EPOCH_S = 315964800.0
"""1980-01-06 in seconds since 1970, both without leap seconds."""
FIXED = 1.0
"""`Q` of a solution with integer ambiguities."""
MOSTLY = 0.5
"""Share of fixed solutions above which the others are left out."""
_NAME = re.compile(r"([A-Za-z]+(?:-[a-z]+)?)(?:\((\w+(?:/\w+)?|[d'm\"s]+)\))?")
_COORDINATES = ({"latitude", "longitude", "height"}, {"n-baseline", "e-baseline", "u-baseline"})
_DATE = re.compile(r"\s*(\d{4})[/-](\d\d)[/-](\d\d)[ ,\t]+(\d\d):(\d\d):(\d\d(?:\.\d*)?)[ ,\t]+(.*)")


def recording(path: Path, choice: LogChoice = ANY) -> LogRecording:
    """The solutions of a file.

    Parameters
    ----------
    path : Path
    choice : LogChoice
        Has no meaning here.

    Returns
    -------
    LogRecording

    Raises
    ------
    InputError
        It is no solution of RTKLIB in latitude, longitude and height, or as a baseline.
    """
    lines = path.read_text(encoding="utf-8-sig", errors="replace").splitlines()
    names, scale = _header(path, lines)
    times, values, wrong = _rows([line for line in lines if line.strip() and line[0] not in "%#"], len(names))
    if times.size == 0:
        raise InputError("there is no solution in it", where=str(path), remedy="Give a .pos file of RTKLIB")
    named = dict(zip(names, values.T, strict=True))
    quality = named.get("Q", np.ones(times.size))
    good, lacks = quality > 0.0, "without a fix"
    words = [f"times are those of the file's calendar ({scale}), in seconds since 1970 without leap seconds"]
    if wrong:
        words.append(f"{wrong} lines are no solution (damaged or cut off) and were left out")
    if MOSTLY < np.mean(quality == FIXED) < 1.0:
        good, lacks = quality == FIXED, "without fixed ambiguities (Q other than 1)"
    stream, said = _stream(path, named, times, good, lacks)
    clocks = {stream.name: stream.clock()} if stream else {}
    return LogRecording(str(path), [stream] if stream else [], clocks, (*words, said))


def _header(path: Path, lines: list[str]) -> tuple[list[str], str]:
    """The names of the columns after the time, and the name of the calendar."""
    line = next(
        (
            li
            for li in lines
            if (li.startswith("%") and "latitude" in li) or "-baseline" in li or "-ecef" in li
        ),
        "",
    )
    names = [m.group(1) for m in _NAME.finditer(line.lstrip("% "))]
    whole = any(needed <= set(names) for needed in _COORDINATES) or "-ecef" in line
    if len(names) < 5 or not whole or len(set(names)) < len(names):
        raise InputError(
            "it has no header of RTKLIB ('%  GPST  latitude(deg) longitude(deg) height(m) Q ...')",
            where=str(path),
            remedy="Write the solution with out-outhead = on",
        )
    if "-ecef" in line or "d'" in line:
        raise InputError(
            "solutions in Earth-fixed axes or in degrees and minutes are not read",
            where=str(path),
            remedy="Write them with out-solformat = llh and out-degform = deg",
        )
    return names[1:], names[0]


def _rows(lines: list[str], width: int) -> tuple[Array, Array, int]:
    """Times [s] and numbers of the lines, and how many lines are no solution."""
    times: list[float] = []
    rows: list[list[float]] = []
    wrong = 0
    for line in lines:
        try:
            time, rest = _time(line)
            row = [float(c) for c in re.split(r"[\s,;]+", rest.strip())]
        except ValueError:
            wrong += 1
            continue
        if len(row) < width:
            wrong += 1
            continue
        times.append(time)
        rows.append(row[:width])
    return np.asarray(times), np.asarray(rows, np.float64).reshape(len(rows), width), wrong


def _time(line: str) -> tuple[float, str]:
    match = _DATE.match(line)
    if match is None:
        week, second, rest = re.split(r"[\s,;]+", line.strip(), maxsplit=2)
        return GPS_EPOCH_S + WEEK_S * int(week) + float(second), rest
    year, month, day, hour, minute, second, rest = match.groups()
    days = np.datetime64(f"{year}-{month}-{day}", "D").astype(int)
    return float(days * 86400 + int(hour) * 3600 + int(minute) * 60) + float(second), rest


def _stream(
    path: Path, named: dict[str, Array], t: Array, good: NDArray[np.bool_], lacks: str
) -> tuple[LogStream | None, str]:
    velocity = [named["vn"], named["ve"], -named["vu"]] if {"vn", "ve", "vu"} <= set(named) else []
    if "latitude" in named:
        position = [np.deg2rad(named["latitude"]), np.deg2rad(named["longitude"]), named["height"]]
        return gnss_stream(path.name, t, good, position, velocity, lacks)
    baseline = {"N": named["n-baseline"], "E": named["e-baseline"], "D": -named["u-baseline"]}
    columns = {f"gnss_p_{axis}": TableColumn(p[good], "m") for axis, p in baseline.items()}
    columns |= {f"gnss_v_{a}": TableColumn(v[good], "m/s") for a, v in zip("NED", velocity)}
    return LogStream(path.name, t[good], columns), "metres from the base station"
