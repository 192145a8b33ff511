"""What a broken file leads to in a library that reads it, as one message."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from kfgen.core.errors import InputError, KfgenError


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
