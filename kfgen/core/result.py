"""`Result`: what every verb gives back, and how it is shown: a few lines, a short table, the JSON, a picture."""

from __future__ import annotations

import importlib
from collections.abc import Sequence
from html import escape
from typing import Any

ShortTable = tuple[Sequence[str], Sequence[Sequence[str]]]
"""Heads of the columns, and rows of texts."""


class Result:
    """The base of frozen results; a subclass is a dataclass with ``frozen=True, repr=False``."""

    def to_dict(self) -> dict[str, Any]:
        """The JSON of the command of the same name: numbers in SI or with their unit beside them."""
        raise NotImplementedError

    def summary(self) -> Sequence[str]:
        """One to five lines: what was done, and what came out."""
        raise NotImplementedError

    def short_table(self) -> ShortTable:
        """The main numbers."""
        return (), ()

    def __repr__(self) -> str:
        return "\n".join(self.summary())

    def _repr_html_(self) -> str:
        """The first line and the short table, for a notebook."""
        head, rows = self.short_table()
        title, *rest = (f"<p>{escape(line)}</p>" for line in repr(self).splitlines())
        if not rows:
            return "".join([title, *rest])
        cells = ["".join(f"<th>{escape(h)}</th>" for h in head)]
        cells += ["".join(f"<td>{escape(c)}</td>" for c in row) for row in rows]
        return f"{title}<table>{''.join(f'<tr>{c}</tr>' for c in cells)}</table>"

    def plot(self) -> Any:
        """The picture of the report, `kfgen.report.pictures.Picture`; raises `InputError` where there is none."""
        # By name, for the report stands above every layer and is the only one that draws.
        return importlib.import_module("kfgen.report.pictures").picture_of(self)
