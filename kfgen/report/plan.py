"""The answer of ``plan``: how long to log."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from kfgen.identify.plan import RECORD_HOURS, ParameterBound, RecordPlan, hours_text
from kfgen.report.page import Answer, Page, PagePart, columns, figure, heading, table
from kfgen.report.plots import AFTER, BEFORE, MEASURED, Line, Picture, bound_picture

LINE_COLORS = (AFTER, BEFORE, MEASURED, "#7a8794", "#3d8b5f", "#8a5fb0")


def plan_answer(found: RecordPlan) -> Answer:
    """The Cramér-Rao bound of every parameter against the length of record."""
    lines: list[str] = []
    parts: list[PagePart] = []
    verdict: list[str] = []
    percent = f"{100 * found.wanted:g} %"
    head = ["", *(f"{h:g} h" for h in RECORD_HOURS), f"for {percent}"]
    for name, bounds in found.channels.items():
        rows = [[label, *map(_percent, b.bounds), hours_text(b)] for label, b in bounds.items()]
        said = [
            f"{label}: {percent} takes {hours_text(b)}."
            for label, b in bounds.items()
            if np.isfinite(b.hours_for_wanted)
        ]
        verdict += [f"{name}: {words}" for words in said]
        lines += [
            f"{name}: smallest relative standard deviation of an unbiased estimate",
            columns([head, *rows]),
            "",
        ]
        parts += [
            heading(name),
            table(head, rows),
            figure(plan_picture(bounds, name), "Cramér-Rao bound against the length of the record."),
        ]
    page = Page("How long to log", tuple(parts), tuple(verdict))
    return Answer("\n".join(lines).rstrip(), found.to_dict(), page)


def _percent(value: float) -> str:
    if value >= 10.0:
        return "nothing"
    return f"{100 * value:.0f} %" if value >= 0.1 else f"{100 * value:.2g} %"


def plan_picture(bounds: Mapping[str, ParameterBound], name: str) -> Picture:
    """The bounds of a channel against the length of the record.

    Parameters
    ----------
    bounds : mapping of str to ParameterBound
        By effect and parameter.
    name : str
        Of the channel.
    """
    hours = np.array(RECORD_HOURS)
    values = {label: np.array(b.bounds) for label, b in bounds.items()}
    lines = [
        Line(label, hours, np.where(np.isfinite(v), v, np.nan), LINE_COLORS[i % len(LINE_COLORS)])
        for i, (label, v) in enumerate(values.items())
    ]
    return bound_picture(lines, f"plan-{name}")
