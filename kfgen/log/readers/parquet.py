"""Reads Parquet by pyarrow: numeric columns by their names, and columns of dates as times."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from kfgen.core.errors import InputError, MissingExtra
from kfgen.log.readers.arrays import Named, table_of
from kfgen.log.readers.table import LogTable

SUFFIXES = (".parquet", ".pq")
MAGIC = b"PAR1"
MOST_VALUES = 500_000_000
"""Numbers in a file beyond which it is refused: 4 GB."""


def read(path: Path) -> LogTable:
    """Read the numeric columns of a Parquet file.

    Raises
    ------
    InputError
        It is no Parquet, it is damaged, or there is no column of samples in it.
    MissingExtra
        pyarrow is not installed.
    """
    try:
        import pyarrow as pa
        import pyarrow.parquet as pq
    except ImportError:
        raise MissingExtra(
            "Parquet is read by pyarrow, which is not installed",
            where=str(path),
            remedy='Install it with: pip install "kfgen[parquet]"',
        ) from None
    arrays: dict[str, Named] = {}
    try:
        file = pq.ParquetFile(path)
        if file.metadata.num_rows * file.metadata.num_columns > MOST_VALUES:
            raise InputError(
                "it has too many numbers for the memory", where=str(path), remedy="Cut it into parts"
            )
        for name in file.schema_arrow.names:
            column = file.read(columns=[name]).column(0)
            dates = pa.types.is_timestamp(column.type)
            if dates:
                column = column.cast(pa.timestamp("ns")).cast(pa.int64())
            kinds = (pa.types.is_integer, pa.types.is_floating, pa.types.is_boolean)
            if any(is_kind(column.type) for is_kind in kinds):
                values = np.asarray(column.cast(pa.float64(), safe=False).to_numpy(), np.float64)
                arrays[name] = Named(values, "ns" if dates else None)
    except InputError:
        raise
    except Exception as error:  # whatever a broken file leads to
        raise InputError(
            f"it is no Parquet file that can be read ({str(error).splitlines()[0] if str(error) else 'cut off'})",
            where=str(path),
            remedy="Write it again",
        ) from None
    return table_of(str(path), arrays)
