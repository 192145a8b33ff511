"""Reads NPY logs: one array of numpy, mapped from the file and not read into memory.

A row of samples is the column ``#1``; of two dimensions, each column is a channel: ``#1``, ``#2``. The format
knows neither names nor units nor time, so the user says them: ``--columns "gyro_x=#1 [deg/s]" --rate 100``.
Nothing that is pickled is ever loaded.
"""

from __future__ import annotations

import zipfile
from pathlib import Path

from kfgen.core.errors import InputError
from kfgen.core.files.array_file import mapped
from kfgen.log.readers.tables.table import LogTable, TableColumn

SUFFIXES = (".npy",)


def read(path: Path) -> LogTable:
    """Map an NPY file; its values stay on disk and of their own kind of number until they are used.

    Raises
    ------
    InputError
        It is no plain array of real numbers in one or two dimensions, or it is cut off.
    """
    try:
        array = mapped(path)
    except (ValueError, OSError) as error:
        if zipfile.is_zipfile(path):
            raise InputError(
                "it is an archive and no single array", where=str(path), remedy="Give it the suffix .npz"
            ) from None
        raise InputError(
            f"it is no plain array ({error})", where=str(path), remedy="Write it with numpy.save"
        ) from None
    if array.dtype.kind not in "fiu":
        raise InputError(
            f"it holds '{array.dtype}', not real numbers",
            where=str(path),
            remedy="Write an array of float32, float64 or integers",
        )
    if array.ndim not in (1, 2) or array.size == 0:
        raise InputError(
            f"an array of shape {array.shape} is no table of samples",
            where=str(path),
            remedy="Write one row for each sample and one column for each channel",
        )
    columns = array[:, None] if array.ndim == 1 else array
    return LogTable(str(path), {f"#{k + 1}": TableColumn(columns[:, k]) for k in range(columns.shape[1])})
