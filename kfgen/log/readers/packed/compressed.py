"""Reads logs compressed by gzip, xz or zstd (`log.csv.gz`): the inner suffix, or how the content begins, says what it is.

The content is written to a temporary folder piece by piece; what grows beyond all measure is refused.
"""

from __future__ import annotations

import gzip
import lzma
import tempfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import IO, TypeVar, cast

from kfgen.core.errors import InputError, KfgenError
from kfgen.core.optional_library import optional_library
from kfgen.log.readers.tables.library import reading
from kfgen.log.readers.tables.streams import LogRecording
from kfgen.log.readers.tables.table import LogTable

SUFFIXES = (".gz", ".xz", ".zst")
MAGIC = (b"\x1f\x8b\x08", b"\xfd7zXZ\0", b"\x28\xb5\x2f\xfd")
Found = TypeVar("Found", LogTable, LogRecording | None)

MOST_BYTES = 1 << 34
"""Size of the content beyond which it is refused."""
MOST_GROWTH = 2000
"""How many times larger than the file its content may be."""
SMALL_BYTES = 1 << 26
"""Size of the content below which its growth is no matter."""
PIECE_BYTES = 1 << 20


def inside(path: Path, use: Callable[[Path], Found]) -> Found:
    """What is made of the content of a compressed log; messages and the result name the compressed file.

    Parameters
    ----------
    path : Path
        The compressed file.
    use : callable
        From the path of the content to what is wanted; it must not need the content afterwards.

    Returns
    -------
    Found

    Raises
    ------
    InputError
        It is damaged, or its content is no log that is known.
    MissingExtra
        The library that decompresses it is not installed.
    """
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        inner = Path(folder) / path.stem
        _unpack(path, inner)
        if inner.suffix.lower() in SUFFIXES:
            raise InputError("it is compressed twice", where=str(path), remedy="Unpack it once")
        return named_as(path, inner, use)


def named_as(path: Path, inner: Path, use: Callable[[Path], Found]) -> Found:
    """What is made of an unpacked log, under the name of the file that it was in.

    Parameters
    ----------
    path : Path
        The file that holds it.
    inner : Path
        Where its content was written.
    use : callable
        From the path of the content to what is wanted.

    Returns
    -------
    Found

    Raises
    ------
    InputError
        As `use`; messages name the file.
    """
    try:
        found = use(inner)
    except KfgenError as error:
        where = error.where.replace(str(inner), str(path))
        raise type(error)(error.what, where=where, remedy=error.remedy) from None
    return found if found is None else replace(found, source=str(path))


def checked_growth(path: Path, content: IO[bytes], out: IO[bytes], written: int = 0) -> int:
    """Write content piece by piece, as long as it does not grow beyond all measure.

    Parameters
    ----------
    path : Path
        The file that holds it.
    content, out : binary file
        From where, and where to.
    written : int
        Bytes that were written before.

    Returns
    -------
    int
        Bytes that were written, those before among them.

    Raises
    ------
    InputError
        There is too much of it.
    """
    most = min(MOST_BYTES, max(MOST_GROWTH * path.stat().st_size, SMALL_BYTES))
    while piece := content.read(PIECE_BYTES):
        written += len(piece)
        if written > most:
            raise InputError(
                f"its content is more than {most} bytes", where=str(path), remedy="Unpack it yourself"
            )
        out.write(piece)
    return written


def _unpack(path: Path, inner: Path) -> None:
    with path.open("rb") as file:
        head = file.read(6)
    with (
        reading("compressed file", path, "Copy the file again"),
        _opened(path, head) as content,
        inner.open("wb") as out,
    ):
        checked_growth(path, content, out)


def _opened(path: Path, head: bytes) -> IO[bytes]:
    if head.startswith(MAGIC[0]):
        return cast(IO[bytes], gzip.open(path, "rb"))
    if head.startswith(MAGIC[1]):
        return lzma.open(path, "rb")
    if not head.startswith(MAGIC[2]):
        raise InputError(
            "it is not compressed by gzip, xz or zstd",
            where=str(path),
            remedy="Give it the suffix of its content",
        )
    zstandard = optional_library("zstandard", "zstd", "zstd is read by", str(path))
    reader: IO[bytes] = zstandard.ZstdDecompressor(max_window_size=1 << 27).stream_reader(
        path.open("rb"), read_across_frames=True, closefd=True
    )
    return reader
