"""Reads the TOML of kfgen's own files (noise, model, filter, manoeuvre) and checks their format."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

from kfgen.core.errors import InputError


def text_of(path: str | Path) -> str:
    """The text of a file.

    Raises
    ------
    InputError
        No such file, or no text.
    """
    path = Path(path)
    if not path.is_file():
        raise InputError("no such file", where=str(path))
    try:
        return path.read_text(encoding="utf-8")
    except UnicodeDecodeError as error:
        raise InputError(f"it is no text: {error}", where=str(path)) from None


def document_of(text: str, path: str, format: str, kind: str) -> dict[str, Any]:
    """The tables of a text, nothing of which is executed.

    Parameters
    ----------
    text : str
        The whole file.
    path : str
        The file's name, for error messages.
    format : str
        What its key ``format`` must be: ``"kfgen-noise-1"``.
    kind : str
        How such a file is called in messages: ``"noise"``.

    Returns
    -------
    dict
        As `tomllib.loads` gives it.

    Raises
    ------
    InputError
        No TOML, or another format.
    """
    try:
        document = tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # also numbers too long, nests too deep
        raise InputError(f"it is no TOML: {error}", where=path) from None
    if document.get("format") != format:
        raise InputError(
            f"its format is {document.get('format')!r}",
            where=path,
            remedy=f'A {kind} file begins with format = "{format}"',
        )
    return document
