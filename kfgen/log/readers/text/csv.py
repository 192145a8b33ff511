"""Reads and writes CSV logs: a header row ``name [unit],...``, or foreign columns that the user maps.

Lines before the header (comments, settings) are skipped: the header is the last
line before the first row that is all numbers, when it has as many cells.
"""

from __future__ import annotations

import re
from collections import Counter
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from kfgen.core.errors import InputError
from kfgen.core.files.whole_file import write_whole
from kfgen.core.units import from_si
from kfgen.log.log import Log
from kfgen.log.readers.flight.ecl_replay import is_answer, is_replay, read_answer, read_replay
from kfgen.log.readers.tables.table import LogTable, TableColumn, stated_rate, stated_samples
from kfgen.log.readers.text.cells import cells_of, is_number
from kfgen.log.readers.text.foreign_text import foreign
from kfgen.log.readers.text.loose_text import loose_text
from kfgen.log.readers.text.published_layouts import with_units
from kfgen.log.readers.text.unit_row import with_unit_row

SUFFIXES = (".csv", ".txt", ".tsv")

_HEADER = re.compile(r"^\s*(.*?)\s*(?:\[([^\]]*)\])?\s*$")
_MAX_HEADER_LINES = 200


def read(path: Path) -> LogTable:
    """Read a CSV file; comma, semicolon, tab or space separated.

    Raises
    ------
    InputError
        No row of numbers, a duplicated header, a cell that is no number: with line and column.
    """
    text = _decoded(path.read_bytes())
    lines = text.splitlines()
    if is_replay(lines):
        return read_replay(str(path), lines)
    if is_answer(lines):
        return read_answer(str(path), lines)
    return foreign(*_raw(path, text, lines))


def raw_table(path: Path) -> tuple[LogTable, dict[str, TableColumn]]:
    """The columns of a file under its own names, and those of words among them.

    Raises
    ------
    InputError
        As `read`.
    """
    text = _decoded(path.read_bytes())
    return _raw(path, text, text.splitlines())


def _raw(path: Path, text: str, lines: list[str]) -> tuple[LogTable, dict[str, TableColumn]]:
    words: tuple[str, ...] = ()
    left: dict[str, TableColumn] = {}
    lines = with_unit_row(lines)
    try:
        separator, first = _first_row(path, lines)
        lines = _unended(lines, first, separator)
        names, units = _header(path, lines, first, separator)
        values = _numbers(path, lines, first, separator, names)
    except InputError:
        found = loose_text(lines, text.endswith(("\n", "\r")))
        if found is None:
            raise
        names, units = _names(path, found.header_line, list(found.header))
        units = ["s" if k in found.dates else unit for k, unit in enumerate(units)]
        values, words, first = found.values, found.said, max(found.header_line, 0)
        left = {names[k]: TableColumn(values[:, k]) for k in sorted(found.words)}
    rate, stated, warnings = stated_rate(lines[:first], values.shape[0])
    columns = {
        name: TableColumn(values[:, k], unit) for k, (name, unit) in enumerate(zip(names, units, strict=True))
    }
    samples = stated_samples(lines[:first])
    table = LogTable(str(path), columns, rate, (*words, *warnings), stated, samples)
    return with_units(table, lines[:first]), left


def _decoded(data: bytes) -> str:
    """The text of a file: UTF-8 or UTF-16 by its byte order mark, or the Windows code page of western Europe."""
    if data[:2] in (b"\xff\xfe", b"\xfe\xff"):
        return data.decode("utf-16", errors="replace")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return data.decode("cp1252", errors="replace")


def write(log: Log, path: str | Path) -> None:
    """Write a log as CSV in the users' units, whole or not at all.

    Parameters
    ----------
    log : Log
    path : path-like
    """
    columns, names = [np.asarray(log.t)], ["t [s]"]
    digits = ["%.17g"]
    for name, channel in log.channels.items():
        digits.append("%.10g")
        columns.append(from_si(channel.values, channel.unit))
        names.append(f"{name} [{channel.unit}]")
    with write_whole(path) as temporary:
        np.savetxt(
            temporary,
            np.column_stack(columns),
            fmt=digits,
            delimiter=",",
            header=(f"# samples: {log.samples}\n" if log.samples else "") + ",".join(names),
            comments="",
        )


def _first_row(path: Path, lines: list[str]) -> tuple[str, int]:
    """The separator, and the index of the first line of numbers and empty cells."""
    for index, line in enumerate(lines[:_MAX_HEADER_LINES]):
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        for separator in (",", ";", "\t", ""):
            cells = cells_of(line, separator)
            if any(is_number(c) for c in cells) and all(is_number(c) or not c for c in cells):
                return separator, index
    _no_row(path, lines)
    raise AssertionError


