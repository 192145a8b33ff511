"""Tables that a benchmark writes into a page of the documentation, between two marks that bear its name."""

from __future__ import annotations

import os
import platform
import re
import subprocess
from pathlib import Path

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"


def measured_at(load: float) -> str:
    """Commit and machine of a figure, with the load by other work when it began."""
    words = ["git", "rev-parse", "--short", "HEAD"]
    commit = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, check=False).stdout.strip()
    return (
        f"Commit {commit}, {os.cpu_count()} processors ({platform.machine()}) with a load of {load:.1f} by other work at "
        "the start"
    )


def table_of(page: str, name: str) -> str:
    """What stands between the marks of a table.

    Parameters
    ----------
    page : str
        File name in ``docs``.
    name : str
        Of the table.
    """
    text = (DOCS / page).read_text(encoding="utf-8")
    return text.split(f"<!-- table {name} -->")[1].split(f"<!-- end {name} -->")[0]


def write_table(page: str, name: str, text: str) -> Path:
    """Replace what stands between ``<!-- table NAME -->`` and ``<!-- end NAME -->`` of a page.

    Parameters
    ----------
    page : str
        File name in ``docs``.
    name : str
        Of the table.
    text : str
        Markdown, as it shall stand there.

    Raises
    ------
    ValueError
        If the page has no such marks.
    """
    path = DOCS / page
    begin, end = f"<!-- table {name} -->", f"<!-- end {name} -->"
    old = path.read_text(encoding="utf-8")
    pattern = re.compile(f"{re.escape(begin)}.*?{re.escape(end)}", re.DOTALL)
    if len(pattern.findall(old)) != 1:
        raise ValueError(f"{path.name} has no place for the table '{name}': write '{begin}' and '{end}' once")
    path.write_text(pattern.sub(lambda _: f"{begin}\n{text}\n{end}", old), encoding="utf-8")
    return path
