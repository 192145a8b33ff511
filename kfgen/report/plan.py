"""The answers of ``plan``: how long to log, and which manoeuvre distinguishes two effects."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from kfgen.core.errors import InputError
from kfgen.gap.plan_between import BetweenPlan, plan_between
from kfgen.identify.plan import RECORD_HOURS, ParameterBound, RecordPlan, hours_text, plan
from kfgen.model.filter import FilterModel
from kfgen.report.page import Answer, Page, PagePart, columns, figure, heading, sentence, table
from kfgen.report.plots import AFTER, BEFORE, MEASURED, Line, Picture, bars_picture, bound_picture

USUAL_WANTED = 0.2
"""Relative standard deviation that a record is to reach, where none is said."""
LINE_COLORS = (AFTER, BEFORE, MEASURED, "#7a8794", "#3d8b5f", "#8a5fb0")


def record_answer(
    noise: Path | None, rate: float, wanted: float | None, beside: Mapping[str, object]
) -> Answer:
    """How long to log for a wanted accuracy.

    Parameters
    ----------
    noise : Path, optional
        The noise file.
    rate : float
        Of the record [Hz].
    wanted : float, optional
        Relative standard deviation; `USUAL_WANTED` where left out.
    beside : mapping of str to object
        Options of the other plan, between effects, with their values.

    Raises
    ------
    InputError
        There is no noise file, an option of the other plan was given, or as in `kfgen.identify.plan.plan`.
    """
    for option in (o for o, given in beside.items() if given):
        lacks = "--model FILTER" if option == "--between" else "--between EFFECT@PLACE,EFFECT@PLACE"
        raise InputError(f"{option} plans between two effects and lacks {lacks}", remedy=f"Add {lacks}")
    if noise is None:
        raise InputError(
            "nothing says what is to be planned",
            remedy="Give a noise file, or --between EFFECT@PLACE,EFFECT@PLACE --model FILTER",
        )
    return plan_answer(plan(noise, rate, USUAL_WANTED if wanted is None else wanted))


def between_answer(
    between: str,
    model: FilterModel,
    rate: float,
    speed: float | None,
    room: float | None,
    wanted: float | None = None,
) -> Answer:
    """Which manoeuvre distinguishes two effects.

    Parameters
    ----------
    between, model, rate, speed, room
        As of `kfgen.gap.plan_between.plan_between`.
    wanted : float, optional
        Of the plan of a record: none here.

    Raises
    ------
    InputError
        As there, or an accuracy was given.
    """
    if wanted is not None:
        raise InputError("--wanted is an accuracy of noise and not of --between", remedy="Leave it out")
    found = plan_between(between, model, rate, speed=speed, room=room)
    head, rows = found.short_table()
    first, *others = found.summary()
    legend = f"the first: {found.first}; the second: {found.second}; {found.model} at {found.rate:g} Hz"
    text = "\n".join([f"{first}.", *(f"  {o}" for o in others), f"  {legend}", columns([list(head), *rows])])
    parts = (
        *(sentence(f"{o[0].upper()}{o[1:]}.") for o in others),
        table(head, rows, "Nats are the expected log Bayes factor where that effect is there."),
        figure(between_picture(found), "Expected nats whichever of the two is there."),
    )
    facts = (
        ("first", found.first),
        ("second", found.second),
        ("filter", f"{found.model} at {found.rate:g} Hz"),
    )
    good = found.shortest is not None
    return Answer(
        text, found.to_dict(), Page("Manoeuvre between two effects", parts, (f"{first}.",), good, facts)
    )


def between_picture(found: BetweenPlan) -> Picture:
    """Nats of each manoeuvre, whichever of the effects is there, up to twice what is wanted.

    Parameters
    ----------
    found : BetweenPlan
    """
    names = [f"{m.name} ({m.length:.3g} s)" for m in found.manoeuvres]
    values = [min(m.nats, 2.0 * found.wanted) for m in found.manoeuvres]
    return bars_picture(
        names, values, f"nats, {found.wanted:g} are wanted; cut off at {2 * found.wanted:g}", "between"
    )


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
