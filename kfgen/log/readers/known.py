"""Which reader reads a log: found by how the file begins, by its suffix, or by what is in a folder."""

from __future__ import annotations

import hashlib
import importlib
import pkgutil
from functools import cache
from pathlib import Path
from types import ModuleType

import kfgen.log.readers as package
from kfgen.core.errors import InputError
from kfgen.core.optional_library import modules_of_others

MAGIC_BYTES = 16
"""Bytes at the beginning of a file by which its format may be known."""
READ_BLOCK_BYTES = 1 << 20
"""Bytes of a file that are looked at in one piece."""


@cache
def modules() -> tuple[ModuleType, ...]:
    """The modules in the folders of readers, and those of other packages."""
    inner = pkgutil.walk_packages(package.__path__, f"{package.__name__}.")
    own = (importlib.import_module(i.name) for i in inner if not i.ispkg and i.name != __name__)
    return (*own, *modules_of_others("readers"))


@cache
def readers() -> dict[str, ModuleType]:
    """The reader of each file suffix."""
    return {suffix: m for m in modules() for suffix in getattr(m, "SUFFIXES", ())}


@cache
def folder_readers() -> tuple[ModuleType, ...]:
    """The readers of logs that are folders."""
    return tuple(m for m in modules() if hasattr(m, "parts"))


def reader_of(path: Path) -> ModuleType:
    """The reader of a file, by how it begins, else by its suffix; or of a folder, by what is in it.

    Raises
    ------
    InputError
        There is no such file, or no reader of it.
    """
    if path.is_dir():
        return _of_folder(path)
    if not path.is_file():
        raise InputError("no such file", where=str(path), remedy="Check the path")
    with path.open("rb") as file:
        head = file.read(MAGIC_BYTES)
    known = (m for m in readers().values() if getattr(m, "MAGIC", ()) and head.startswith(m.MAGIC))
    reader = next(known, None) or readers().get(path.suffix.lower())
    if reader is None:
        raise InputError(
            f"files with the ending '{path.suffix}' cannot be read",
            where=str(path),
            remedy=f"Supported are {', '.join(sorted(readers()))}",
        )
    return reader


def _of_folder(path: Path) -> ModuleType:
    reader = next((m for m in folder_readers() if m.parts(path)), None)
    if reader is None:
        raise InputError(
            "the folder holds no log that is known",
            where=str(path),
            remedy=f"Known are {'; '.join(m.FOLDER for m in folder_readers())}; or give one file of it",
        )
    return reader


def is_log(path: Path) -> bool:
    """Whether a path is a file, or a folder that is a log."""
    return path.is_file() or (path.is_dir() and any(m.parts(path) for m in folder_readers()))


def sha256_of(path: Path) -> str:
    """The hash of a log: of a file, or of the files of a folder that are read, each with its name.

    Raises
    ------
    InputError
        There is nothing in it.
    """
    parts = reader_of(path).parts(path) if path.is_dir() else [path]
    hashes = [(str(part.relative_to(path)), _sha256(part)) for part in parts]
    if not any(sha for _, sha in hashes):
        raise InputError("the file is empty", where=str(path), remedy="Give a log with samples")
    if path.is_file():
        return hashes[0][1]
    return hashlib.sha256("\n".join(f"{sha} {name}" for name, sha in sorted(hashes)).encode()).hexdigest()


def _sha256(path: Path) -> str:
    """The hash of a file; empty where nothing is in it but blanks."""
    with path.open("rb") as file:
        if not any(block.strip() for block in iter(lambda: file.read(READ_BLOCK_BYTES), b"")):
            return ""
        file.seek(0)
        return hashlib.file_digest(file, "sha256").hexdigest()
