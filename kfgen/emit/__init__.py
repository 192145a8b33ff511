"""Emission: a discrete model as code.

A target is one module of `kfgen.emit.targets` with ``TARGET`` and ``files(program)``, and one folder of
templates; `targets` finds it.
"""

from __future__ import annotations

import importlib
import pkgutil
from functools import cache
from types import ModuleType

from kfgen.core.optional_library import modules_of_others
from kfgen.emit import targets as package


@cache
def targets() -> dict[str, ModuleType]:
    """The emit targets by name, from every module of this package or of another that declares one."""
    inner = pkgutil.iter_modules(package.__path__)
    own = (importlib.import_module(f"{package.__name__}.{info.name}") for info in inner)
    return {m.TARGET: m for m in (*own, *modules_of_others("targets")) if hasattr(m, "TARGET")}
