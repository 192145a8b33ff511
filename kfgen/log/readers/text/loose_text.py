"""Text as people have it: decimal commas, dates, `N/A`, columns of words, `gx:0.1` cells, a last line that is cut off.

It is used where the strict reading of `kfgen.log.readers.text.csv` fails, and gives up where a cell is simply wrong, so that
the place of the wrong cell is still said.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime

import numpy as np
from numpy.typing import NDArray

from kfgen.core.channel_names import some_of
from kfgen.log.readers.arrays.array_names import is_time

Array = NDArray[np.float64]

MISSING = frozenset(("", "n/a", "na", "nan", "null", "none", "nil", "-", "--", "---", "#n/a", "?"))
"""Cells, in small letters, that are samples that were not recorded."""
LOOKED_AT = 500
"""Rows by which separator and columns are judged."""
NUMERIC_SHARE = 0.9
"""Share of cells that are numbers or missing in a column of numbers."""
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?$|[+-]?inf$")
_COMMA = re.compile(r"[+-]?\d*,\d+([eE][+-]?\d+)?$|[+-]?\d+$")
_DATE = re.compile(r"\d{4}[-/]\d\d[-/]\d\d[T ]\d\d:\d\d")
_ZONE = re.compile(r":\d\d(\.\d+)?(Z|[+-]\d\d:?\d\d)$")
_KEYED = re.compile(r"\s*([A-Za-z_][\w.]*)\s*[:=]\s*(\S+)\s*$")


@dataclass(frozen=True)
class LooseText:
    """What was found in a text.

    Parameters
    ----------
    header : sequence of str
        Cells of the header; ``#1``, ``#2`` where there is none.
    header_line : int
        Index of its line.
    values : ndarray, shape (n, k)
        Numbers; seconds since 1970 of dates; not numbers where there is none, and in columns of words.
    words : frozenset of int
        Columns of words.
    dates : frozenset of int
        Columns of dates.
    said : tuple of str
        What was done.
    """

    header: Sequence[str]
    header_line: int
    values: Array
    words: frozenset[int]
    dates: frozenset[int]
    said: tuple[str, ...]


def loose_text(lines: Sequence[str], complete: bool) -> LooseText | None:
    """Read a text loosely; None where it cannot be read so.

    Parameters
    ----------
    lines : sequence of str
        Of the file.
    complete : bool
        Whether the last line is ended: one that is not may be cut off.

    Returns
    -------
    LooseText or None
    """
    filled = [(k, line) for k, line in enumerate(_without_comments(lines)) if line.strip()]
    ways = [
        found
        for separator in (";", "\t", ",", "")
        if (found := _split(filled, separator, complete)) is not None
    ]
    return max(ways, key=lambda w: w[0])[1] if ways else None


def _without_comments(lines: Sequence[str]) -> list[str]:
    """The lines, comments empty; one with as many cells as the row that follows it is a header, as of ``rostopic echo -p``."""
    out = ["" if line.lstrip()[:1] in ("#", "%") else line for line in lines]
    first = next((k for k, line in enumerate(out) if line.strip()), 0)
    above = lines[first - 1].lstrip("#% ") if first else ""
    if any(above.count(s) and above.count(s) == out[first].count(s) for s in (",", ";", "\t")):
        out[first - 1] = above
    return out


def _split(filled: Sequence[tuple[int, str]], separator: str, complete: bool) -> tuple[int, LooseText] | None:
    """The text by one separator, with the number of columns of numbers and dates."""
    rows = [
        (k, [c.strip().strip('"') for c in (line.split(separator) if separator else line.split())])
        for k, line in filled
    ]
    rows, keys = _without_keys(rows)
    width = Counter(len(cells) for _, cells in rows[:LOOKED_AT]).most_common(1)[0][0] if rows else 0
    number, comma = _number_of(rows, separator, width)
    start = next((i for i, (_, c) in enumerate(rows) if len(c) == width and any(map(number, c))), None)
    if width < 2 or start is None:
        return None
    body, said = rows[start:], ["decimal commas are read as points"] if comma else []
    if len(body) > 1 and not complete and len(body[-1][1]) != width:
        body = body[:-1]
        said.append("the last line is cut off and was left out")
    if any(len(cells) != width for _, cells in body):
        return None
    columns = [[cells[k] for _, cells in body] for k in range(width)]
    kinds = [_kind(cells, number) for cells in columns]
    if not any(kind == "number" for kind in kinds):
        return None
    values = np.full((len(body), width), np.nan)
    missing = 0
    for k, (kind, cells) in enumerate(zip(kinds, columns, strict=True)):
        read = _numbers(cells, comma) if kind == "number" else _seconds(cells) if kind == "date" else None
        if read is not None:
            values[:, k] = read
            missing += int(sum(c.lower() in MISSING and c != "" for c in cells))
        elif kind != "words":
            return None
    above = rows[start - 1] if start and len(rows[start - 1][1]) == width else (-1, [])
    header = keys or (above[1] if not any(map(number, above[1])) else [])
    header = header or [f"#{k + 1}" for k in range(width)]
    times = [k for k, name in enumerate(header) if is_time(name.split("[")[0])]
    if any(np.isnan(values[:, k]).any() for k in times if kinds[k] != "words"):
        return None
    if missing:
        said.append(f"{missing} cells like N/A are samples that were not recorded")
    found = LooseText(
        header,
        above[0],
        values,
        _where(kinds, "words"),
        _where(kinds, "date"),
        (*said, *_of(kinds, header, columns)),
    )
    return sum(kind != "words" for kind in kinds), found


def _where(kinds: Sequence[str], kind: str) -> frozenset[int]:
    return frozenset(k for k, own in enumerate(kinds) if own == kind)


def _of(kinds: Sequence[str], header: Sequence[str], columns: Sequence[Sequence[str]]) -> list[str]:
    words = [f"'{n}'" for n, kind in zip(header, kinds, strict=True) if kind == "words"]
    dated = [(n, cells) for n, kind, cells in zip(header, kinds, columns, strict=True) if kind == "date"]
    dates = [f"'{n}'" for n, cells in dated if not all(_ZONE.search(c) for c in cells if c[:1].isdigit())]
    said = [f"columns of words were left out: {some_of(words)}"] if words else []
    return said + ([f"dates without a time zone are UTC: {some_of(dates)}"] if dates else [])


def _without_keys(rows: list[tuple[int, list[str]]]) -> tuple[list[tuple[int, list[str]]], list[str]]:
    """Rows of ``gx:0.1`` cells as their values, and the keys; rows of other cells as they are."""
    keyed = [(k, [_KEYED.fullmatch(c) for c in cells if c]) for k, cells in rows]
    whole = [(k, [m for m in found if m]) for k, found in keyed if found and all(found)]
    if not whole or len(whole) < NUMERIC_SHARE * len(rows):
        return rows, []
    keys = [m.group(1) for m in whole[0][1]]
    if any([m.group(1) for m in found] != keys for _, found in whole[:-1]):
        return rows, []
    return [(k, [m.group(2) for m in found]) for k, found in whole], keys


def _number_of(
    rows: Sequence[tuple[int, Sequence[str]]], separator: str, width: int
) -> tuple[Callable[[str], bool], bool]:
    """What a number looks like, and whether it has a decimal comma."""
    cells = [c for _, own in rows[:LOOKED_AT] if len(own) == width for c in own]
    commas = sum(bool(_COMMA.match(c)) and "," in c for c in cells)
    points = sum(bool(_NUMBER.match(c)) and "." in c for c in cells)
    comma = separator != "," and commas > points
    return (lambda c: bool((_COMMA if comma else _NUMBER).match(c))), comma


def _kind(cells: Sequence[str], number: Callable[[str], bool]) -> str:
    """``number``, ``date``, ``words``, or empty for a column of numbers with a wrong cell."""
    there = [c for c in cells if c.lower() not in MISSING]
    numbers = sum(map(number, there))
    if there and numbers == len(there):
        return "number"
    if there and all(_DATE.match(c) for c in there):
        return "date"
    return "" if there and numbers > (1.0 - NUMERIC_SHARE) * len(there) else "words"


def _numbers(cells: Sequence[str], comma: bool) -> Array:
    texts = ("nan" if c.lower() in MISSING else c.replace(",", ".") if comma else c for c in cells)
    return np.array([float(c) for c in texts], np.float64)


def _seconds(cells: Sequence[str]) -> Array | None:
    """Dates as seconds since 1970; None where one is none."""
    out = np.full(len(cells), np.nan)
    for k, cell in enumerate(cells):
        if cell.lower() in MISSING:
            continue
        try:
            date = datetime.fromisoformat(cell.replace("/", "-"))
        except ValueError:
            return None
        out[k] = (date if date.tzinfo else date.replace(tzinfo=UTC)).timestamp()
    return out
