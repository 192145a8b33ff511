"""Prints the lowest versions that pyproject.toml declares, a requirement a line: ``pip install $(python tools/lowest.py)``.

``python tools/lowest.py test`` adds those of an extra.
"""

from __future__ import annotations

import re
import sys
import tomllib
from pathlib import Path

PYPROJECT = Path(__file__).resolve().parents[1] / "pyproject.toml"


def lowest(extras: list[str]) -> list[str]:
    """``name==floor`` of every dependency, and of the extras."""
    project = tomllib.loads(PYPROJECT.read_text(encoding="utf-8"))["project"]
    declared = list(project["dependencies"])
    for extra in extras:
        declared += project["optional-dependencies"][extra]
    return [re.sub(r">=([\w.]+).*", r"==\1", d) for d in declared if not d.startswith("kfgen")]


if __name__ == "__main__":
    print("\n".join(lowest(sys.argv[1:])))
