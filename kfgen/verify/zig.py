"""The cross compiler from the package index: clang inside zig."""

from __future__ import annotations

import importlib.util
import os
import sys
import tempfile
from pathlib import Path

from kfgen.core.errors import MissingExtra


def command(language: str = "cc") -> list[str]:
    """How zig's compiler is called, ``cc`` or ``c++``.

    Raises
    ------
    MissingExtra
        The extra ``pil`` is not installed.
    """
    if importlib.util.find_spec("ziglang") is None:
        raise MissingExtra(
            "the cross compiler (ziglang) is not installed",
            remedy="Install it with: pip install 'kfgen[pil]'",
        )
    return [sys.executable, "-m", "ziglang", language]


def environment() -> dict[str, str]:
    """Its environment: a cache of its own where the machine has no home to write to."""
    env = dict(os.environ)
    if not os.access(Path(env.get("HOME") or "/nonexistent"), os.W_OK):
        env.setdefault("ZIG_GLOBAL_CACHE_DIR", str(Path(tempfile.gettempdir()) / "kfgen-zig-cache"))
    return env
