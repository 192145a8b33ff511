"""The errors that a user can meet, each with a place and a remedy.

Each says what is wrong, where, and what to do about it. The command line prints
that as one message and turns the class into an exit status; nothing else is ever
shown to a user for a bad file.
"""

from __future__ import annotations


class KfgenError(Exception):
    """An error with a place and a remedy.

    Parameters
    ----------
    what : str
        What is wrong.
    where : str
        File, line, column or channel; empty when the command itself is the place.
    remedy : str
        What the user can do.
    """

    exit_status = 2

    def __init__(self, what: str, *, where: str = "", remedy: str = "") -> None:
        self.what = what
        self.where = where
        self.remedy = remedy
        super().__init__(str(self))

    def __str__(self) -> str:
        text = f"{self.where}: {self.what}" if self.where else self.what
        return f"{text}. {self.remedy}" if self.remedy else text


class InputError(KfgenError):
    """A file, a channel, an option or a unit that cannot be used as it is."""


class MissingExtra(KfgenError):
    """An optional library that this command needs is not installed."""


class CheckFailed(KfgenError):
    """A check ran and failed: a word differs, a tolerance is exceeded."""

    exit_status = 1
