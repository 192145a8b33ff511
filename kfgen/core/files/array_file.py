"""Arrays of numpy from files of unknown origin: what a header says is checked before numpy acts on it.

A header may state a shape of -1, elements of no size, or more of them than the file has; numpy divides by the one and
reserves memory for the other. Nothing that is pickled is ever loaded.
"""

from __future__ import annotations

import math
import warnings
import zipfile
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from kfgen.core.errors import InputError

MAX_DIMENSIONS = 32
"""Dimensions of an array; numpy allows 64."""
MAX_LENGTH = 1 << 48
"""Elements along one dimension of an array: more than any disk holds."""


@dataclass(frozen=True)
class ArrayHeader:
    """What the header of an NPY file says.

    Parameters
    ----------
    shape : tuple of int
    fortran : bool
        Whether the first index is the fastest.
    dtype : numpy.dtype
    offset : int
        Of the first element in the file [bytes].
    """

    shape: tuple[int, ...]
    fortran: bool
    dtype: np.dtype[Any]
    offset: int

    @staticmethod
    def read(file: IO[bytes], size_bytes: int) -> ArrayHeader:
        """The header at the beginning of a file.

        Parameters
        ----------
        file : binary file
        size_bytes : int
            Of the whole file, header and elements [bytes].

        Returns
        -------
        ArrayHeader

        Raises
        ------
        ValueError
            It is none, or says what cannot be.
        """
        try:
            version = np.lib.format.read_magic(file)
            readers = {
                (1, 0): np.lib.format.read_array_header_1_0,
                (2, 0): np.lib.format.read_array_header_2_0,
            }
            shape, fortran, dtype = readers[version](file)
        except Exception:  # a crafted header makes numpy raise anything, tokenize.TokenError for one
            raise ValueError("its header is none of numpy") from None
        if dtype.hasobject:
            raise ValueError("it holds Python objects, which are never loaded")
        if len(shape) > MAX_DIMENSIONS or any(isinstance(n, bool) or not 0 <= n <= MAX_LENGTH for n in shape):
            raise ValueError("its shape cannot be")
        header = ArrayHeader(shape, bool(fortran), dtype, file.tell())
        if header.offset + header.count * dtype.itemsize > size_bytes:
            raise ValueError("it is cut off: fewer values than its header says")
        return header

    @property
    def count(self) -> int:
        """Number of elements."""
        return math.prod(self.shape)


def mapped(path: Path) -> NDArray[Any]:
    """The array of an NPY file, mapped and not read.

    Raises
    ------
    ValueError
        It is no plain array with elements, or cut off.
    """
    with path.open("rb") as file, warnings.catch_warnings():
        warnings.simplefilter(
            "ignore", UserWarning
        )  # of numpy, on headers that Python 2 wrote: they are read
        header = ArrayHeader.read(file, path.stat().st_size)
    if header.count * header.dtype.itemsize == 0:
        return np.empty(header.shape, header.dtype)
    order = "F" if header.fortran else "C"
    return np.memmap(path, header.dtype, "r", header.offset, header.shape, order)  # type: ignore[call-overload, no-any-return]


def archived(path: Path) -> dict[str, NDArray[Any]]:
    """The arrays of an NPZ archive by their names; members that are no arrays are skipped.

    Raises
    ------
    InputError
        It is no archive, or an array in it is not plain, cut off, or larger than the memory.
    """
    arrays = {}
    name = ""
    try:
        with zipfile.ZipFile(path) as archive:
            for info in archive.infolist():
                name = info.filename
                if name.endswith(".npy"):
                    arrays[name.removesuffix(".npy")] = _member(archive, info)
    except MemoryError:
        raise InputError(
            f"'{name}' needs more memory than there is", where=str(path), remedy="Cut the log"
        ) from None
    except (ValueError, OSError, EOFError, RuntimeError, zlib.error, zipfile.BadZipFile) as error:
        raise InputError(
            f"it is no archive of plain arrays ({f'{name}: ' if name else ''}{_first_line(error)})",
            where=str(path),
            remedy="Write it with numpy.savez",
        ) from None
    return arrays


def _member(archive: zipfile.ZipFile, info: zipfile.ZipInfo) -> NDArray[Any]:
    with archive.open(info) as file:
        ArrayHeader.read(file, info.file_size)
    with archive.open(info) as file:
        return np.asarray(np.lib.format.read_array(file, allow_pickle=False))


def _first_line(error: BaseException) -> str:
    """What an error says, in a line."""
    return str(error).splitlines()[0] if str(error) else "cut off"
