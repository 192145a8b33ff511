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

from kfgen.core.errors import InputError, KfgenError, MissingExtra
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
        try:
            found = use(inner)
        except KfgenError as error:
            where = error.where.replace(str(inner), str(path))
            raise type(error)(error.what, where=where, remedy=error.remedy) from None
        return found if found is None else replace(found, source=str(path))


def _unpack(path: Path, inner: Path) -> None:
    with path.open("rb") as file:
        head = file.read(6)
    size = path.stat().st_size
    most = min(MOST_BYTES, max(MOST_GROWTH * size, SMALL_BYTES))
    written = 0
    try:
        with _opened(path, head) as content, inner.open("wb") as out:
            while piece := content.read(PIECE_BYTES):
                written += len(piece)
                if written > most:
                    raise InputError(
                        f"its content is more than {most} bytes", where=str(path), remedy="Unpack it yourself"
                    )
                out.write(piece)
    except Exception as error:  # each library has errors of its own
        if isinstance(error, KfgenError):
            raise
        raise InputError(
            f"it cannot be unpacked ({str(error) or 'cut off'})",
            where=str(path),
            remedy="Copy the file again",
        ) from None


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
    try:
        import zstandard
    except ImportError:
        raise MissingExtra(
            "zstd is read by zstandard, which is not installed",
            where=str(path),
            remedy='Install it with: pip install "kfgen[zstd]"',
        ) from None
    reader: IO[bytes] = zstandard.ZstdDecompressor(max_window_size=1 << 27).stream_reader(
        path.open("rb"), read_across_frames=True, closefd=True
    )
    return reader
