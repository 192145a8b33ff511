"""`Destination`: where an output goes: a file, links followed; or a device or a pipe, which is written as it is."""

from __future__ import annotations

import os
import re
import shutil
import stat
import sys
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

from kfgen.core.errors import InputError
from kfgen.core.files.temporary import discard, old_name, temporary_file

_OPEN_FILE = re.compile(r"/dev/(stdout|stderr|fd/(\d+))|/proc/self/fd/(\d+)")


@dataclass(frozen=True)
class Destination:
    """Where an output goes.

    Parameters
    ----------
    named : Path
        As it was asked for, for messages.
    path : Path
        With links followed.
    stream : bool
        Whether it is a device, a pipe or an open file: written as it is, never replaced.
    mode : int or None
        Permissions of the file that is there; None where there is none.
    """

    named: Path
    path: Path
    stream: bool = False
    mode: int | None = None

    @staticmethod
    def of(path: str | Path) -> Destination:
        """The destination that a path names."""
        named = Path(path)
        if _OPEN_FILE.fullmatch(str(named)):
            return Destination(named, named, stream=True)
        try:
            there = named.stat()
        except (OSError, ValueError):
            return Destination(named, Path(os.path.realpath(named)))
        if stat.S_ISREG(there.st_mode) or stat.S_ISDIR(there.st_mode):
            return Destination(named, Path(os.path.realpath(named)), False, stat.S_IMODE(there.st_mode))
        return Destination(named, named, stream=True)

    @property
    def identity(self) -> tuple[object, ...]:
        """Equal for two names of one file, whether it is there or not."""
        try:
            there = self.path.stat()
        except (OSError, ValueError):
            return ("name", str(self.path))
        return ("file", there.st_dev, there.st_ino)

    def check(self, folder: bool = False) -> None:
        """Prove that it can be written, without writing it.

        Parameters
        ----------
        folder : bool
            Whether a folder is to be written, which may lie in folders that are made first.

        Raises
        ------
        InputError
            No folder to be in, a folder in its place, no permission, a name that cannot be, no space.
        """
        if self.stream and not folder:
            self._check_stream()
            return
        self._check_name()
        if folder:
            check_folder(self.path, self.named)
        elif os.path.isdir(self.path):
            raise InputError(
                "the output is a folder", where=str(self.named), remedy="Give the name of a file in it"
            )
        parent = self._parent(folder)
        if not os.access(self.path if os.path.exists(self.path) else parent, os.W_OK):
            raise self.unwritable("you have no permission to write it")
        try:
            trial, handle = temporary_file(parent / self.path.name)
        except (OSError, ValueError) as error:
            raise self.unwritable(reason_of(error)) from None
        os.close(handle)
        discard(trial)

    def _check_name(self) -> None:
        """A name that the system does not allow, or a link that leads to itself, is one for no file."""
        try:
            self.named.stat()
        except (FileNotFoundError, NotADirectoryError):
            return
        except (OSError, ValueError) as error:
            raise self.unwritable(reason_of(error)) from None

    def _check_stream(self) -> None:
        """A disk is not overwritten, and a device or a pipe needs permission."""
        if self.path.is_block_device():
            raise self.unwritable("it is a disk")
        if self.path.exists() and not os.access(self.path, os.W_OK):
            raise self.unwritable("you have no permission to write it")

    def _parent(self, folder: bool) -> Path:
        """The folder in which it is written, or the nearest that is there."""
        parent = self.path.parent
        while folder and not parent.exists() and parent != parent.parent:
            parent = parent.parent
        if not parent.is_dir():
            raise InputError(
                "the folder of the output does not exist",
                where=str(self.named),
                remedy=f"Make {parent} first",
            )
        return parent

    def unwritable(self, why: str) -> InputError:
        """The error that it cannot be written, and why."""
        return InputError(
            f"the output cannot be written: {why}",
            where=str(self.named),
            remedy="Give another name, or a folder that can be written",
        )

    def take(self, temporary: Path) -> None:
        """Make a finished temporary file or folder the output, with the permissions of what it replaces."""
        if self.stream:
            with temporary.open("rb") as made, self._opened() as stream:
                shutil.copyfileobj(made, stream)
            discard(temporary)
            return
        folder = temporary.is_dir()
        umask = os.umask(0)
        os.umask(umask)
        if self.mode is not None:
            there = self.path.stat()
            with suppress(OSError, AttributeError):
                os.chown(temporary, there.st_uid, there.st_gid)
        temporary.chmod((0o777 if folder else 0o666) & ~umask if self.mode is None else self.mode)
        if folder and self.path.exists():
            self._exchange(temporary)
        else:
            temporary.replace(self.path)

    def _exchange(self, temporary: Path) -> None:
        """Put a folder in the place of another, which comes back where that fails."""
        old = old_name(temporary)
        self.path.rename(old)
        try:
            temporary.rename(self.path)
        except BaseException:
            old.rename(self.path)
            raise
        shutil.rmtree(old, ignore_errors=True)

    def _opened(self) -> BinaryIO:
        """The device or pipe, opened for writing; an open file of this process goes on where it is."""
        match = _OPEN_FILE.fullmatch(str(self.named))
        if match is None:
            return self.path.open("wb")
        sys.stdout.flush()
        number = match.group(2) or match.group(3) or {"stdout": "1", "stderr": "2"}[match.group(1)]
        return os.fdopen(os.dup(int(number)), "wb")


def check_folder(path: Path, named: Path) -> None:
    """Refuse what is there and no folder, as the place of one.

    Parameters
    ----------
    path : Path
        With links followed.
    named : Path
        As it was asked for, for the message.

    Raises
    ------
    InputError
        It is a file, a device or a pipe.
    """
    if path.exists() and not path.is_dir():
        raise InputError(
            "it is no folder", where=str(named), remedy="Give the name of a folder, which may be a new one"
        )


def reason_of(error: BaseException) -> str:
    """Why the system refused, in its words without numbers and names of temporary files."""
    text = getattr(error, "strerror", None) or str(error).partition(":")[0] or type(error).__name__
    return str(text)[:1].lower() + str(text)[1:]
