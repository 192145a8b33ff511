"""Tables that a benchmark writes into a page of the documentation, between two marks that bear its name."""

from __future__ import annotations

import re
from pathlib import Path

DOCS = Path(__file__).parents[1] / "docs"


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
