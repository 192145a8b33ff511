"""`Result`: what every verb gives back, and how it is shown: a few lines, a short table, the JSON, pictures."""

from __future__ import annotations

import importlib
from collections.abc import Sequence
from html import escape
from typing import Any

from kfgen.core.optional_library import optional_library

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
        """The lines of the summary and the short table, for a notebook; it asks for nothing beside itself."""
        head, rows = self.short_table()
        lines = "".join(f"<p>{escape(line)}</p>" for line in repr(self).splitlines())
        return lines + _html_table(head, rows) if rows else lines

    def to_frame(self) -> Any:
        """The short table as a data frame of pandas; a column of nothing but numbers holds numbers.

        Returns
        -------
        pandas.DataFrame
            A row for each row of the table, a column for each head; empty where there is no table.

        Raises
        ------
        MissingExtra
            pandas is not installed.
        """
        pandas = optional_library("pandas", "pandas", "data frames are made by")
        head, rows = self.short_table()
        columns = {name: _numbers_or_texts([row[k] for row in rows]) for k, name in enumerate(head)}
        return pandas.DataFrame(columns)

    def plot(self) -> list[Any]:
        """The pictures of the report on axes of matplotlib, which a notebook shows by itself.

        Returns
        -------
        list of matplotlib.axes.Axes
            Of one figure of pyplot or more, in order.

        Raises
        ------
        InputError
            There is no picture of this kind of result, or nothing to show in this one.
        """
        # By name, for the report stands above every layer and is the only one that draws.
        opened: list[Any] = importlib.import_module("kfgen.report.figures.pictures").opened(self)
        return opened


def _html_table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table of escaped texts."""
    lines = ["".join(f"<th>{escape(h)}</th>" for h in head)]
    lines += ["".join(f"<td>{escape(c)}</td>" for c in row) for row in rows]
    return f"<table>{''.join(f'<tr>{line}</tr>' for line in lines)}</table>"


def _numbers_or_texts(cells: Sequence[str]) -> list[float] | list[int] | list[str]:
    """Cells as numbers, where each of them is one."""
    for kind in (int, float):
        try:
            return [kind(c) for c in cells]
        except ValueError:
            continue
    return list(cells)
