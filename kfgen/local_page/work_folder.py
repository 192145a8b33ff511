"""`WorkFolder`: where logs that were dropped and everything that was made of them are kept; nothing is written outside it."""

from __future__ import annotations

import re
from collections.abc import AsyncIterator
from dataclasses import dataclass, field
from pathlib import Path

from kfgen.core.errors import InputError

MOST_BYTES = 2_000_000_000
"""Of one file that is dropped."""
MOST_BYTES_IN_ALL = 20_000_000_000
"""Of all files that are dropped while the page is open."""
LONGEST_NAME = 100
_LETTERS = re.compile(r"[^A-Za-z0-9._-]+")


@dataclass(frozen=True)
class KeptFile:
    """A file of the folder.

    Parameters
    ----------
    key : str
        By which the page names it: ``3/noise.toml``.
    path : Path
    """

    key: str
    path: Path

    @property
    def name(self) -> str:
        """Without its folder."""
        return self.path.name


@dataclass
class WorkFolder:
    """A folder with a numbered folder for each file that was dropped and each command that ran.

    Parameters
    ----------
    root : Path
        Made where it does not exist.
    files : dict of str to KeptFile
        Those of this session, by key.
    """

    root: Path
    files: dict[str, KeptFile] = field(default_factory=dict)
    received: int = 0

    def __post_init__(self) -> None:
        self.root = self.root.absolute()
        try:
            self.root.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise InputError(
                f"the folder cannot be made: {error.strerror}",
                where=str(self.root),
                remedy="Give --folder another",
            ) from None

    def next(self) -> Path:
        """A new numbered folder, after those of earlier sessions."""
        numbers = [int(p.name) for p in self.root.iterdir() if p.name.isdecimal() and len(p.name) < 10]
        number = max(numbers, default=0) + 1
        while True:
            place = self.root / f"{number:03d}"
            try:
                place.mkdir()
                return place
            except FileExistsError:
                number += 1

    def add(self, path: Path) -> KeptFile:
        """A file of one of the numbered folders, known to the page from now on."""
        kept = KeptFile(f"{path.parent.name}/{path.name}", path)
        self.files[kept.key] = kept
        return kept

    def find(self, key: object) -> KeptFile:
        """The file of a key; raises `InputError` for one that the page was not given."""
        kept = self.files.get(str(key))
        if kept is None:
            raise InputError("this file is not on the page", where=str(key)[:80], remedy="Drop it again")
        return kept

    async def receive(self, name: str, body: AsyncIterator[bytes]) -> KeptFile:
        """Keep a file that is sent, whole or not at all.

        Parameters
        ----------
        name : str
            As the sender calls it.
        body : async iterator of bytes

        Returns
        -------
        KeptFile

        Raises
        ------
        InputError
            It is larger than `MOST_BYTES`, or all are larger than `MOST_BYTES_IN_ALL`, or it is empty.
        """
        place = self.next()
        path, size = place / plain_name(name), 0
        try:
            with path.open("xb") as file:
                async for part in body:
                    size += len(part)
                    self.received += len(part)
                    if size > MOST_BYTES or self.received > MOST_BYTES_IN_ALL:
                        raise too_large(path.name)
                    file.write(part)
            if not size:
                raise InputError("the file is empty", where=path.name, remedy="Drop a log with samples")
        except BaseException:
            path.unlink(missing_ok=True)
            place.rmdir()
            self.received -= size
            raise
        return self.add(path)


def too_large(name: str) -> InputError:
    """What is said of a file that is not taken."""
    return InputError(
        f"a file may have {MOST_BYTES / 1e9:g} GB here, and all together {MOST_BYTES_IN_ALL / 1e9:g} GB",
        where=name,
        remedy="Use the command line for it",
    )


def plain_name(name: str) -> str:
    """A name of a file that is one everywhere: letters, digits, dots, dashes; its ending stays.

    Parameters
    ----------
    name : str
        Of any origin: with folders, control characters, leading dots or dashes.

    Returns
    -------
    str
    """
    last = re.split(r"[/\\]", name)[-1]
    safe = _LETTERS.sub("_", last).strip("._-")
    stem, dot, ending = safe.rpartition(".")
    return safe[-LONGEST_NAME:].lstrip("._-") if stem and dot and ending else (safe[:LONGEST_NAME] or "log")
