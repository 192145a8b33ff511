"""Columns of text files of other programs: their usual names and clocks, and what to type where they have none."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from kfgen.core.channel_names import some_of
from kfgen.core.units import is_unit
from kfgen.log.readers.arrays import array_names
from kfgen.log.readers.arrays.named_arrays import Named, table_of
from kfgen.log.readers.arrays.turning_gravity import gyro_unit
from kfgen.log.readers.tables.seconds import UNITS_S, seconds_per, stamp_unit
from kfgen.log.readers.tables.table import LogTable, TableColumn

Array = NDArray[np.float64]

PREVIEWED_ROWS = 3
FULL_SCALES = {
    16384: ("g/16384", "deg/s/131"),
    8192: ("g/8192", "deg/s/65.5"),
    4096: ("g/4096", "deg/s/32.8"),
    2048: ("g/2048", "deg/s/16.4"),
}
"""Counts of one g, and the units of accelerometer and gyro of the ranges of the MPU-6050 (data sheet, 2013)."""
_IN_PARENTHESES = re.compile(r"(.*\S)\s*\(([^()]+)\)")
OTHER_SPELLINGS = {
    "G": "gauss",
    "°/s": "deg/s",
    "degrees/s": "deg/s",
    "m/s²": "m/s^2",
    "m/s/s": "m/s^2",
    "µT": "uT",
}
"""Of units, in the names of columns of other programs."""
SCALE_TOLERANCE = 0.15
"""Relative difference from the counts of one g within which a range is suggested."""


def foreign(table: LogTable, words: Mapping[str, TableColumn]) -> LogTable:
    """The columns of a text file with those of other programs understood.

    Parameters
    ----------
    table : LogTable
        As the file has it.
    words : mapping of str to TableColumn
        Its columns of words, which are no channels.

    Returns
    -------
    LogTable
        Without a unit anywhere, columns are known by their usual names; with units, only the time is looked for. Where
        names or units are missing, `hint` says what to type.
    """
    columns = {k: c for k, c in table.columns.items() if k not in words}
    if all(name.startswith("#") for name in columns):
        return _unnamed(table, columns)
    if (behind := _with_units_behind_names(table, columns)) is not None:
        return behind
    if any(c.unit is not None and not array_names.is_time(k) for k, c in columns.items()):
        return replace(table, columns=_timed(columns), others={**table.others, **table.columns, **words})
    if all(c.values.size < 2 for c in columns.values()):
        return replace(table, columns=columns)
    found = table_of(
        table.source, {k: Named(np.asarray(c.values), c.unit) for k, c in columns.items()}, table.rate
    )
    known = {k: c for k, c in found.columns.items() if k != "t"}
    if not known or set(known) <= set(columns):
        return replace(
            table, columns=_timed(columns), others={**table.columns, **words}, hint=_of_names(columns)
        )
    same = (
        len(found.columns["t"].values) == len(next(iter(columns.values())).values)
        if "t" in found.columns
        else True
    )
    others = dict(table.columns) if same else {}
    said = (*table.warnings, *found.warnings)
    return replace(
        table, columns=found.columns, rate=found.rate, warnings=said, others=others, hint=_of_names(columns)
    )


def _with_units_behind_names(table: LogTable, columns: Mapping[str, TableColumn]) -> LogTable | None:
    """The table with the units that other programs write behind names, ``Gyroscope X (deg/s)``; None without one."""
    if any(c.unit is not None for c in columns.values()):
        return None
    out: dict[str, TableColumn] = {}
    left: list[str] = []
    for name, column in columns.items():
        match = _IN_PARENTHESES.fullmatch(name)
        unit = OTHER_SPELLINGS.get(match.group(2), match.group(2)) if match else ""
        if match and is_unit(unit):
            axis = array_names.axis_of(match.group(1))
            out[f"{axis[0]}_{axis[1]}" if axis else match.group(1)] = TableColumn(column.values, unit)
        elif array_names.is_time(name):
            out[name] = column
        else:
            left.append(f"'{name}'")
    if not any(c.unit is not None and not array_names.is_time(k) for k, c in out.items()):
        return None
    said = [f"columns without a unit were left out: {some_of(left)}"] if left else []
    warnings = (*table.warnings, *said)
    return replace(table, columns=_timed(out), others={**table.others, **columns}, warnings=warnings)


def _timed(columns: Mapping[str, TableColumn]) -> dict[str, TableColumn]:
    """The columns with the one that is called as times are as ``t``."""
    if "t" in columns or "tau" in columns:
        return dict(columns)
    name = next(
        (
            k
            for k, c in columns.items()
            if array_names.is_time(k) and (c.unit is None or seconds_per(c.unit) is not None)
        ),
        None,
    )
    if name is None:
        return dict(columns)
    time = columns[name]
    unit = time.unit or stamp_unit(name, np.asarray(time.values, float))
    return {
        "t" if k == name else k: TableColumn(c.values, unit) if k == name else c for k, c in columns.items()
    }


def _unnamed(table: LogTable, columns: Mapping[str, TableColumn]) -> LogTable:
    """A table without names: read where gravity shows what its columns are, else with the line to type."""
    rows = np.column_stack([np.asarray(c.values, float) for c in columns.values()])
    guesses, sure = _guessed(list(columns), rows, table.rate)
    entries = [f"{channel}={name} [{unit}]" for channel, name, unit in guesses]
    line = ", ".join(entries) if entries else f"a={next(iter(columns))} [1]"
    if sure:
        words = (
            f"its columns have no names; by gravity they are --columns '{line}': type another if they are not"
        )
        found = {channel: TableColumn(columns[name].values, unit) for channel, name, unit in guesses}
        return replace(table, columns=found, others=table.columns, warnings=(*table.warnings, words))
    shown = "\n".join("  " + "  ".join(f"{v:.13g}" for v in row) for row in rows[:PREVIEWED_ROWS])
    rate = "" if table.rate or any(e.startswith("t=") for e in entries) else " --rate HZ"
    hint = f"Its first rows are\n{shown}\nSay what they are, for example: --columns '{line}'{rate}"
    return replace(table, columns=columns, others=table.columns, hint=hint)


def _guessed(
    names: Sequence[str], rows: Array, rate: float | None
) -> tuple[list[tuple[str, str, str]], bool]:
    """Channel, column and unit of what looks like times and triads; and whether gravity confirms all of them."""
    left = [k for k in range(len(names)) if np.isfinite(rows[:, k]).all() and np.ptp(rows[:, k]) > 0.0]
    time = next((k for k in left if rows.shape[0] > 2 and (np.diff(rows[:, k]) > 0.0).all()), None)
    guesses, t = [], np.arange(rows.shape[0]) / rate if rate else None
    if time is not None:
        unit = stamp_unit("t", rows[:, time])
        guesses, t = [("t", names[time], unit)], rows[:, time] * UNITS_S[unit]
        left.remove(time)
    triads = [left[k : k + 3] for k in range(0, len(left) - 2, 3)]
    size = [float(np.median(np.linalg.norm(rows[:, own], axis=1))) for own in triads]
    accel = next((k for k, s in enumerate(size) if _unit_of(s) is not None), None)
    units = (_unit_of(size[accel]) if accel is not None else None) or ("m/s^2", "rad/s")
    turned = ""
    if accel is not None and len(triads) > 1 and t is not None:
        gyro = next(own for k, own in enumerate(triads) if k != accel)
        turned = gyro_unit(t, rows[:, triads[accel]], rows[:, gyro])
    sensors = iter([("gyro", turned or units[1]), ("mag", "uT")])
    for k, own in enumerate(triads):
        sensor, unit = ("accel", units[0]) if k == accel else next(sensors, ("", ""))
        guesses += [
            (f"{sensor}_{axis}", names[c], unit) for axis, c in zip("xyz", own, strict=True) if sensor
        ]
    return guesses, bool(turned) and len(left) == 6


def _unit_of(size: float) -> tuple[str, str] | None:
    """Units of accelerometer and gyro by the accelerometer's size at rest; None where it is none."""
    if 5.0 < size < 20.0:
        return "m/s^2", "rad/s"
    if 0.5 < size < 2.0:
        return "g", "deg/s"
    return next((u for counts, u in FULL_SCALES.items() if abs(size / counts - 1.0) < SCALE_TOLERANCE), None)


def _of_names(columns: Mapping[str, TableColumn]) -> str:
    """The line to type for columns of usual names without units; empty without such a column."""
    axes = {name: axis for name in columns if (axis := array_names.axis_of(name)) is not None}
    of_accel = [np.asarray(columns[n].values, float) for n, a in axes.items() if a[0] == "accel"]
    size = float(np.nanmedian(np.sqrt(np.sum(np.square(of_accel), axis=0)))) if of_accel else 0.0
    units = _unit_of(size) or ("m/s^2", "deg/s")
    unit_of = {"accel": units[0], "gyro": units[1], "mag": "uT"}
    entries = [f"{a[0]}_{a[1]}={n} [{unit_of[a[0]]}]" for n, a in axes.items() if a[0] in unit_of]
    if not entries:
        return ""
    return f"Say the units, for example: --columns '{', '.join(entries)}'"
