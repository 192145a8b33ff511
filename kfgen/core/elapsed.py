"""What a terminal shows while a command works: how long it has, and how long it will, once that is more than a moment.

Nothing is shown where nobody looks: to a file, a pipe, or with ``--quiet``. ``KFGEN_PROGRESS=1`` shows it to a pipe too,
for a program that shows it to a person.
"""

from __future__ import annotations

import os
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from typing import TextIO, TypeVar

from kfgen.core.terminal import painted, printable

Item = TypeVar("Item")

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
        self.details: dict[str, Callable[[], str]] = {}
        self.paces: dict[str, tuple[float, int]] = {}
        self._ended = threading.Event()
        self._shown = False
        self.began = time.monotonic()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        wait = self.after_s
        while not self._ended.wait(wait):
            seconds = time.monotonic() - self.began
            said = [f"{seconds:.0f} s", *(words for of in list(self.details.values()) if (words := of()))]
            self.stream.write(f"\r\x1b[K{self.title}: {', '.join(said)}")
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
    watched = sys.stderr.isatty() or os.environ.get("KFGEN_PROGRESS") == "1"
    shown = ElapsedTime(title, sys.stderr) if watched and not _QUIET.get() else None
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


def count(done: int, of: int, what: str = "logs", alike: bool = True) -> None:
    """Say how many of several things are done, and how long the others take at the pace since the first call.

    Parameters
    ----------
    done, of : int
    what : str
        What they are.
    alike : bool
        Whether they are about the same amount of work: only then is it known how long the others take.
    """
    current = _CURRENT.get()
    if current is None or of < 2:
        return
    now = time.monotonic()
    began, before = current.paces.setdefault(what, (now, done))
    pace = (now - began) / (done - before) if alike and done > before else 0.0

    def words() -> str:
        late = time.monotonic() - now
        left = max(pace * (of - done) - late, pace * (of - done - 1))
        return f"{done} of {of} {what}" + (f", about {left:.0f} s left" if left > 0.5 else "")

    current.details["count"] = words


def counted(items: Sequence[Item], what: str, alike: bool = True) -> Iterator[Item]:
    """The items one after the other, said as `count` does.

    Parameters
    ----------
    items : sequence
    what : str
        What they are.
    alike : bool
        As in `count`.

    Returns
    -------
    iterator
        Of the items.
    """
    for k, item in enumerate(items):
        count(k, len(items), what, alike)
        yield item
        count(k + 1, len(items), what, alike)


def limited(left_s: Callable[[], float]) -> None:
    """Say how much computing a search has left at most; it may end before.

    Parameters
    ----------
    left_s : callable
        Gives what is left now [s].
    """
    current = _CURRENT.get()
    if current is not None:
        current.details["limit"] = lambda: (
            f"at most {left_s():.0f} s of search left" if left_s() > 0.0 else "the search is over"
        )


def warn(words: str) -> None:
    """A warning on standard error, unless nothing is to be said."""
    if not _QUIET.get():
        end_elapsed_time()
        sys.stderr.write(f"{painted('warning:', 'attention', sys.stderr)} {printable(words)}\n")
