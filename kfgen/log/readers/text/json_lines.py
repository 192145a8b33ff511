"""Reads JSON lines (.jsonl, .ndjson): one object a line, numbers by their keys; lists and objects inside by ``key_x``.

A key that a line does not have is a sample that was not recorded; lines of one time are one row.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from kfgen.core.errors import InputError
from kfgen.log.readers.arrays.array_names import is_time
from kfgen.log.readers.arrays.named_arrays import Named, table_of
from kfgen.log.readers.tables.table import LogTable

SUFFIXES = (".jsonl", ".ndjson", ".jsonlines")
NESTED_MOST = 4
"""Objects within objects that are looked into."""
MOST_KEYS = 1000


def read(path: Path) -> LogTable:
    """Read a file of JSON lines.

    Raises
    ------
    InputError
        A line is no object of JSON: with its number; only a last line that is cut off is left out.
    """
    rows: list[dict[str, float]] = []
    lines = path.read_text(encoding="utf-8-sig", errors="replace").splitlines()
    filled = [(k, line) for k, line in enumerate(lines, 1) if line.strip()]
    for k, line in filled:
        try:
            found = json.loads(line)
        except (ValueError, RecursionError):
            if k == filled[-1][0] and rows:
                break
            raise InputError(
                "it is no object of JSON", where=f"{path}: line {k}", remedy="Write one object a line"
            ) from None
        if not isinstance(found, dict):
            raise InputError(
                "it is no object of JSON", where=f"{path}: line {k}", remedy="Write one object a line"
            )
        rows.append(dict(_flat("", found, 0)))
    keys = list(dict.fromkeys(key for row in rows for key in row))
    if len(keys) > MOST_KEYS:
        raise InputError(f"it has {len(keys)} keys", where=str(path), remedy="Keep the keys of the sensors")
    values = np.array([[row.get(key, np.nan) for key in keys] for row in rows], np.float64).reshape(
        len(rows), len(keys)
    )
    return table_of(str(path), {k: Named(v) for k, v in zip(keys, _merged(keys, values).T, strict=True)})


def _flat(name: str, value: object, depth: int) -> Iterator[tuple[str, float]]:
    """Numbers of an object by key; those of a list of three by axis."""
    if isinstance(value, dict) and depth < NESTED_MOST:
        for key, inner in value.items():
            yield from _flat(f"{name}_{key}" if name else str(key), inner, depth + 1)
    elif isinstance(value, list) and len(value) <= 10:
        axes = {3: "xyz", 4: "wxyz"}.get(len(value), "0123456789")
        for axis, inner in zip(axes, value):
            yield from _flat(f"{name}_{axis}", inner, NESTED_MOST)
    elif isinstance(value, int | float) and abs(value) < 1e300:
        yield name, float(value)


def _merged(keys: list[str], values: np.ndarray) -> np.ndarray:
    """Rows of one time as one row, the later number where both have one."""
    at = next((k for k, key in enumerate(keys) if is_time(key)), None)
    if at is None or np.unique(values[:, at]).size == values.shape[0]:
        return values
    times, row = np.unique(values[:, at], return_inverse=True)
    out = np.full((times.size, len(keys)), np.nan)
    for k in range(len(keys)):
        good = np.isfinite(values[:, k])
        out[row[good], k] = values[good, k]
    return out
