"""Text files of published programs whose columns have no units, and the units that those programs write."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from kfgen.log.readers.tables.table import LogTable, TableColumn

COUNTS_PER_G, COUNTS_PER_DEG_S = 16384.0, 131.0
"""Of an MPU-6050 at +-2 g and +-250 deg/s, the ranges that its usual library sets (register map, 2013)."""
TOLERANCE = 0.15
"""Relative difference of the median specific force from one g, up to which counts are at that range."""
_AXES = ("ax", "ay", "az", "gx", "gy", "gz")


def with_units(table: LogTable, header: Sequence[str]) -> LogTable:
    """The table with the units of its program, where its header shows which one wrote it.

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
