"""The pictures of results: what ``.plot()`` of a result shows."""

from __future__ import annotations

from dataclasses import dataclass
from functools import singledispatch
from pathlib import Path

from kfgen.audit.result import Audited
from kfgen.core.errors import InputError
from kfgen.core.files.whole_file import write_text
from kfgen.core.result import Result
from kfgen.core.units import display_unit
from kfgen.gap.plan_between import BetweenPlan
from kfgen.gap.result import GapResult
from kfgen.identify.identification import Identification
from kfgen.identify.plan import RecordPlan
from kfgen.report.audit import audit_picture
from kfgen.report.denoise import denoise_picture
from kfgen.report.filter import run_picture
from kfgen.report.gap_figures import figures
from kfgen.report.identify import panel
from kfgen.report.page import Page, figure, page_html
from kfgen.report.plan import between_picture, plan_picture
from kfgen.report.plots import panels_picture
from kfgen.run.adaptive.denoise_log import DenoisedLog
from kfgen.run.run import FilterRun


@dataclass(frozen=True, repr=False)
class Picture:
    """Drawings below each other.

    Parameters
    ----------
    title : str
    drawings : mapping of str to str
        SVG by caption.
    """

    title: str
    drawings: dict[str, str]

    def __repr__(self) -> str:
        return f"{self.title}: {', '.join(self.drawings)}"

    def _repr_html_(self) -> str:
        """The drawings, for a notebook."""
        return "".join(self.drawings.values())

    def save(self, path: str | Path) -> None:
        """Write a page (``.html``), or the first drawing alone (``.svg``)."""
        if Path(path).suffix == ".svg":
            write_text(path, next(iter(self.drawings.values())))
        else:
            parts = tuple(figure(svg, caption) for caption, svg in self.drawings.items())
            write_text(path, page_html(Page(self.title, parts)))


@singledispatch
def picture_of(result: Result) -> Picture:
    """The picture of a result; another kind of result registers its own here.

    Raises
    ------
    InputError
        There is none of this kind of result.
    """
    raise InputError(
        f"there is no picture of a result of the kind {type(result).__name__}",
        remedy="Look at its table, or at to_dict()",
    )


@picture_of.register
def _(result: Audited) -> Picture:
    drawn = {a.manoeuvre.name: audit_picture(a, a.degree) for a in result.audits if a.degree is not None}
    return Picture(f"Standard deviations of {result.first.model.name}", drawn)


@picture_of.register
def _(result: FilterRun) -> Picture:
    return Picture(f"Innovations of {result.model}", {n: run_picture(result, n) for n in result.updated})


@picture_of.register
def _(result: DenoisedLog) -> Picture:
    units = {name: display_unit(result.raw.channel(name).unit) for name in result.channels}
    drawn = {name: denoise_picture(one, name, units[name]) for name, one in result.channels.items()}
    return Picture("Allan deviation before and after", drawn)


@picture_of.register
def _(result: RecordPlan) -> Picture:
    drawn = {name: plan_picture(bounds, name) for name, bounds in result.channels.items()}
    return Picture("Cramér-Rao bound against the length of the record", drawn)


@picture_of.register
def _(result: BetweenPlan) -> Picture:
    return Picture("Expected nats between two effects", {"Nats of each manoeuvre": between_picture(result)})


@picture_of.register
def _(result: Identification) -> Picture:
    drawn = {name: panels_picture([panel(c, "")], f"allan-{name}") for name, c in result.channels.items()}
    return Picture("Allan deviation with the identified model", drawn)


@picture_of.register
def _(result: GapResult) -> Picture:
    parts = [part for c in result.comparisons for part in figures(c)]
    return Picture("What the models leave", {part.caption: part.drawn for part in parts})
