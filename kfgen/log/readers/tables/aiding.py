"""Aiding sensors as kfgen has them: coordinates as metres about the first fix, pressure as height."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from kfgen.core.numbers import moment
from kfgen.core.wgs84 import local_metres
from kfgen.log.readers.tables.streams import LogStream
from kfgen.log.readers.tables.table import TableColumn

Array = NDArray[np.float64]

SEA_LEVEL_PASCAL = 101325.0
"""Pressure of the standard atmosphere at its level zero [Pa]."""
SCALE_HEIGHT_M = 44330.77
"""Temperature over its lapse in the standard atmosphere [m]."""
PRESSURE_EXPONENT = 0.190263
"""Gas constant times lapse over gravity in the standard atmosphere."""


def pressure_height(pressure: Array) -> Array:
    """Height in the standard atmosphere (ICAO Doc 7488, troposphere).

    Parameters
    ----------
    pressure : ndarray, shape (n,)
        [Pa].

    Returns
    -------
    ndarray, shape (n,)
        [m], up.
    """
    share = np.where(np.asarray(pressure) > 0.0, pressure, np.nan) / SEA_LEVEL_PASCAL
    return np.asarray(SCALE_HEIGHT_M * (1.0 - share**PRESSURE_EXPONENT), float)


def gnss_stream(
    name: str,
    t: Array,
    fixed: NDArray[np.bool_],
    position: Sequence[Array],
    velocity: Sequence[Array],
    lacks: str = "without a fix",
) -> tuple[LogStream | None, str]:
    """Solutions of a GNSS receiver as metres and metres a second north, east, down.

    Parameters
    ----------
    name : str
        Of the stream.
    t : ndarray, shape (n,)
        [s].
    fixed : ndarray of bool, shape (n,)
        Where the receiver has a fix; the other solutions are left out.
    position : three ndarrays, shape (n,)
        Latitude [rad], longitude [rad], height [m].
    velocity : up to three ndarrays, shape (n,)
        North, east, down [m/s].
    lacks : str
        What the solutions are that are left out.

    Returns
    -------
    LogStream or None
        None without any fix.
    said : str
        Where the first fix is, and what was left out.
    """
    good = fixed & np.isfinite(np.stack([t, *position])).all(axis=0)
    if not good.any():
        return None, f"{name}: no fix in any of {t.size} solutions, there is no GNSS in this log"
    latitude, longitude, height = (p[good] for p in position)
    metres = local_metres(latitude, longitude, height)
    columns = {f"gnss_p_{axis}": TableColumn(p, "m") for axis, p in zip("NED", metres, strict=True)}
    columns |= {f"gnss_v_{axis}": TableColumn(v[good], "m/s") for axis, v in zip("NED", velocity)}
    degrees = np.rad2deg([latitude[0], longitude[0]])
    said = (
        f"{name}: metres about the first fix, {degrees[0]:.7f} deg, {degrees[1]:.7f} deg, {height[0]:.2f} m"
    )
    if not good.all():
        said += f"; {good.size - good.sum()} of {good.size} solutions {lacks} left out"
    return LogStream(name, t[good], columns), said


def above_first_fix(streams: Sequence[LogStream], gnss: Sequence[LogStream]) -> tuple[list[LogStream], str]:
    """The height of a barometer above its own at the first fix, or above its first where there is no GNSS.

    Parameters
    ----------
    streams : sequence of LogStream
        Those other than GNSS.
    gnss : sequence of LogStream
        GNSS, where there is one.

    Returns
    -------
    streams : list of LogStream
    said : str
        What was subtracted; empty where there is no barometer.
    """
    out, said = list(streams), ""
    for k, stream in enumerate(out):
        column = stream.columns.get("baro_height")
        if column is None:
            continue
        good = np.isfinite(column.values)
        if not good.any():
            continue
        at = float(gnss[0].t[0]) if gnss else float(stream.t[good][0])
        zero = float(np.interp(at, stream.t[good], column.values[good]))
        columns = {**stream.columns, "baro_height": TableColumn(column.values - zero, column.unit)}
        out[k] = LogStream(stream.name, stream.t, columns)
        said = f"{stream.name}: height above {zero:.2f} m, its own at t = {moment(at)} s"
    return out, said
