"""Reads MAT files: v4 to v7 by scipy, v7.3 by h5py. Variables and fields of structs by their names; nothing is executed."""

from __future__ import annotations

from collections.abc import Iterator
from mmap import ACCESS_READ, mmap
from pathlib import Path
from typing import Any

import numpy as np

from kfgen.log.readers.arrays import hdf5
from kfgen.log.readers.arrays.mat_elements import check_elements
from kfgen.log.readers.arrays.named_arrays import Named, table_of
from kfgen.log.readers.tables.library import reading
from kfgen.log.readers.tables.table import LogTable

SUFFIXES = (".mat",)
MAGIC = b"MATLAB "
HDF5_AT = 512
"""Where the HDF5 of a v7.3 file begins [byte]."""
NESTED_MOST = 6
"""Structs within structs that are looked into."""


def read(path: Path) -> LogTable:
    """Read the numeric variables of a MAT file.

    Raises
    ------
    InputError
        It is no MAT file, it is damaged, or there is no array of samples in it.
    MissingExtra
        It is of v7.3, and h5py is not installed.
    """
    with path.open("rb") as file:
        head = file.read(HDF5_AT + len(hdf5.MAGIC))
    if head.startswith(hdf5.MAGIC) or head[HDF5_AT:] == hdf5.MAGIC:
        return hdf5.read_hdf5(path, turned=True)
    from scipy.io import loadmat  # heavy: only for MAT files

    with reading("MAT file", path, "Write it with save(..., '-v7')"):
        if head.startswith(MAGIC):
            with path.open("rb") as file, mmap(file.fileno(), 0, access=ACCESS_READ) as data:
                check_elements(data)
        variables = loadmat(
            path, struct_as_record=True, squeeze_me=False, verify_compressed_data_integrity=True
        )
    arrays = {n: a for k, v in variables.items() if not k.startswith("__") for n, a in _named(k, v, 0)}
    return table_of(str(path), arrays)


def _named(name: str, value: Any, depth: int) -> Iterator[tuple[str, Named]]:
    if not isinstance(value, np.ndarray) or depth > NESTED_MOST:
        return
    if value.dtype.names and value.size == 1:
        for field in value.dtype.names:
            yield from _named(f"{name}/{field}", value.reshape(-1)[0][field], depth + 1)
    elif value.dtype.kind in "fiub" and value.ndim <= 2:
        yield name, Named(np.asarray(value, np.float64))
