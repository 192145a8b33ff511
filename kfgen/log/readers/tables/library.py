"""Optional libraries that read formats: imported late, missing or upset by a broken file with one message each."""

from __future__ import annotations

import importlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from kfgen.core.errors import InputError, KfgenError, MissingExtra


def optional_library(module: str, extra: str, what: str, path: Path) -> Any:
    """A library that only one format needs.

    Parameters
    ----------
    module : str
        Its name for Python: ``rosbags.rosbag1``.
    extra : str
        The extra of kfgen that installs it.
    what : str
        What it reads, as the beginning of a sentence: ``ROS bags are``.
    path : Path
        The file, for the message.

    Returns
    -------
    module

    Raises
    ------
    MissingExtra
        It is not installed.
    """
    try:
        return importlib.import_module(module)
    except ImportError:
        raise MissingExtra(
            f"{what} read by {module.partition('.')[0]}, which is not installed",
            where=str(path),
            remedy=f'Install it with: pip install "kfgen[{extra}]"',
        ) from None


@contextmanager
def reading(what: str, path: Path, remedy: str) -> Iterator[None]:
    """Whatever a broken file leads to in a library, as one message.

    Parameters
    ----------
    what : str
        What the file should be: ``HDF5 file``.
    path : Path
    remedy : str

    Returns
    -------
    context manager

    Raises
    ------
    InputError
        The library raised; errors of kfgen itself pass.
    """
    try:
        yield
    except KfgenError:
        raise
    except Exception as error:  # each library has errors of its own
        first = (str(error).strip() or "cut off").splitlines()[0]
        raise InputError(
            f"it is no {what} that can be read ({first})", where=str(path), remedy=remedy
        ) from None
