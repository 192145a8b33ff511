"""The pictures of results: what ``.plot()`` of a result opens."""

from __future__ import annotations

from collections.abc import Iterable
from functools import singledispatch
from typing import Any

from kfgen.audit.result import Audited
from kfgen.core.errors import InputError
from kfgen.core.result import Result
from kfgen.core.units import display_unit
from kfgen.fleet.result import FleetResult
from kfgen.gap.judge.judgement import Judgement
from kfgen.gap.plan_between import BetweenPlan
from kfgen.gap.result import GapResult
from kfgen.identify.identification import Identification
from kfgen.identify.plan import RecordPlan
from kfgen.report.audit import audit_picture
from kfgen.report.denoise import denoise_picture
from kfgen.report.figures.gap_figures import figures
from kfgen.report.figures.run_figures import run_pictures
from kfgen.report.fleet import fleet_pictures
from kfgen.report.identify import panel
from kfgen.report.judge import named_picture
from kfgen.report.plan import between_picture, plan_picture
from kfgen.report.plots import Picture, panels_picture
from kfgen.run.adaptive.denoise_log import DenoisedLog
from kfgen.run.run import FilterRun

Pictures = Iterable[tuple[str, Picture]]
"""Titles, and the picture of each."""


def opened(result: Result) -> list[Any]:
    """The axes of a result's pictures, a figure of pyplot for each.

    Parameters
    ----------
    result : Result

    Returns
    -------
    list of matplotlib.axes.Axes

    Raises
    ------
    InputError
        It has no picture.
    """
    return [ax for title, picture in pictures_of(result) for ax in picture.open(title)]


@singledispatch
def pictures_of(result: Result) -> Pictures:
    """The pictures of a result; another kind of result registers its own here.

    Raises
    ------
    InputError
        There is none of this kind of result, or this one shows nothing.
    """
    raise _none(f"there is no picture of a result of the kind {type(result).__name__}")


def _none(what: str, remedy: str = "Look at its table, or at to_dict()") -> InputError:
    return InputError(what, remedy=remedy)


@pictures_of.register
def _(result: Audited) -> Pictures:
    name = result.first.model.name
    drawn = [
        (f"Standard deviations of {name} along {a.manoeuvre.name}", audit_picture(a, a.degree))
        for a in result.audits
        if a.degree is not None
    ]
    if not drawn:
        raise _none(
            f"the audit of {name} has no picture: it says what can be seen, not how well over time",
            "Give it a horizon: duration=60.0",
        )
    return drawn


@pictures_of.register
def _(result: FilterRun) -> Pictures:
    if not result.updated:
        raise _none(f"the run of {result.model} has no innovations to draw: no sensor updated it")
    return run_pictures(result)


@pictures_of.register
def _(result: DenoisedLog) -> Pictures:
    units = {name: display_unit(result.raw.channel(name).unit) for name in result.channels}
    return [
        (f"Allan deviation of {name}", denoise_picture(one, name, units[name]))
        for name, one in result.channels.items()
    ]


@pictures_of.register
def _(result: RecordPlan) -> Pictures:
    return [
        (f"{name}: Cramér-Rao bound against the length of the record", plan_picture(bounds, name))
        for name, bounds in result.channels.items()
    ]


@pictures_of.register
def _(result: BetweenPlan) -> Pictures:
    return [("Expected nats between two effects", between_picture(result))]


@pictures_of.register
def _(result: Identification) -> Pictures:
    panels = [panel(channel, name) for name, channel in result.channels.items()]
    return [("Allan deviation with the identified model", panels_picture(panels, "allan"))]


@pictures_of.register
def _(result: GapResult) -> Pictures:
    drawn = [
        (f"{c.channels[0]}: {part.caption}" if len(c.channels) == 1 else part.caption, part.picture)
        for c in result.comparisons
        for part in figures(c)
    ]
    if not drawn:
        raise _none(f"this comparison has no picture: {'; '.join(result.summary()[:1])}")
    return drawn


@pictures_of.register
def _(result: Judgement) -> Pictures:
    if not result.trials:
        raise _none(f"there is no picture of this judgement: {'; '.join(result.summary()[:2])}")
    return [(f"Simulated records that name {result.name}", named_picture(result))]


@pictures_of.register
def _(result: FleetResult) -> Pictures:
    return fleet_pictures(result)
