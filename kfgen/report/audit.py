"""The answer of ``audit``: what cannot be seen, what would free it, how well the rest shows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

import kfgen
from kfgen.audit.audit import Audit, Audited, ManoeuvreTable
from kfgen.audit.degree import Degree
from kfgen.audit.words import amount, called
from kfgen.core.errors import InputError
from kfgen.core.numbers import finite
from kfgen.core.units import parse_quantity, parse_unit
from kfgen.manoeuvre.manoeuvre import Manoeuvre
from kfgen.report.page import Answer, Page, PagePart, columns, figure, heading, sentence, table, text
from kfgen.report.plots import Line, curves_picture, thin

FREED, HIDDEN, UNKNOWN = "freed", "hidden", "unknown"
AT_ONCE = 6
"""Manoeuvres beside each other on a terminal."""
STATE_HEAD = ("state", "prior", "at the end", "bits per minute", "verdict")


@dataclass(frozen=True)
class WantedAccuracy:
    """A deviation that is asked for: state, its SI size, as written."""

    state: str
    sigma: float
    written: str

    @staticmethod
    def parse(entry: str, audit: Audit) -> WantedAccuracy:
        """Read ``phi_D=0.1 deg``; raises `InputError` where it names no state or no size."""
        name, _, value = entry.partition("=")
        names = {n: s for s, n in zip(audit.model.states, _names(audit))}
        names |= {s.name: s for s in audit.model.states}
        state = names.get(name.strip())
        if state is None or not value:
            raise InputError(
                f"'{entry}' asks for no state",
                where="--want",
                remedy=f'Write it like "{next(iter(names))}=0.1"; known are {", ".join(dict.fromkeys(_names(audit)))}',
            )
        sigma = parse_quantity(value.strip(), state.unit, where=f"--want {name.strip()}", offset=False)
        if sigma <= 0.0:
            raise InputError(
                f"a deviation of '{value}' is none", where="--want", remedy="Give a positive one"
            )
        return WantedAccuracy(state.name, sigma, value.strip())


def audit_answer(
    audited: Audited, wanted: Sequence[str] = (), inputs: Mapping[str, str] | None = None
) -> Answer:
    """Sentences, tables, curves.

    Parameters
    ----------
    wanted : sequence of str
        Deviations that are asked for, ``state=size``.
    inputs : mapping of str to str
        SHA-256 of the files that were read.
    """
    first = audited.first
    wants = [WantedAccuracy.parse(w, first) for w in wanted]
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
    data: dict[str, Any] = {
        "format": "kfgen-audit-1",
        "kfgen": kfgen.__version__,
        "model": first.model.name,
        "hash": first.model.hash,
        "inputs": dict(inputs or {}),
        "manoeuvres": {a.manoeuvre.name: _data(a, wants) for a in audited.audits},
        "table": _table_data(first, audited.table),
        "notes": list(audited.lint),
    }
    return Answer("\n".join(lines), data, Page(f"What {first.model.name} cannot see", tuple(parts)))


def _names(a: Audit) -> list[str]:
    return [called(a.model, s, a.manoeuvre) for s in a.model.states]


def _beside(a: Audit) -> str:
    return (
        f"python-control and numpy: rank {a.numeric.rank}, condition number {a.numeric.condition:.2g} "
        "in floating point, units mixed"
    )


def _scaled(a: Audit) -> str:
    """The conditioning of what is visible, and what causes it."""
    assert a.degree is not None
    pair = " with ".join(_names(a)[k] for k, _ in a.degree.weakest)
    weak = a.degree.singular[-1] if a.degree.singular.size else 0.0
    return (
        f"scaled by priors and noise the visible part has condition {a.degree.condition:.2g}; "
        f"least seen is {pair}, {weak:.2g} sigma of information"
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
        rows = [
            [_label(d.vector), _amounts(d.vector, d.units), _amounts(d.formula or d.exact)]
            for d in a.directions
        ]
        parts.append(table(("hidden together", "amounts", "exactly"), rows))
    return lines, [*parts, *map(text, beside)]


def _freeing(first: Audit, t: ManoeuvreTable) -> Said:
    """Which manoeuvre frees which direction."""
    parts = [heading("What frees them"), _table_part(first, t), sentence(f"{_shortest(t)}.")]
    return [*_table_lines(first, t), f"  {_shortest(t)}."], parts


def _shown(a: Audit, run: Degree, wants: Sequence[WantedAccuracy]) -> Said:
    """How well each state shows."""
    rows = _state_rows(a, run)
    scaled = [f"{_scaled(a)}."] if run.singular.size else []
    reached = [f"{_reached(a, run, w)}." for w in wants]
    lines = [*(f"  {w}" for w in (*scaled, *reached)), columns([list(STATE_HEAD), *rows])]
    caption = f"After {run.t[-1]:g} s of {a.manoeuvre.name}"
    parts = [heading(f"How well states show along {a.manoeuvre.name}"), *(text(w) for w in scaled)]
    return lines, [
        *parts,
        *(sentence(w) for w in reached),
        table(STATE_HEAD, rows, caption),
        _picture(a, run),
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
        for k, (name, s) in enumerate(zip(_names(a), a.model.states))
    ]


def _reached(a: Audit, run: Degree, w: WantedAccuracy) -> str:
    k = next(i for i, s in enumerate(a.model.states) if s.name == w.state)
    seconds = run.reaches(k, w.sigma)
    if seconds is None:
        return f"{_names(a)[k]} does not reach {w.written} within {run.t[-1] / 60:.3g} min"
    return f"{_names(a)[k]} reaches {w.written} after {seconds / 60:.3g} min"


def _picture(a: Audit, run: Degree) -> PagePart:
    """Deviations against time, a panel for each unit; hidden states are dashed."""
    names, panels, some = _names(a), [], thin(run.t)
    for unit in dict.fromkeys(s.unit for s in a.model.states):
        lines = [
            Line(names[k], run.t[some], run.sigma[some, k], "", dashed=s.name in a.hidden_states)
            for k, s in enumerate(a.model.states)
            if s.unit == unit and s.prior > 0.0
        ]
        if lines:
            panels.append((f"deviation [{unit}]", lines))
    picture = partial(curves_picture, panels, f"{a.model.name}-{a.manoeuvre.name}")
    return figure(picture, f"Deviations along {a.manoeuvre.name}; dashed: exactly unobservable")


def _label(vector: Mapping[str, float]) -> str:
    return " + ".join(vector)


def _amounts(vector: Mapping[str, Any], units: Mapping[str, str] | None = None) -> str:
    if units is None:
        return ", ".join(f"{n} = {v}" for n, v in vector.items())
    return ", ".join(
        f"{n} = {v:.6g} {'' if units[n] == '1' else units[n]}".strip() for n, v in vector.items()
    )


def _cells(row: Sequence[bool | None]) -> list[str]:
    return [UNKNOWN if free is None else FREED if free else HIDDEN for free in row]


def _table_lines(first: Audit, t: ManoeuvreTable) -> list[str]:
    lines = []
    for k in range(0, len(t.manoeuvres), AT_ONCE):
        head = [f"hidden at {first.manoeuvre.name}", *(m.name for m in t.manoeuvres[k : k + AT_ONCE])]
        rows = [
            [_label(d.vector), *_cells(row[k : k + AT_ONCE])] for d, row in zip(first.directions, t.freed)
        ]
        lines.append(columns([head, *rows]))
    return lines


def _table_part(first: Audit, t: ManoeuvreTable) -> PagePart:
    head = (f"hidden at {first.manoeuvre.name}", *(m.name for m in t.manoeuvres))
    rows = [[_label(d.vector), *_cells(row)] for d, row in zip(first.directions, t.freed)]
    return table(head, rows, "Every cell is exact")


def _shortest(t: ManoeuvreTable) -> str:
    if t.shortest is not None:
        return f"The shortest manoeuvre that frees all: {t.shortest.name} ({t.shortest.title}), {t.shortest.length:g} s"
    best = max(t.manoeuvres, key=lambda m: _count(t, m))
    count = _count(t, best)
    if not count:
        return "No manoeuvre here frees any of them"
    return f"No manoeuvre here frees all; {best.name} frees {count} of {len(t.freed)}"


def _count(t: ManoeuvreTable, m: Manoeuvre) -> int:
    """How many directions a manoeuvre frees."""
    return sum(bool(row[t.manoeuvres.index(m)]) for row in t.freed)


def _table_data(first: Audit, t: ManoeuvreTable | None) -> dict[str, Any] | None:
    if t is None:
        return None
    return {
        "manoeuvres": [m.name for m in t.manoeuvres],
        "rows": [
            {"direction": _label(d.vector), "cells": _cells(row)} for d, row in zip(first.directions, t.freed)
        ],
        "shortest": t.shortest.name if t.shortest is not None else None,
    }


def _data(a: Audit, wants: Sequence[WantedAccuracy]) -> dict[str, Any]:
    run = a.degree
    condition = {"raw": finite(a.numeric.condition)}
    out: dict[str, Any] = {
        "states": a.states,
        "rank": a.rank,
        "nullity": a.nullity,
        "recorded": a.recorded,
        "point": "generic" if a.generic else "declared",
        "condition": condition,
        "numeric_rank": a.numeric.rank,
        "directions": [
            {
                "vector": d.vector,
                "units": d.units,
                "exact": d.exact,
                "formula": d.formula,
                "sentence": d.sentence,
                "freed_by": list(d.freed_by),
            }
            for d in a.directions
        ],
        "state": {n: _state(a, k) for k, n in enumerate(_names(a))},
    }
    if run is not None:
        condition["scaled"] = finite(run.condition) if run.singular.size else None
        out["weakest"] = [_names(a)[k] for k, _ in run.weakest]
        out["sigmas_of_information"] = [finite(float(s)) for s in run.singular]
        out["duration_s"] = float(run.t[-1])
        out["wanted"] = [
            {"state": w.state, "sigma": w.sigma, "reached_s": run.reaches(_index(a, w.state), w.sigma)}
            for w in wants
        ]
    return out


def _index(a: Audit, name: str) -> int:
    return next(i for i, s in enumerate(a.model.states) if s.name == name)


def _state(a: Audit, k: int) -> dict[str, Any]:
    s, run = a.model.states[k], a.degree
    out: dict[str, Any] = {"verdict": a.verdict(k), "sigma_prior": s.prior, "unit": parse_unit(s.unit).text}
    if run is not None:
        out["sigma_end"] = finite(float(run.sigma[-1, k]))
        out["bits_per_minute"] = finite(float(np.round(run.bits_per_minute[k], 12)))
    return out
