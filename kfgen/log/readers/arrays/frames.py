"""Tables in memory as logs: pandas, polars, pyarrow and xarray, and mappings of arrays; none of them is imported.

They are known by what they offer: columns by name, each of which numpy can read. Quantities of pint and unyt bring their
unit.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from kfgen.core.errors import InputError
from kfgen.log.readers.arrays.named_arrays import Named, table_of
from kfgen.log.readers.tables.table import LogTable

WORDS = "a mapping of arrays, a data frame of pandas or polars, a table of pyarrow, or a data set of xarray"


def frame_table(data: object) -> LogTable:
    """A table in memory as a `LogTable`.

    Parameters
    ----------
    data : object
        A mapping of arrays by name, or a table of pandas, polars, pyarrow or xarray.

    Returns
    -------
    LogTable

    Raises
    ------
    InputError
        It is none of these, or has no column of numbers.
    """
    name = type(data).__name__
    arrays: dict[str, Named] = {}
    for column, values in _columns(data):
        found = _named(values)
        if found is not None:
            arrays[str(column)] = found
    rate = getattr(data, "attrs", {}) if not isinstance(data, Mapping) else {}
    fs = next(
        (rate[k] for k in ("fs", "sampling_rate", "rate") if isinstance(rate, Mapping) and k in rate), None
    )
    return table_of(name, arrays, float(fs) if fs is not None else None)


def _columns(data: Any) -> Iterator[tuple[object, Any]]:
    """Names and columns."""
    if hasattr(data, "data_vars") and hasattr(data, "coords"):  # xarray
        yield from ((k, data[k]) for k in (*data.coords, *data.data_vars))
    elif isinstance(data, Mapping):
        yield from data.items()
    elif hasattr(data, "column_names") and hasattr(data, "column"):  # pyarrow
        yield from ((k, data.column(k)) for k in data.column_names)
    elif hasattr(data, "columns") and hasattr(data, "__getitem__"):  # pandas, polars
        index = getattr(data, "index", None)
        if index is not None and not callable(index) and (index.name is not None or _has_dates(index)):
            yield index.name or "time", index
        yield from ((k, data[k]) for k in data.columns)
    else:
        raise InputError(f"a {type(data).__name__} is no log", remedy=f"Give a path, {WORDS}")


def _has_dates(column: Any) -> bool:
    """Whether a column is one of dates by its own kind, with a time zone or without."""
    return str(getattr(column, "dtype", "")).startswith("datetime64")


def _is_date(values: np.ndarray[Any, Any]) -> bool:
    return values.dtype.kind in "Mm"


def _named(column: Any) -> Named | None:
    """Numbers of a column with their unit; None of words."""
    unit = getattr(column, "units", None)
    unit = unit if unit is not None else getattr(column, "attrs", {}).get("units")
    bare = getattr(column, "magnitude", None)
    try:
        values = np.asarray(column if bare is None else bare)
        if values.dtype.kind == "O" and _has_dates(column):  # pandas' dates with a time zone
            values = column.to_numpy(dtype="datetime64[ns]")
    except (TypeError, ValueError):
        return None
    if _is_date(values):
        known = ~np.isnat(values)
        kind = "datetime64[ns]" if values.dtype.kind == "M" else "timedelta64[ns]"
        return Named(np.where(known, values.astype(kind).astype(np.int64), np.nan), "ns")
    if values.dtype.kind not in "fiub" or values.ndim > 2:
        return None
    return Named(values.astype(np.float64), _unit(unit))


def _unit(unit: object) -> str | None:
    """A unit as kfgen types it: pint writes ``degree / second``."""
    if unit is None:
        return None
    text = f"{unit:~C}" if type(unit).__module__.startswith("pint") else str(unit)
    return text.replace("**", "^") or "1"
