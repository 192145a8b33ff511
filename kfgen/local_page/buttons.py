"""What the buttons of the page run: commands of the command line, with the files that they write."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from kfgen.core.errors import InputError
from kfgen.local_page.work_folder import WorkFolder
from kfgen.model.library import LIBRARY

LONGEST_TEXT = 2000
_CHANNELS = re.compile(r"[\w.,\[\] /-]{1,400}")
Given = Mapping[str, object]


@dataclass(frozen=True)
class ButtonCommand:
    """A command as it is typed in its folder.

    Parameters
    ----------
    words : tuple of str
        After ``kfgen``.
    writes : tuple of str
        Files and folders that it writes.
    """

    words: tuple[str, ...]
    writes: tuple[str, ...]


def command_of(given: Given, folder: WorkFolder) -> ButtonCommand:
    """The command of a button, from what the page sends.

    Parameters
    ----------
    given : mapping
        ``action`` and its fields: ``log``, ``model`` and ``noise`` are keys of files, a model also a name of the
        library; ``channels``, ``rate`` and ``columns`` as on the command line.
    folder : WorkFolder

    Returns
    -------
    ButtonCommand

    Raises
    ------
    InputError
        There is no such action, file, or model, or a field is not what it should be.
    """
    action = str(given.get("action", ""))
    if action not in ACTIONS:
        raise InputError(f"there is no action '{action[:40]}'", remedy=f"Known are {', '.join(ACTIONS)}")
    made = ACTIONS[action](given, folder)
    return ButtonCommand(
        (*made.words, "--report=report.html", "--json=answer.json"),
        (*made.writes, "report.html", "answer.json"),
    )


def _contents(given: Given, folder: WorkFolder) -> ButtonCommand:
    return ButtonCommand(("list", _log(given, folder), *_reading(given)), ())


def _identify(given: Given, folder: WorkFolder) -> ButtonCommand:
    words = ("identify", _log(given, folder), *_reading(given), *_channels(given), "--output=noise.toml")
    return ButtonCommand(words, ("noise.toml",))


def _gap(given: Given, folder: WorkFolder) -> ButtonCommand:
    model = f"--model={_model(given, folder)}"
    words = ("gap", _log(given, folder), model, *_reading(given), *_channels(given), "--output=improved.toml")
    return ButtonCommand(words, ("improved.toml",))


def _audit(given: Given, folder: WorkFolder) -> ButtonCommand:
    return ButtonCommand(("audit", _model(given, folder), *_noise(given, folder)), ())


def _emit(given: Given, folder: WorkFolder) -> ButtonCommand:
    words = ("emit", _model(given, folder), "--target=c", *_noise(given, folder), "--output=filter")
    return ButtonCommand(words, ("filter",))


ACTIONS: Mapping[str, Callable[[Given, WorkFolder], ButtonCommand]] = {
    "list": _contents,
    "identify": _identify,
    "audit": _audit,
    "gap": _gap,
    "emit": _emit,
}
"""By the name of their command."""


def _path(key: object, folder: WorkFolder) -> str:
    """A file, as it is named from the folder of a command."""
    return f"../{folder.find(key).key}"


def _log(given: Given, folder: WorkFolder) -> str:
    return _path(given.get("log"), folder)


def _model(given: Given, folder: WorkFolder) -> str:
    """A name of the library, or a file of the page."""
    name = str(given.get("model") or "")
    if name in LIBRARY:
        return name
    if not name:
        raise InputError("no model is chosen", remedy=f"Choose one of {', '.join(LIBRARY)}, or a file")
    return _path(name, folder)


def _noise(given: Given, folder: WorkFolder) -> tuple[str, ...]:
    return (f"--noise={_path(given['noise'], folder)}",) if given.get("noise") else ()


def _channels(given: Given) -> tuple[str, ...]:
    text = str(given.get("channels") or "").strip()
    if text and not _CHANNELS.fullmatch(text):
        raise InputError("these are no names of channels", where="channels", remedy="Separate them by commas")
    return (f"--channels={text}",) if text else ()


def _reading(given: Given) -> tuple[str, ...]:
    """How the log is read: rate and columns."""
    words: list[str] = []
    text = str(given.get("rate") or "").strip()
    if text:
        try:
            rate = float(text)
        except ValueError:
            rate = math.nan
        if not 0.0 < rate < math.inf:
            raise InputError("the rate must be positive", where="rate", remedy="Give it in hertz")
        words.append(f"--rate={rate:.17g}")
    columns = str(given.get("columns") or "").strip().removeprefix("--columns").strip().strip("'\"")
    if len(columns) > LONGEST_TEXT or not columns.isprintable():
        raise InputError(
            "the map of columns cannot be read", where="columns", remedy="Write 'gyro_x=gx [deg/s]'"
        )
    return (*words, f"--columns={columns}") if columns else tuple(words)
