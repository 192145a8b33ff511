"""Reads a log in a .zip: one file, or a folder of EuRoC, phyphox or ROS 2.

The content is written to a temporary folder piece by piece; names that lead out of it and what grows beyond all measure are
refused.
"""

from __future__ import annotations

import stat
import tempfile
import zipfile
from collections.abc import Callable
from pathlib import Path, PurePosixPath

from kfgen.core.errors import InputError
from kfgen.log.readers.packed.compressed import Found, checked_growth, named_as
from kfgen.log.readers.tables.library import reading

SUFFIXES = (".zip",)
LEFT_OUT = ("__MACOSX",)
"""Folders of archives that hold nothing of the log."""
MOST_FILES = 10_000


def inside(path: Path, use: Callable[[Path], Found]) -> Found:
    """What is made of the content of an archive; messages and the result name the archive.

    Parameters
    ----------
    path : Path
        The archive.
    use : callable
        From the path of the content to what is wanted; it must not need the content afterwards.

    Returns
    -------
    Found

    Raises
    ------
    InputError
        It is damaged, or its content is no log that is known.
    """
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        content = Path(folder) / "content"
        content.mkdir()
        with reading("zip archive", path, "Copy the file again"), zipfile.ZipFile(path) as archive:
            _unpack(path, archive, content)
        while len(inner := list(content.iterdir())) == 1 and content.parent != inner[0]:
            content = inner[0]
            if content.is_file():
                break
        return named_as(path, content, use)


def _unpack(path: Path, archive: zipfile.ZipFile, folder: Path) -> None:
    """The files of an archive in a folder; no link, no name outside it."""
    members = [m for m in archive.infolist() if not m.is_dir()]
    members = [m for m in members if PurePosixPath(m.filename).parts[0] not in LEFT_OUT]
    if not members or len(members) > MOST_FILES:
        raise InputError(f"it has {len(members)} files", where=str(path), remedy="Unpack it yourself")
    written = 0
    for member in members:
        name = PurePosixPath(member.filename)
        if name.is_absolute() or ".." in name.parts or stat.S_ISLNK(member.external_attr >> 16):
            raise InputError(
                f"the name '{member.filename}' in it leads out of it",
                where=str(path),
                remedy="Unpack it yourself",
            )
        target = folder / name
        target.parent.mkdir(parents=True, exist_ok=True)
        with archive.open(member) as content, target.open("wb") as out:
            written = checked_growth(path, content, out, written)
