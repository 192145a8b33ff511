"""The effect that a Python file declares, kept out of the catalogue until it is tried."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path

from kfgen.core.errors import InputError
from kfgen.effects import Effect, catalogue, on_trial


def declared_in(file: str | Path) -> type[Effect]:
    """The one effect that a file declares. The file is executed, as any Python that is named on a command line.

    Parameters
    ----------
    file : str or Path
        Python with a subclass of `kfgen.effects.Effect` that has a name.

    Raises
    ------
    InputError
        The file cannot be imported, declares no effect or several, or one whose name the catalogue has.
    """
    path = Path(file)
    known = catalogue()
    name = f"_kfgen_on_trial_{path.stem}_{len(sys.modules)}"
    spec = importlib.util.spec_from_file_location(name, path) if path.suffix == ".py" else None
    if spec is None or spec.loader is None or not path.is_file():
        raise InputError(
            "there is no such Python file", where=str(file), remedy="Give the .py file of a declaration"
        )
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module  # dataclasses look up their module
    try:
        spec.loader.exec_module(module)
    except Exception as error:  # whatever a user's file does
        _withdraw(name)
        raise InputError(
            f"the declaration cannot be imported ({type(error).__name__}: {error})".split("\n")[0],
            where=str(file),
            remedy="See 'A new effect' in docs/gap.md for what an effect says of itself",
        ) from error
    found = _withdraw(name)
    if len(found) != 1:
        names = ", ".join(c.name for c in found) or "none"
        raise InputError(
            f"the file declares not one effect: {names}",
            where=str(file),
            remedy="Give a file with one named effect",
        )
    if found[0].name in known:
        raise InputError(
            f"the catalogue has an effect {found[0].name}",
            where=str(file),
            remedy="Give the declaration another name",
        )
    return found[0]


def _withdraw(module: str) -> list[type[Effect]]:
    """Take what a module declared out of the catalogue, and say what it was."""
    queue, found = list(Effect.__subclasses__()), list[type[Effect]]()
    while queue:
        cls = queue.pop(0)
        queue.extend(cls.__subclasses__())
        if cls.name and cls.__module__ == module and cls not in found:
            found.append(cls)
            on_trial(cls)
    return found
