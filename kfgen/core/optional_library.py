"""Optional libraries: imported late, and where one is missing, the extra that installs it is named."""

from __future__ import annotations

import importlib
from typing import Any

from kfgen.core.errors import MissingExtra


def optional_library(module: str, extra: str, what: str, where: str = "") -> Any:
    """A library that only a part of kfgen needs.

    Parameters
    ----------
    module : str
        Its name for Python: ``rosbags.rosbag1``.
    extra : str
        The extra of kfgen that installs it.
    what : str
        What it is for, as the beginning of a sentence that ends with its name: ``ROS bags are read by``.
    where : str
        The file, for the message; empty where there is none.

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
            f"{what} {module.partition('.')[0]}, which is not installed",
            where=where,
            remedy=f'Install it with: pip install "kfgen[{extra}]"',
        ) from None
