"""Reads and writes NPZ logs: kfgen's own, and archives of arrays of other programs.

A foreign archive may hold triads under their usual names (``gyr``, ``acc``, ``mag``), a
reference attitude ``quat``, a rate ``fs`` and a text ``meta`` that states units. Other
arrays of two dimensions are split into columns: ``name_x``, ``name_y``, ``name_z`` for three.
Nothing that is pickled is ever loaded.
"""

from __future__ import annotations

import json
import re
import zipfile
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from kfgen.core.errors import InputError
from kfgen.core.files.array_file import archived
from kfgen.core.files.whole_file import write_whole
from kfgen.core.units import from_si
from kfgen.log.log import Log
from kfgen.log.readers.tables.table import LogTable, TableColumn, stated_rate

SUFFIXES = (".npz",)

_USUAL_NAMES = {
    "gyr": ("gyro", "rad/s"),
    "gyro": ("gyro", "rad/s"),
    "acc": ("accel", "m/s^2"),
    "accel": ("accel", "m/s^2"),
    "mag": ("mag", "uT"),
    "quat": ("ref_q", ""),
    "movement": ("movement", ""),
}
_AXIS_SUFFIXES = {3: "xyz", 4: "wxyz"}
# ENU axes seen from NED: a half turn about the bisector of north and east.
_Q_NED_ENU = np.array([0.0, np.sqrt(0.5), np.sqrt(0.5), 0.0])


def read(path: Path) -> LogTable:
    """Read an NPZ archive.

    Raises
    ------
    InputError
        It is no archive of plain arrays, or its arrays differ in length.
    """
    arrays = archived(path)
    try:
        units = _own_units(arrays)
        if units is not None:
            columns = {k: TableColumn(np.asarray(arrays[k], float), u) for k, u in units.items()}
            return LogTable(str(path), columns, samples=_samples(arrays))
    except (ValueError, TypeError, AttributeError, RecursionError):
        raise InputError(
            "its units or arrays are garbled", where=str(path), remedy="Write the log again"
        ) from None
    return _foreign(path, arrays)


def write(log: Log, path: str | Path) -> None:
    """Write a log as kfgen's own NPZ, whole or not at all.

    Parameters
    ----------
    log : Log
    path : path-like
    """
    units = {"t": "s", **{name: c.unit for name, c in log.channels.items()}}
    arrays: dict[str, NDArray[np.generic]] = {
        name: np.asarray(from_si(c.values, c.unit)) for name, c in log.channels.items()
    }
    arrays["t"] = np.asarray(log.t)
    arrays["kfgen_units"] = np.array(json.dumps(units))
    if log.samples:
        arrays["kfgen_samples"] = np.array(log.samples)
    with write_whole(path) as temporary, zipfile.ZipFile(temporary, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, array in arrays.items():
            with archive.open(f"{name}.npy", "w", force_zip64=True) as member:
                np.lib.format.write_array(member, np.asanyarray(array), allow_pickle=False)


def _samples(arrays: dict[str, NDArray[np.generic]]) -> str:
    """What the samples stand for, where the log says it in a word that is known."""
    said = str(arrays.get("kfgen_samples", ""))
    return said if said in ("after", "before", "at") else ""


def _own_units(arrays: dict[str, NDArray[np.generic]]) -> dict[str, str] | None:
    if "kfgen_units" not in arrays:
        return None
    units = json.loads(str(arrays["kfgen_units"]))
    return {str(k): str(v) for k, v in units.items() if k in arrays}


def _foreign(path: Path, arrays: dict[str, NDArray[np.generic]]) -> LogTable:
    meta = _meta(arrays)
    text = str(meta.get("columns", ""))
    lengths = [a.shape[0] for a in arrays.values() if a.ndim and a.dtype.kind in "fiub"]
    if not lengths:
        raise InputError(
            "there is no array of samples in it",
            where=str(path),
            remedy="Give arrays like gyr and acc, and fs",
        )
    n = max(lengths)
    columns: dict[str, TableColumn] = {}
    for name, array in arrays.items():
        if array.ndim not in (1, 2) or array.shape[0] != n or array.dtype.kind not in "fiub":
            continue
        columns.update(_columns(name, np.asarray(array, float), text))
    if any(name not in _USUAL_NAMES for name in arrays) and any(c.unit is not None for c in columns.values()):
        columns = {k: c for k, c in columns.items() if c.unit is not None or k == "t"}
    fs = arrays.get("fs")
    if fs is None or fs.ndim:
        return LogTable(str(path), columns)
    if fs.dtype.kind not in "fiu" or not 0.0 < float(fs) < np.inf:
        raise InputError(f"its rate fs is {fs}", where=str(path), remedy="Give a positive number of hertz")
    header = meta.get("header")
    lines = [f"Fs,{float(fs)}", *map(str, header if isinstance(header, list) else ())]
    _, stated, warnings = stated_rate(lines, n)
    return LogTable(str(path), columns, float(fs), warnings, stated)


def _meta(arrays: dict[str, NDArray[np.generic]]) -> dict[str, object]:
    try:
        meta = json.loads(str(arrays["meta"]))
    except (KeyError, ValueError, RecursionError):
        return {}
    return meta if isinstance(meta, dict) else {}


def _columns(name: str, values: NDArray[np.float64], text: str) -> dict[str, TableColumn]:
    channel, unit = _USUAL_NAMES.get(name, (name, None))
    if unit:
        stated = re.search(rf"\b{name}(?:\[[^\]]*\])?\s+([A-Za-z][\w/^]*)", text)
        unit = stated.group(1) if stated else unit
    if values.ndim == 1:
        return {channel: TableColumn(values, unit)}
    if channel == "ref_q" and "ENU" in text:
        values = _hamilton(_Q_NED_ENU, values)
    axes = _AXIS_SUFFIXES.get(values.shape[1], "0123456789")
    return {f"{channel}_{axes[k]}": TableColumn(values[:, k], unit) for k in range(min(values.shape[1], 10))}


def _hamilton(p: NDArray[np.float64], q: NDArray[np.float64]) -> NDArray[np.float64]:
    """The Hamilton products ``p q_k``, scalar first, shape (n, 4)."""
    from scipy.spatial.transform import Rotation  # heavy: only for logs with an ENU reference

    out = np.full_like(q, np.nan)
    good = np.isfinite(q).all(axis=1) & (np.abs(q).max(axis=1) > 0.0)
    turned = Rotation.from_quat(p, scalar_first=True) * Rotation.from_quat(q[good], scalar_first=True)
    out[good] = turned.as_quat(scalar_first=True)
    return out
