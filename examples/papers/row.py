"""`Row`: a number of a paper beside the same number here."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from kfgen.report.page import Page, PagePart, columns, heading, table

HEAD = ("what", "paper", "here", "95 % of seeds", "note")


@dataclass(frozen=True)
class Row:
    """One number.

    Parameters
    ----------
    what, paper, here : str
        What it is, as printed, and as found (the median over seeds).
    interval : str
        Between which 95 % of the seeds are.
    note : str
        Why they differ, or why there is none.
    """

    what: str
    paper: str
    here: str = "-"
    interval: str = ""
    note: str = ""


def over_seeds(what: str, paper: str, values: ArrayLike, note: str = "") -> Row:
    """A row of values of several seeds, shape (s,); those that are no numbers were not estimated."""
    all_of = np.asarray(values, dtype=np.float64)
    known = all_of[np.isfinite(all_of)]
    if not known.size:
        return Row(what, paper, "none", f"0 of {all_of.size}", note)
    lo, hi = np.quantile(known, [0.025, 0.975])
    some = f" ({known.size} of {all_of.size})" if known.size < all_of.size else ""
    return Row(what, paper, f"{np.median(known):.4g}", f"{lo:.3g} .. {hi:.3g}{some}", note)


def exact(what: str, paper: str, value: float, note: str = "") -> Row:
    """A row of a number without chance."""
    return Row(what, paper, f"{value:.6g}", "exact", note)


def text_of(title: str, rows: Sequence[Row]) -> str:
    """A section as text."""
    cells = [list(HEAD), *([r.what, r.paper, r.here, r.interval, r.note] for r in rows)]
    return f"{title}\n{columns(cells)}\n"


def page_of(
    title: str, sections: Sequence[tuple[str, Sequence[Row]]], pictures: Sequence[PagePart] = ()
) -> Page:
    """Sections as a page, pictures first."""
    parts: list[PagePart] = list(pictures)
    for name, rows in sections:
        cells = [[r.what, r.paper, r.here, r.interval, r.note] for r in rows]
        parts += [heading(name), table(HEAD, cells)]
    return Page(title, tuple(parts))
