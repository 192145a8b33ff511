"""The verbs `load` and `save`: the files that a team keeps under version control, each known by its ``format``."""

from __future__ import annotations

import tomllib
from collections.abc import Callable
from pathlib import Path

from kfgen.core.errors import InputError
from kfgen.core.files.toml_document import text_of
from kfgen.effects.noise_model import FORMAT as NOISE_FORMAT
from kfgen.effects.noise_model import NoiseModel, parse_noise, write_noise
from kfgen.model.filter_file import FORMAT as FILTER_FORMAT
from kfgen.model.filter_file import FilterFile, parse_filter, write_filter
from kfgen.model.plant.file import parse_model, write_model
from kfgen.model.plant.user import FORMAT as MODEL_FORMAT
from kfgen.model.plant.user import UserModel

READERS: dict[str, Callable[[str, str], NoiseModel | FilterFile | UserModel]] = {
    NOISE_FORMAT: parse_noise,
    FILTER_FORMAT: parse_filter,
    MODEL_FORMAT: parse_model,
}
"""What reads the text of a file of each format."""


def load(path: str | Path) -> NoiseModel | FilterFile | UserModel:
    """Read a noise file, a filter file or a model file.

    Parameters
    ----------
    path : path-like
        A TOML file with ``format = "kfgen-noise-1"``, ``"kfgen-filter-1"`` or ``"kfgen-model-1"``.

    Raises
    ------
    InputError
        No such file, no TOML, another format, or an entry that cannot be used.
    """
    text = text_of(path)
    try:
        format = tomllib.loads(text).get("format")
    except (ValueError, RecursionError) as error:
        raise InputError(f"it is no TOML: {error}", where=str(path)) from None
    if format not in READERS:
        raise InputError(
            f"its format is {format!r}", where=str(path), remedy=f"Known are {', '.join(READERS)}"
        )
    return READERS[format](text, str(path))


def save(content: NoiseModel | FilterFile | UserModel, path: str | Path) -> None:
    """Write a noise file, a filter file or a model file, whole or not at all.

    Parameters
    ----------
    content : NoiseModel, FilterFile or UserModel
        As `load` gives it.
    path : path-like
        Where to write; an older file is replaced.

    Raises
    ------
    InputError
        There is no file for such an object.
    """
    if isinstance(content, NoiseModel):
        write_noise(content, path)
    elif isinstance(content, FilterFile):
        write_filter(content, path)
    elif isinstance(content, UserModel):
        write_model(content, path)
    else:
        raise InputError(
            f"there is no file for a {type(content).__name__}",
            remedy="Give a noise model, a filter or a model; kfgen.emit writes a filter, kfgen.write_log a log",
        )
