"""Libraries beside kfgen: optional ones, imported late, and packages that bring effects, sensors, readers or targets.

Where an optional library is missing, the extra that installs it is named. A package brings what it has by an entry point in
the group ``kfgen.effects``, ``kfgen.sensors``, ``kfgen.readers``, ``kfgen.targets`` or ``kfgen.consumers`` that names a module;
what the module declares is then known as kfgen's own is.
"""

from __future__ import annotations

import importlib
from functools import cache
from importlib.metadata import entry_points
from types import ModuleType
from typing import Any

from kfgen.core.errors import InputError, MissingExtra


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


@cache
def modules_of_others(kind: str) -> tuple[ModuleType, ...]:
    """The modules that other packages bring.

    Parameters
    ----------
    kind : str
        ``effects``, ``sensors``, ``readers``, ``targets`` or ``consumers``.

    Returns
    -------
    tuple of module

    Raises
    ------
    InputError
        One of them cannot be imported.
    """
    found = []
    for entry in sorted(entry_points(group=f"kfgen.{kind}"), key=lambda e: e.name):
        try:
            found.append(importlib.import_module(entry.module))
        except Exception as error:  # whatever another package does on import
            package = entry.dist.name if entry.dist else entry.module
            raise InputError(
                f"the {kind} '{entry.name}' of the package {package} cannot be imported "
                f"({type(error).__name__}: {error})",
                remedy=f"Update {package}, or uninstall it",
            ) from error
    return tuple(found)