def _no_row(path: Path, lines: list[str]) -> None:
    """Say why no line is all numbers: mostly a bad cell right in the first one."""
    for index, line in enumerate(lines[:_MAX_HEADER_LINES]):
        for k, cell in enumerate(cells_of(line, ",")):
            if cell and not is_number(cell) and any(is_number(c) for c in cells_of(line, ",")) and index:
                raise InputError(
                    f"'{cell}' is not a number",
                    where=f"{path}: line {index + 1}, column {k + 1}",
                    remedy="Correct or remove that line",
                )
    raise InputError(
        "no line of it is all numbers",
        where=str(path),
        remedy="A CSV log has a header 'name [unit],...' and rows of numbers",
    )


def _unended(lines: list[str], first: int, separator: str) -> list[str]:
    """Lines without the separator that ends every row of numbers, where none ends the header."""
    rows = [r.rstrip(" ") for r in lines[first:] if r.strip()]
    header = next((r for r in reversed(lines[:first]) if r.strip()), "")
    width = len(cells_of(header, separator))
    ended = bool(separator) and all(
        r.endswith(separator) and len(cells_of(r, separator)) == width + 1
        for r in rows[: max(len(rows) - 1, 1)]
    )  # the last row may be without it
    return [*lines[:first], *(r.removesuffix(separator) for r in rows)] if ended else lines


def _header(path: Path, lines: list[str], first: int, separator: str) -> tuple[list[str], list[str | None]]:
    width = len(cells_of(lines[first], separator))
    for index in range(first - 1, -1, -1):
        line = lines[index].lstrip("#% ")
        if not line.strip():
            continue
        if not separator:
            line = re.sub(r"\s+\[", "[", line)
        cells = cells_of(line, separator)
        if len(cells) == width and any(is_number(c) for c in cells):
            bad = next((k for k, c in enumerate(cells) if c and not is_number(c)), None)
            if bad is None:
                continue  # a row that is commented out
            raise InputError(
                f"'{cells[bad]}' is not a number",
                where=f"{path}: line {index + 1}, column {bad + 1}",
                remedy="Correct or remove that line",
            )
        if len(cells) == width:
            return _names(path, index, cells)
        break
    return [f"#{k + 1}" for k in range(width)], [None] * width


def _names(path: Path, index: int, cells: list[str]) -> tuple[list[str], list[str | None]]:
    """Names and units of header cells; ``state[0], state[1]`` are names with an index and no units."""
    matches = [_HEADER.match(cell) for cell in cells]
    names = [m.group(1) if m else cell for m, cell in zip(matches, cells, strict=True)]
    units = [m.group(2) if m else None for m in matches]
    count = Counter(names)
    for k, name in enumerate(names):
        if count[name] > 1 and (units[k] or "").isdigit():
            names[k], units[k] = cells[k], None
    seen: set[str] = set()
    for k, name in enumerate(names):
        if name in seen:
            raise InputError(
                f"the header has '{name}' twice",
                where=f"{path}: line {index + 1}, column {k + 1}",
                remedy="Rename one of the two columns",
            )
        seen.add(name)
    return names, units


def _numbers(
    path: Path, lines: list[str], first: int, separator: str, names: list[str]
) -> NDArray[np.float64]:
    rows = lines[first:]
    try:
        return _loaded([r for r in rows if r.strip()], separator)
    except ValueError:
        _explain(path, rows, first, separator, names)
    return _loaded([_filled(r, separator) for r in rows if r.strip()], separator)


def _loaded(rows: list[str], separator: str) -> NDArray[np.float64]:
    return np.loadtxt(rows, delimiter=separator or None, ndmin=2, dtype=np.float64)


def _filled(row: str, separator: str) -> str:
    """A row without quotation marks, in which an empty cell is no number: channels of several rates share a file so."""
    return separator.join(c or "nan" for c in cells_of(row, separator)) if separator else row.replace('"', "")


def _explain(path: Path, rows: list[str], first: int, separator: str, names: list[str]) -> None:
    """Find the first cell or row that is wrong and say where it is."""
    for index, line in enumerate(rows):
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        cells, number = cells_of(line, separator), first + index + 1
        if len(cells) != len(names):
            raise InputError(
                f"has {len(cells)} cells instead of {len(names)}",
                where=f"{path}: line {number}",
                remedy="Correct or remove that line",
            )
        for k, cell in enumerate(cells):
            if (cell and not is_number(cell)) or (not cell and names[k] == "t"):
                raise InputError(
                    f"'{cell}' is not a number" if cell else "an empty cell",
                    where=f"{path}: line {number}, column {k + 1} ({names[k]})",
                    remedy="Correct or remove that line",
                )
