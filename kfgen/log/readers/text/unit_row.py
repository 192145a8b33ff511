"""Text with the units in a row of their own below the names, as Consensys, LabVIEW and many loggers write it.

The two rows become one header ``name [unit]``. Spreadsheets' ``sep=,`` above them is no data.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

from kfgen.core.units import is_unit
from kfgen.log.readers.text.cells import cells_of, is_number

LOOKED_AT = 50
"""Lines among which the names are."""
SEPARATORS = (",", ";", "\t")
NO_UNIT = frozenset(("", "no_units", "no units", "n/a", "-", "--", "none", "local_flux", "1", "a.u.", "arb"))
"""Of a column, in small letters, whose numbers have no unit."""
_SEPARATOR_LINE = re.compile(r'"?sep=."?\s*$', re.IGNORECASE)


def with_unit_row(lines: Sequence[str]) -> list[str]:
    """The lines of a file with its units behind its names; as they are where it has no row of units.

    Parameters
    ----------
    lines : sequence of str

    Returns
    -------
    list of str
        As many, so that the numbers of lines in messages hold.
    """
    out = ["" if k == 0 and _SEPARATOR_LINE.match(line) else line for k, line in enumerate(lines[:LOOKED_AT])]
    for k in range(len(out) - 2):
        for separator in SEPARATORS:
            names, units, first = (_cells(out[k + i], separator) for i in range(3))
            if len(names) >= 2 and _are_units(names, units, first):
                header = (f"{n} [{u}]" for n, u in zip(names, (_unit(u) for u in units), strict=True))
                return [*out[:k], separator.join(header), "", *out[k + 2 :], *lines[LOOKED_AT:]]
    return [*out, *lines[LOOKED_AT:]]


def _cells(line: str, separator: str) -> list[str]:
    """The cells of a line, without the empty one behind a separator that ends it."""
    cells = cells_of(line.rstrip().rstrip(separator), separator)
    return cells if any(cells) else []


def _are_units(names: Sequence[str], units: Sequence[str], first: Sequence[str]) -> bool:
    """Whether a row is that of the units of the names above, a row of numbers below."""
    if not len(names) == len(units) == len(first) or not all(names) or "[" in "".join(names):
        return False
    numbers = [[is_number(c.replace(",", ".")) for c in row] for row in (names, units, first)]
    if any(numbers[0]) or any(numbers[1]) or not any(numbers[2]):
        return False
    known = [bool(u) and is_unit(u) for u in units]
    return any(known) and all(k or u.lower() in NO_UNIT for k, u in zip(known, units, strict=True))


def _unit(cell: str) -> str:
    return "1" if cell.lower() in NO_UNIT else cell
