"""Reads Parquet by pyarrow: numeric columns by their names, and columns of dates as times."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from kfgen.core.optional_library import optional_library
from kfgen.log.readers.arrays.named_arrays import Named, check_size, table_of
from kfgen.log.readers.tables.library import reading
from kfgen.log.readers.tables.table import LogTable

SUFFIXES = (".parquet", ".pq")
MAGIC = b"PAR1"


def read(path: Path) -> LogTable:
    """Read the numeric columns of a Parquet file.

    Raises
    ------
    InputError
        It is no Parquet, it is damaged, or there is no column of samples in it.
    MissingExtra
        pyarrow is not installed.
    """
    pq = optional_library("pyarrow.parquet", "parquet", "Parquet is read by", str(path))
    pa = optional_library("pyarrow", "parquet", "Parquet is read by", str(path))
    arrays: dict[str, Named] = {}
    with reading("Parquet file", path, "Write it again"):
        file = pq.ParquetFile(path)
        check_size(file.metadata.num_rows * file.metadata.num_columns, path)
        for name in file.schema_arrow.names:
            column = file.read(columns=[name]).column(0)
            dates = pa.types.is_timestamp(column.type)
            if dates:
                column = column.cast(pa.timestamp("ns")).cast(pa.int64())
            kinds = (pa.types.is_integer, pa.types.is_floating, pa.types.is_boolean)
            if any(is_kind(column.type) for is_kind in kinds):
                values = np.asarray(column.cast(pa.float64(), safe=False).to_numpy(), np.float64)
                arrays[name] = Named(values, "ns" if dates else None)
    return table_of(str(path), arrays)
