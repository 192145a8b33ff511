"""Outputs are written whole or not at all, into a temporary neighbour, then renamed; inputs are known by SHA-256."""

from __future__ import annotations

import hashlib
import os
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

from kfgen.core.errors import InputError


@contextmanager
def write_whole(path: str | Path) -> Iterator[Path]:
    """Yield a temporary path that becomes `path` when the block ends without an error.

    Raises
    ------
    InputError
        The folder does not exist or cannot be written.
    """
    path = Path(path)
    if not path.parent.is_dir():
        raise InputError(
            "the folder of the output does not exist", where=str(path), remedy=f"Make {path.parent} first"
        )
    try:
        handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
    except OSError as error:
        raise InputError(f"cannot be written ({error.strerror})", where=str(path)) from None
    os.close(handle)
    temporary = Path(name)
    try:
        yield temporary
        umask = os.umask(0)
        os.umask(umask)
        temporary.chmod(0o666 & ~umask)
        temporary.replace(path)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise


def write_text(path: str | Path, text: str) -> None:
    """Write a text file whole or not at all, in UTF-8.

    Parameters
    ----------
    path : path-like
        An existing file is replaced.
    text : str

    Raises
    ------
    InputError
        As `write_whole`.
    """
    with write_whole(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def hashes(files: Iterable[Path]) -> dict[str, str]:
    """SHA-256 of files, by name."""
    return {str(f): hashlib.sha256(f.read_bytes()).hexdigest() for f in files}
