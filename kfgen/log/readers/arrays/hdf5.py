"""Reads HDF5 (.h5, .hdf5) and MAT v7.3 by h5py: numeric datasets by their names, units and rates of attributes.

Links to other files and data outside the file are not followed; objects of MATLAB are skipped.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from kfgen.core.optional_library import optional_library
from kfgen.log.readers.arrays import array_names
from kfgen.log.readers.arrays.named_arrays import Named, check_size, table_of
from kfgen.log.readers.tables.library import reading
from kfgen.log.readers.tables.table import LogTable

SUFFIXES = (".h5", ".hdf5", ".hdf")
MAGIC = b"\x89HDF\r\n\x1a\n"


def read(path: Path) -> LogTable:
    """Read the numeric datasets of an HDF5 file.

    Raises
    ------
    InputError
        It is no HDF5, it is damaged, or there is no array of samples in it.
    MissingExtra
        h5py is not installed.
    """
    return read_hdf5(path, turned=False)


def read_hdf5(path: Path, *, turned: bool) -> LogTable:
    """Read an HDF5 file.

    Parameters
    ----------
    path : Path
    turned : bool
        Whether rows and columns are exchanged, as MATLAB writes them.

    Returns
    -------
    LogTable

    Raises
    ------
    InputError, MissingExtra
        As `read`.
    """
    h5py = optional_library("h5py", "hdf5", "HDF5 is read by", str(path))
    with reading("HDF5 file", path, "Copy the file again"), h5py.File(path, "r") as file:
        datasets = _datasets(file, h5py)
        check_size(sum(d.size * max(len(d.dtype.names or ()), 1) for d in datasets.values()), path)
        arrays = {k: n for name, d in datasets.items() for k, n in _named(name, d, turned).items()}
        attributes = dict(file.attrs)
    rate = next((_number(v) for k, v in attributes.items() if array_names.is_rate(k) and _number(v)), None)
    return table_of(
        str(path), arrays, rate, " ".join(str(v) for v in attributes.values() if isinstance(v, str))
    )


def _datasets(file: Any, h5py: Any) -> dict[str, Any]:
    """Numeric datasets inside the file, by their path in it."""
    found: dict[str, Any] = {}

    def visit(name: str, item: Any) -> None:
        outside = isinstance(item, h5py.Dataset) and (item.external or item.is_virtual)
        if isinstance(item, h5py.Dataset) and not outside and not name.startswith("#"):
            numeric = item.dtype.kind in "fiub" or item.dtype.names is not None
            if numeric and item.ndim in (1, 2) and item.shape is not None:
                found[name] = item

    file.visititems(visit)
    return found


def _named(name: str, dataset: Any, turned: bool) -> dict[str, Named]:
    unit = next((dataset.attrs[k] for k in ("unit", "units", "Unit", "Units") if k in dataset.attrs), None)
    unit = unit.decode("utf-8", "replace") if isinstance(unit, bytes) else unit
    stated = str(unit) if isinstance(unit, str) and unit else None
    values = dataset[()]
    if dataset.dtype.names:
        return {
            f"{name}/{field}": Named(np.asarray(values[field], np.float64))
            for field in dataset.dtype.names
            if values.dtype[field].kind in "fiub" and values[field].ndim in (1, 2)
        }
    values = np.asarray(values, np.float64)
    return {name: Named(values.T if turned else values, stated)}


def _number(value: Any) -> float | None:
    try:
        number = float(np.asarray(value, np.float64).reshape(-1)[0])
    except (TypeError, ValueError, IndexError):
        return None
    return number if 0.0 < number < np.inf else None
