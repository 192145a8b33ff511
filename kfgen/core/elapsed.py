"""What a terminal shows while a command works: how long it has, once that is more than a moment.

Nothing is shown where nobody looks: to a file, a pipe, or with ``--quiet``.
"""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import TextIO

SHOWN_AFTER_S = 2.0
"""Time that a command may take before anything is shown [s]."""
EVERY_S = 0.5


class ElapsedTime:
    """A line on a terminal with the time since it began, until it is stopped.

    Parameters
    ----------
    title : str
        What works.
    stream : file
        Of the terminal.
    after_s : float
        When it is shown first [s].
    """

    def __init__(self, title: str, stream: TextIO, after_s: float = SHOWN_AFTER_S) -> None:
        self.title, self.stream, self.after_s = title, stream, after_s
        self.detail = ""
        self._ended = threading.Event()
        self._shown = False
        self._began = time.monotonic()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        wait = self.after_s
        while not self._ended.wait(wait):
            seconds = time.monotonic() - self._began
            more = f", {self.detail}" if self.detail else ""
            self.stream.write(f"\r\x1b[K{self.title}: {seconds:.0f} s{more}")
            self.stream.flush()
            self._shown, wait = True, EVERY_S

    def stop(self) -> None:
        """Take the line away; what is written next begins at the left."""
        if not self._ended.is_set():
            self._ended.set()
            self._thread.join()
            if self._shown:
                self.stream.write("\r\x1b[K")
                self.stream.flush()


_CURRENT: ContextVar[ElapsedTime | None] = ContextVar("elapsed_time", default=None)
_QUIET: ContextVar[bool] = ContextVar("quiet", default=False)


def be_quiet(wanted: bool = True) -> None:
    """Say nothing from now on but answers and errors."""
    _QUIET.set(wanted)


@contextmanager
def elapsed_time(title: str) -> Iterator[None]:
    """Show on a terminal how long what is inside takes.

    Parameters
    ----------
    title : str
        What works: ``kfgen gap``.
    """
    shown = ElapsedTime(title, sys.stderr) if sys.stderr.isatty() and not _QUIET.get() else None
    token = _CURRENT.set(shown)
    try:
        yield
    finally:
        end_elapsed_time()
        _CURRENT.reset(token)


def end_elapsed_time() -> None:
    """Take the line away before something else is written."""
    current = _CURRENT.get()
    if current is not None:
        current.stop()


def count(done: int, of: int) -> None:
    """Say how many of several things are done, beside the time.

    Parameters
    ----------
    done, of : int
    """
    current = _CURRENT.get()
    if current is not None:
        current.detail = f"{done} of {of}"


def warn(words: str) -> None:
    """A warning on standard error, unless nothing is to be said."""
    if not _QUIET.get():
        end_elapsed_time()
        sys.stderr.write(f"warning: {words}\n")
