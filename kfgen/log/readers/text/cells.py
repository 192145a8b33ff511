"""The cells of a line of text."""

from __future__ import annotations


def cells_of(line: str, separator: str) -> list[str]:
    """The cells of a line without their quotation marks.

    Parameters
    ----------
    line, separator : str
        An empty separator stands for blanks.

    Returns
    -------
    list of str
    """
    return [c.strip().strip('"') for c in (line.split(separator) if separator else line.split())]


def is_number(cell: str) -> bool:
    """Whether a cell is a number to numpy.

    Parameters
    ----------
    cell : str
    """
    if "_" in cell:  # read by Python, not by numpy
        return False
    try:
        float(cell)
    except ValueError:
        return False
    return True
