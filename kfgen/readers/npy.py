"""NPY: one array of numpy, mapped from the file and not read into memory.

A row of samples is the column ``#1``; of two dimensions, each column is a channel: ``#1``, ``#2``. The format
knows neither names nor units nor time, so the user says them: ``--columns "gyro_x=#1 [deg/s]" --rate 100``.
Nothing that is pickled is ever loaded.
"""

from __future__ import annotations

import mmap
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kfgen.errors import InputError
from kfgen.readers.table import Column, Table

SUFFIXES = (".npy",)

CHUNK = 1 << 20
"""Samples in a chunk."""


def read(path: Path) -> Table:
    """Map an NPY file; its values stay on disk and of their own kind of number until they are used.

    Raises
    ------
    InputError
        It is no plain array of real numbers in one or two dimensions, or it is cut off.
    """
    try:
        array = np.load(path, mmap_mode="r", allow_pickle=False)
    except (ValueError, TypeError, OSError, EOFError, SyntaxError, OverflowError) as error:
        raise InputError(
            f"it is no plain array ({str(error).splitlines()[0] if str(error) else 'cut off'})",
            where=str(path),
            remedy="Write it with numpy.save",
        ) from None
    if not isinstance(array, np.memmap):
        array.close()
        raise InputError(
            "it is an archive and no single array", where=str(path), remedy="Give it the suffix .npz"
        )
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
    return Table(str(path), {f"#{k + 1}": Column(columns[:, k]) for k in range(columns.shape[1])})


def chunks(values: NDArray[Any], size: int = CHUNK) -> Iterator[NDArray[Any]]:
    """Slices of a row, one after the other; what was read of a mapped file is given back to the system.

    Without that, the whole file would in the end count as memory of this process.

    Parameters
    ----------
    values : ndarray, shape (n,)
        An array, or a column of a mapped file.
    size : int
        Samples in a slice. Use a slice before the next one is taken.
    """
    mapped: Any = values
    while isinstance(mapped, np.ndarray):
        mapped = mapped.base
    advice = getattr(mmap, "MADV_DONTNEED", None) if isinstance(mapped, mmap.mmap) else None
    for start in range(0, values.shape[0], size):
        yield values[start : start + size]
        if advice is not None:
            mapped.madvise(advice)
