"""What reaches the terminal: texts that it can show, numbers that are some, and one message where a command cannot go on."""

from __future__ import annotations

import json
import math
import os
import re
import shlex
import signal
import sys
import threading
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import Any, NoReturn, TextIO

from kfgen.core.errors import InputError, KfgenError
from kfgen.core.files.destination import reason_of

_CONTROL = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\ud800-\udfff]")
_TEMPORARY = re.compile(r"\.([^/]+)\.[a-z0-9_]{8}\.kfgen(-old)?")


INTERRUPTED = 130
"""Exit status of a command that was ended by Ctrl-C, or by a pipe that was closed."""
COLOURS = {"good": "1;32", "attention": "1;33", "error": "1;31"}
"""What is painted on a terminal, by its sense: green, yellow, red."""


def painted(words: str, sense: str, stream: TextIO) -> str:
    """Words in a colour, where the stream is a terminal that a person looks at; as they are in a file or a pipe.

    Parameters
    ----------
    words : str
    sense : str
        Of `COLOURS`.
    stream : file
        To which they will be written. ``NO_COLOR`` and a terminal that calls itself dumb have no colours.

    Returns
    -------
    str
    """
    plain = os.environ.get("NO_COLOR") or os.environ.get("TERM") == "dumb" or not stream.isatty()
    return words if plain else f"\x1b[{COLOURS[sense]}m{words}\x1b[0m"


def printable(text: str) -> str:
    """A text in which control characters, of a crafted name of a channel for one, are written as their codes."""
    return _CONTROL.sub(lambda m: ascii(m.group())[1:-1], text)


def json_text(data: Any) -> str:
    """An answer as JSON.

    Raises
    ------
    InputError
        A number in it is none, which an answer must not hide.
    """
    for place in _not_finite(data, ""):
        raise InputError(
            f"the answer has a number that is none, {place.lstrip('.')}",
            remedy="Check the units and the sizes of what was given",
        )
    return json.dumps(data, indent=1, allow_nan=False)


def _not_finite(data: Any, place: str) -> Iterator[str]:
    if isinstance(data, float) and not math.isfinite(data):
        yield place
    elif isinstance(data, dict):
        for key, value in data.items():
            yield from _not_finite(value, f"{place}.{key}")
    elif isinstance(data, list | tuple):
        for k, value in enumerate(data):
            yield from _not_finite(value, f"{place}[{k}]")


def catch_signals() -> None:
    """Let SIGTERM and SIGHUP end the command as Ctrl-C does: what is half written is removed."""
    for name in ("SIGTERM", "SIGHUP"):
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), _end)


@contextmanager
def first_interrupt(search_ends: Callable[[], bool]) -> Iterator[None]:
    """Ask what is called whether it takes a Ctrl-C; the command ends at once where it does not.

    Parameters
    ----------
    search_ends : callable
        Called in the signal's handler, in the main thread.
    """

    def handle(number: int, frame: FrameType | None) -> None:
        if not search_ends():
            raise KeyboardInterrupt

    if threading.current_thread() is not threading.main_thread():  # only the main one is told of signals
        yield
        return
    before = signal.signal(signal.SIGINT, handle)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def _end(number: int, _: FrameType | None) -> NoReturn:
    raise SystemExit(128 + number)


def ending_of(error: BaseException) -> tuple[int, str]:
    """The exit status of a command that met an error, and its one message for standard error; empty where the user
    asked for the end.

    A defect is said as such, with its place; ``KFGEN_TRACEBACK=1`` shows all of it.
    """
    status, message = _ending_of(error)
    name, colon, said = message.partition(": ")
    return status, painted(name + colon.strip(), "error", sys.stderr) + colon[1:] + said if colon else message


def _ending_of(error: BaseException) -> tuple[int, str]:
    if isinstance(error, KfgenError):
        return error.exit_status, printable(f"kfgen: {error}")
    if isinstance(error, BrokenPipeError | KeyboardInterrupt):
        return INTERRUPTED, ""
    if isinstance(error, MemoryError):
        return 2, "kfgen: there is not enough memory. Cut the log, or give fewer channels"
    if isinstance(error, OSError):
        return 2, printable(f"kfgen: {_of_system(error)}")
    if os.environ.get("KFGEN_TRACEBACK"):
        return 2, "".join(traceback.format_exception(error)).rstrip()
    frame = traceback.extract_tb(error.__traceback__)[-1]
    words = " ".join(f"{type(error).__name__}: {error}".split())[:200]
    place = f"{os.path.basename(frame.filename)}, line {frame.lineno}"
    return 2, printable(
        f"kfgen: this input meets a defect of kfgen ({words}; {place}). "
        "Report it with the command and its files; KFGEN_TRACEBACK=1 shows more"
    )


def _of_system(error: OSError) -> str:
    """What the system refused, about which file, without numbers and names of temporary files."""
    name = _TEMPORARY.sub(r"\1", os.fsdecode(error.filename)) if error.filename else ""
    where = f"{name}: " if name else ""
    return f"{where}the system refuses it: {reason_of(error)}. Check the path, its permissions and the space on the disk"


def command_line() -> str:
    """The command that runs, as it would be typed; empty in a program that uses kfgen."""
    name = Path(sys.argv[0]) if sys.argv else Path()
    is_command = name.stem == "kfgen" or name.parts[-2:] == ("kfgen", "__main__.py")
    return printable(shlex.join(["kfgen", *sys.argv[1:]])) if is_command else ""
