"""Text files of published programs: what their columns are called, and the units of those that write none."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from kfgen.core.channel_names import some_of
from kfgen.log.readers.tables.table import LogTable, TableColumn

COUNTS_PER_G, COUNTS_PER_DEG_S = 16384.0, 131.0
"""Of an MPU-6050 at +-2 g and +-250 deg/s, the ranges that its usual library sets (register map, 2013)."""
TOLERANCE = 0.15
"""Relative difference of the median specific force from one g, up to which counts are at that range."""
_AXES = ("ax", "ay", "az", "gx", "gy", "gz")
EUROC_IMU = {f"w_RS_S_{a}": f"gyro_{a}" for a in "xyz"} | {f"a_RS_S_{a}": f"accel_{a}" for a in "xyz"}
"""Columns of the file of an inertial sensor of the EuRoC data sets, with their units behind them."""
_CONSENSYS = re.compile(
    r".+_(?:(?P<time>Timestamp(?:Sync)?_Unix)|(?P<sensor>Accel|Gyro|Mag)_(?:LN_|WR_)?(?P<axis>[XYZ])"
    r"|(?P<quantity>Temperature|Pressure)_[A-Z0-9]+)_CAL"
)
"""Calibrated columns of Shimmer's Consensys: a device, a sensor (the accelerometer of low noise or of wide range), an axis."""


def with_units(table: LogTable, header: Sequence[str]) -> LogTable:
    """The table with the names and units of its program, where its header shows which one wrote it.

    Parameters
    ----------
    table : LogTable
        As the file has it.
    header : sequence of str
        The lines before the first row of numbers.

    Returns
    -------
    LogTable
        The same where the program is not known, or gravity contradicts the units.
    """
    if any(_CONSENSYS.fullmatch(name) for name in table.columns):
        return _of_consensys(table)
    if EUROC_IMU.keys() <= table.columns.keys():
        columns = {EUROC_IMU.get(name, name): c for name, c in table.columns.items()}
        return replace(table, columns=columns, others=dict(table.columns))
    # T. Suarez, ImuCalibration: its logger of an MPU-6050 writes counts at the ranges of the library's start.
    logger = any(line.startswith("Logging Type,") for line in header)
    if not logger or tuple(table.columns) != _AXES or any(c.unit for c in table.columns.values()):
        return table
    counts = np.column_stack([np.asarray(c.values, float) for c in table.columns.values()])
    whole = bool(np.isfinite(counts).all()) and bool((counts == np.round(counts)).all())
    if not whole or abs(np.median(np.linalg.norm(counts[:, :3], axis=1)) / COUNTS_PER_G - 1.0) > TOLERANCE:
        return table
    sensors = {"a": ("accel", "g", COUNTS_PER_G), "g": ("gyro", "deg/s", COUNTS_PER_DEG_S)}
    columns = {}
    for name, column in table.columns.items():
        sensor, unit, scale = sensors[name[0]]
        columns[f"{sensor}_{name[1]}"] = TableColumn(column.values / scale, unit)
    said = (
        "the header is that of the MPU-6050 logger of ImuCalibration: counts at +-2 g (confirmed by gravity) and "
        "+-250 deg/s; say other ranges with --columns, for example 'gyro_x=gx [deg/s/65.5]'"
    )
    return replace(table, columns=columns, others=dict(table.columns), warnings=(*table.warnings, said))


def _of_consensys(table: LogTable) -> LogTable:
    """A table of Shimmer's Consensys with the names of channels: of two sensors of one kind the first."""
    columns: dict[str, TableColumn] = {}
    left = []
    for name, column in table.columns.items():
        found = _CONSENSYS.fullmatch(name)
        channel = _channel(found) if found else name
        if channel in columns:
            left.append(f"'{name}'")
        else:
            columns[channel] = column
    said = (f"of several sensors of one kind the first is read; not {some_of(left)}",) if left else ()
    return replace(table, columns=columns, others=dict(table.columns), warnings=(*table.warnings, *said))


def _channel(found: re.Match[str]) -> str:
    if found["time"]:
        return "t"
    return (
        f"{found['sensor'].lower()}_{found['axis'].lower()}" if found["sensor"] else found["quantity"].lower()
    )
