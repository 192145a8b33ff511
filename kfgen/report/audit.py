"""The answer of ``audit``: what cannot be seen, what would free it, how well the rest shows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from kfgen.audit.degree import Degree
from kfgen.audit.result import Audit, Audited, ManoeuvreTable, WantedAccuracy
from kfgen.audit.words import amount
from kfgen.manoeuvre.manoeuvre import Manoeuvre
from kfgen.report.page import Answer, Page, PagePart, columns, figure, heading, sentence, table, text
from kfgen.report.plots import Line, Picture, curves_picture, thin

AT_ONCE = 6
"""Manoeuvres beside each other on a terminal."""
STATE_HEAD = ("state", "prior", "at the end", "bits per minute", "verdict")


def audit_answer(audited: Audited) -> Answer:
    """Sentences, tables and curves of an audit."""
    first, wants = audited.first, audited.wanted
    lines: list[str] = []
    parts: list[PagePart] = []
    for a in audited.audits:
        for own, shown in (
            _said(a),
            _freeing(first, audited.table) if a is first and audited.table else ([], []),
            _shown(a, a.degree, wants) if a.degree is not None else ([], []),
        ):
            lines += own
            parts += shown
    lines += [f"  note: {w}." for w in audited.lint]
    parts += [sentence(f"Note: {w}.") for w in audited.lint]
    verdict = tuple(f"{_verdict(a)}." for a in audited.audits)
    good = all(not a.directions for a in audited.audits)
    page = Page(f"What {first.model.name} cannot see", tuple(parts), verdict, good)
    return Answer("\n".join(lines), audited.to_dict(), page)


def _verdict(a: Audit) -> str:
    """How many directions nobody can see along a manoeuvre."""
    if not a.directions:
        return f"{a.manoeuvre.name}: every state of {a.model.name} is observable"
    names = "; ".join(d.label for d in a.directions)
    return f"{a.manoeuvre.name}: {a.nullity} of {a.states} directions are unobservable ({names})"


def _beside(a: Audit) -> str:
    finite = np.isfinite(a.numeric.condition)
    condition = f"{a.numeric.condition:.2g} in" if finite else "beyond"
    return (
        f"python-control and numpy: rank {a.numeric.rank}, condition number {condition} floating point, "
        "units mixed"
    )


def _scaled(a: Audit, run: Degree) -> str:
    """The conditioning of what is visible, and what causes it."""
    pair = " and ".join(a.names[k] for k, _ in run.weakest)
    together = f"{pair} together" if len(run.weakest) > 1 else pair
    if not np.isfinite(run.condition):
        return f"weakest direction: {together}; the samples tell nothing of how they started"
    return (
        f"scaled by priors and noise the visible part has condition {run.condition:.2g}; "
        f"weakest direction: {together} ({run.singular[-1]:.2g} prior sigma)"
    )


Said = tuple[list[str], list[PagePart]]
"""Lines of the terminal, parts of the page."""


def _said(a: Audit) -> Said:
    """What a manoeuvre hides."""
    head = f"{a.model.name}, {a.manoeuvre.name}: rank {a.rank} of {a.states}, {a.nullity} hidden"
    none = "Every state shows in the measurements"
    if a.recorded:
        head = f"{a.model.name}, {a.manoeuvre.name}: {a.nullity} of {a.states} hidden whatever is flown"
        none = "Some motion shows every state; how well this one did, the filter's covariance says, which trusts its linearisation"
    said = [d.sentence for d in a.directions] or [none]
    beside = [] if a.recorded else [f"{_beside(a)}."]
    lines = [head, *(f"  {w}." for w in said), *(f"  {w}" for w in beside)]
    parts = [heading(head), *(sentence(f"{w}.") for w in said)]
    if a.directions:
        rows = [[d.label, _amounts(d.vector, d.units), _amounts(d.formula or d.exact)] for d in a.directions]
        parts.append(table(("hidden together", "amounts", "exactly"), rows))
    return lines, [*parts, *map(text, beside)]


def _freeing(first: Audit, t: ManoeuvreTable) -> Said:
    """Which manoeuvre frees which direction."""
    parts = [heading("What frees them"), _table_part(first, t), sentence(f"{_shortest(t)}.")]
    return [*_table_lines(first, t), f"  {_shortest(t)}."], parts


def _shown(a: Audit, run: Degree, wants: Sequence[WantedAccuracy]) -> Said:
    """How well each state shows."""
    rows = _state_rows(a, run)
    scaled = [f"{_scaled(a, run)}."] if run.singular.size else []
    reached = [f"{_reached(a, run, w)}." for w in wants]
    lines = [*(f"  {w}" for w in (*scaled, *reached)), columns([list(STATE_HEAD), *rows])]
    caption = f"After {run.t[-1]:g} s of {a.manoeuvre.name}"
    parts = [heading(f"How well states show along {a.manoeuvre.name}"), *(text(w) for w in scaled)]
    return lines, [
        *parts,
        *(sentence(w) for w in reached),
        table(STATE_HEAD, rows, caption),
        figure(
            partial(audit_picture, a, run),
            f"Standard deviations along {a.manoeuvre.name}; dashed: exactly unobservable",
        ),
    ]


def _state_rows(a: Audit, run: Degree) -> list[list[str]]:
    bits = run.bits_per_minute
    return [
        [
            name,
            amount(float(run.sigma[0, k]), s.unit),
            amount(float(run.sigma[-1, k]), s.unit),
            f"{bits[k]:.2g}",
            a.verdict(k).replace("_", " "),
        ]
        for k, (name, s) in enumerate(zip(a.names, a.model.states))
    ]


def _reached(a: Audit, run: Degree, w: WantedAccuracy) -> str:
    k = a.place(w.state)
    seconds = run.reaches(k, w.sigma)
    if seconds is None:
        return f"{a.names[k]} does not reach {w.written} within {run.t[-1] / 60:.3g} min"
    return f"{a.names[k]} reaches {w.written} after {seconds / 60:.3g} min"


def audit_picture(a: Audit, run: Degree) -> Picture:
    """Standard deviations against time, a panel for each unit; hidden states are dashed.

    Parameters
    ----------
    a : Audit
        Along one manoeuvre.
    run : Degree
        Its covariance.
    """
    panels, some = [], thin(run.t)
    for unit in dict.fromkeys(s.unit for s in a.model.states):
        lines = [
            Line(a.names[k], run.t[some], run.sigma[some, k], "", dashed=s.name in a.hidden_states)
            for k, s in enumerate(a.model.states)
            if s.unit == unit and s.prior > 0.0
        ]
        if lines:
            panels.append((f"standard deviation [{unit}]", lines))
    return curves_picture(panels, f"{a.model.name}-{a.manoeuvre.name}")


def _amounts(vector: Mapping[str, Any], units: Mapping[str, str] | None = None) -> str:
    if units is None:
        return ", ".join(f"{n} = {v}" for n, v in vector.items())
    return ", ".join(
        f"{n} = {v:.6g} {'' if units[n] == '1' else units[n]}".strip() for n, v in vector.items()
    )


def _table_lines(first: Audit, t: ManoeuvreTable) -> list[str]:
    lines = []
    for k in range(0, len(t.manoeuvres), AT_ONCE):
        head = [f"hidden at {first.manoeuvre.name}", *(m.name for m in t.manoeuvres[k : k + AT_ONCE])]
        rows = [[d.label, *t.cells(row[k : k + AT_ONCE])] for d, row in zip(first.directions, t.observable)]
        lines.append(columns([head, *rows]))
    return lines


def _table_part(first: Audit, t: ManoeuvreTable) -> PagePart:
    head = (f"hidden at {first.manoeuvre.name}", *(m.name for m in t.manoeuvres))
    rows = [[d.label, *t.cells(row)] for d, row in zip(first.directions, t.observable)]
    return table(head, rows, "Every cell is exact")


def _shortest(t: ManoeuvreTable) -> str:
    if t.shortest is not None:
        return f"The shortest manoeuvre that frees all: {t.shortest.name} ({t.shortest.title}), {t.shortest.length:g} s"
    best = max(t.manoeuvres, key=lambda m: _count(t, m))
    count = _count(t, best)
    if not count:
        return "No manoeuvre here frees any of them"
    return (
        f"No manoeuvre here makes all observable; {best.name} makes {count} of {len(t.observable)} observable"
    )


def _count(t: ManoeuvreTable, m: Manoeuvre) -> int:
    """How many directions a manoeuvre frees."""
    return sum(bool(row[t.manoeuvres.index(m)]) for row in t.observable)
