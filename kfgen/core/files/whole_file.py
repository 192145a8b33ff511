"""Outputs are written whole or not at all, into a temporary neighbour, then renamed; inputs are known by SHA-256.

Of several outputs that belong together (`all_or_none`) every one is finished before the first takes its name.
"""

from __future__ import annotations

import hashlib
import os
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from pathlib import Path

from kfgen.core.files.destination import Destination, reason_of
from kfgen.core.files.temporary import discard, temporary_file, temporary_folder


@dataclass
class _Together:
    """Outputs that appear together: which they are, and those that are finished."""

    wanted: frozenset[tuple[object, ...]]
    finished: list[tuple[Destination, Path, int]] = field(default_factory=list)

    def drop(self) -> None:
        """Remove what is finished and has not appeared."""
        for _, temporary, handle in self.finished:
            os.close(handle)
            discard(temporary)
        self.finished.clear()


_TOGETHER: ContextVar[_Together | None] = ContextVar("together", default=None)


@contextmanager
def all_or_none(outputs: Iterable[str | Path]) -> Iterator[None]:
    """Within the block these outputs wait for each other: `publish` lets them appear; an error removes all.

    Raises
    ------
    InputError
        One of them cannot take its name at the end.
    """
    together = _Together(frozenset(Destination.of(path).identity for path in outputs))
    token = _TOGETHER.set(together)
    try:
        yield
        publish()
    finally:
        _TOGETHER.reset(token)
        together.drop()


def publish() -> None:
    """Let the outputs of `all_or_none` that are finished appear under their names; without it nothing waits."""
    together = _TOGETHER.get()
    while together is not None and together.finished:
        place, temporary, handle = together.finished[0]
        _take(place, temporary)
        os.close(handle)
        del together.finished[0]


@contextmanager
def write_whole(path: str | Path) -> Iterator[Path]:
    """Yield a temporary path that becomes `path` when the block ends without an error.

    A link is followed, a file keeps its permissions, and a device or a pipe is written as it is.

    Raises
    ------
    InputError
        The folder does not exist, or the file cannot be written.
    """
    place = Destination.of(path)
    place.check()
    near = Path(tempfile.gettempdir(), "stream") if place.stream else place.path
    try:
        temporary, handle = temporary_file(near)
    except (OSError, ValueError) as error:
        raise place.unwritable(reason_of(error)) from None
    with _finished(place, temporary, handle):
        yield temporary


@contextmanager
def write_whole_folder(path: str | Path) -> Iterator[Path]:
    """Yield a temporary folder that becomes `path`, in the place of what is there, when the block ends without an error.

    Raises
    ------
    InputError
        The folder cannot be written.
    """
    place = Destination.of(path)
    place.check(folder=True)
    try:
        place.path.parent.mkdir(parents=True, exist_ok=True)
        temporary, handle = temporary_folder(place.path)
    except (OSError, ValueError) as error:
        raise place.unwritable(reason_of(error)) from None
    with _finished(place, temporary, handle):
        yield temporary


@contextmanager
def _finished(place: Destination, temporary: Path, handle: int) -> Iterator[None]:
    """After the block the temporary takes the place, or waits for the others; after an error it is removed."""
    waits = False
    try:
        yield
        together = _TOGETHER.get()
        if together is not None and place.identity in together.wanted:
            together.finished.append((place, temporary, handle))
            waits = True
        else:
            _take(place, temporary)
    except OSError as error:
        if error.filename is not None and str(temporary) not in str(error.filename):
            raise
        raise place.unwritable(reason_of(error)) from None
    finally:
        if not waits:
            os.close(handle)
            discard(temporary)


def _take(place: Destination, temporary: Path) -> None:
    try:
        place.take(temporary)
    except BrokenPipeError:
        raise
    except OSError as error:
        raise place.unwritable(reason_of(error)) from None


def write_text(path: str | Path, text: str) -> None:
    """Write a text file whole or not at all, in UTF-8.

    Parameters
    ----------
    path : path-like
        An existing file is replaced.
    text : str
        What UTF-8 does not have (of a file's name in another encoding) becomes ``?``.

    Raises
    ------
    InputError
        As `write_whole`.
    """
    with write_whole(path) as temporary:
        temporary.write_text(text, encoding="utf-8", errors="replace")


def sha256_of(data: bytes) -> str:
    """SHA-256 of bytes, in hexadecimal digits."""
    return hashlib.sha256(data).hexdigest()


def hashes(files: Iterable[Path]) -> dict[str, str]:
    """SHA-256 of files, by name."""
    return {str(f): sha256_of(f.read_bytes()) for f in files}
