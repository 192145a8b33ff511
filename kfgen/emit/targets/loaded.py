"""EmittedFilter Python, imported."""

from __future__ import annotations

import importlib.util
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path
from types import ModuleType


def imported(path: Path) -> ModuleType:
    """The module of a file, under a name of its own; raises what its import raises."""
    spec = importlib.util.spec_from_file_location(f"kfgen_emitted_{path.stem}", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def beside(path: Path) -> ModuleType:
    """The module of a file that imports others of its folder; raises what its import raises."""
    known = set(sys.modules)
    sys.path.insert(0, str(path.parent))
    try:
        return imported(path)
    finally:
        sys.path.remove(str(path.parent))
        for name in set(sys.modules) - known:
            if getattr(sys.modules[name], "__file__", None) in {str(p) for p in path.parent.glob("*.py")}:
                del sys.modules[name]


def loaded(files: Mapping[str, str]) -> ModuleType:
    """The one module of a Python target, from a scratch folder."""
    ((name, text),) = files.items()
    with tempfile.TemporaryDirectory(prefix="kfgen-loaded-") as folder:
        path = Path(folder) / name
        path.write_text(text, encoding="utf-8")
        return imported(path)
