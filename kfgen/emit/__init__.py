"""Emission: a discrete model as code.

A target is one module of `kfgen.emit.targets` with ``TARGET`` and ``files(program)``, and one folder of
templates; `targets` finds it.
"""

from __future__ import annotations

import importlib
import pkgutil
from functools import cache
from types import ModuleType

from kfgen.emit import targets as package


@cache
def targets() -> dict[str, ModuleType]:
    """The emit targets by name, from every module of this package that declares one."""
    found: dict[str, ModuleType] = {}
    for info in pkgutil.iter_modules(package.__path__):
        module = importlib.import_module(f"{package.__name__}.{info.name}")
        if hasattr(module, "TARGET"):
            found[module.TARGET] = module
    return found
