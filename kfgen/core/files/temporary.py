"""Temporary neighbours of an output, locked while they are written: those of killed runs are known, and removed."""

from __future__ import annotations

import os
import re
import shutil
import tempfile
from contextlib import suppress
from pathlib import Path

SUFFIX = ".kfgen"
"""Of the name of a temporary neighbour, ``.NAME.xxxxxxxx.kfgen``."""
OLD_SUFFIX = ".kfgen-old"
"""Of a folder that is being replaced."""
MAX_NAME_BYTES = 180
"""Bytes of an output's name that its temporary neighbour has; systems allow 255 in all."""


def temporary_file(path: Path) -> tuple[Path, int]:
    """An empty file beside `path`, and the handle that locks it; raises `OSError`."""
    remove_dangling(path)
    while True:
        handle, name = tempfile.mkstemp(dir=path.parent, prefix=_prefix(path), suffix=SUFFIX)
        _locks(handle, wait=True)
        if os.path.exists(name):  # another run may have found it before it was locked
            return Path(name), handle
        os.close(handle)


def temporary_folder(path: Path) -> tuple[Path, int]:
    """An empty folder beside `path`, and the handle that locks it; raises `OSError`."""
    remove_dangling(path)
    while True:
        fresh = Path(tempfile.mkdtemp(dir=path.parent, prefix=_prefix(path), suffix=SUFFIX))
        with suppress(FileNotFoundError):  # as above
            handle = os.open(fresh, os.O_RDONLY)
            _locks(handle, wait=True)
            if fresh.exists():
                return fresh, handle
            os.close(handle)


def old_name(fresh: Path) -> Path:
    """How the folder is called that a temporary one replaces, for as long as that takes."""
    return fresh.with_name(fresh.name.removesuffix(SUFFIX) + OLD_SUFFIX)


def remove_dangling(path: Path) -> None:
    """Remove what killed runs left beside an output; a folder that one had moved aside comes back."""
    ours = re.compile(rf"{re.escape(_prefix(path))}[a-z0-9_]{{8}}({SUFFIX}|{OLD_SUFFIX})")
    try:
        with os.scandir(path.parent) as entries:
            left = [Path(e.path) for e in entries if ours.fullmatch(e.name)]
    except OSError:
        return
    for old in (p for p in left if p.name.endswith(OLD_SUFFIX)):
        fresh = old.with_name(old.name.removesuffix(OLD_SUFFIX) + SUFFIX)
        if not _in_use(fresh) and not path.exists():
            with suppress(OSError):
                old.rename(path)
        elif not _in_use(fresh):
            shutil.rmtree(old, ignore_errors=True)
    for fresh in (p for p in left if p.name.endswith(SUFFIX)):
        _in_use(fresh, remove=True)


def discard(temporary: Path) -> None:
    """Remove a temporary file or folder, if it is there."""
    if temporary.is_dir():
        shutil.rmtree(temporary, ignore_errors=True)
    else:
        with suppress(OSError):
            temporary.unlink(missing_ok=True)


def _prefix(path: Path) -> str:
    return f".{os.fsdecode(os.fsencode(path.name)[:MAX_NAME_BYTES])}."


def _in_use(temporary: Path, remove: bool = False) -> bool:
    """Whether a run that lives writes it, which is taken for granted without locks; else it may be removed, locked."""
    try:
        handle = os.open(temporary, os.O_RDONLY | getattr(os, "O_NOFOLLOW", 0))
    except FileNotFoundError:
        return False
    except OSError:
        return True
    try:
        dangling = _locks(handle)
        if dangling and remove:
            discard(temporary)
        return not dangling
    finally:
        os.close(handle)


def _locks(handle: int, wait: bool = False) -> bool:
    """Lock an open file or folder for this process, if no other has, or when it has no more; a lock ends with its process."""
    try:
        import fcntl
    except ImportError:
        return False
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
    except OSError:
        return False
    return True
