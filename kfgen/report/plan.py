"""The answer of ``plan``: how long to log."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

import kfgen
from kfgen.core.numbers import finite
from kfgen.effects import Effect
from kfgen.effects.noise_model import NoiseModel
from kfgen.identify.fit.bounds import relative_bound, seconds_for
from kfgen.report.page import Answer, Page, PagePart, columns, figure, heading, sentence, table
from kfgen.report.plots import AFTER, BEFORE, MEASURED, Line, bound_picture

HOURS = (0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0)
COLORS = (AFTER, BEFORE, MEASURED, "#7a8794", "#3d8b5f", "#8a5fb0")


def plan_answer(noise: NoiseModel, rate: float, wanted: float) -> Answer:
    """The Cramér-Rao bound of every parameter against the length of record."""
    lines: list[str] = []
    parts: list[PagePart] = []
    channels: dict[str, Any] = {}
    for name, channel in noise.channels.items():
        rows, data = _table(channel.effects, rate, wanted)
        head = ["", *(f"{h:g} h" for h in HOURS), f"for {100 * wanted:g} %"]
        lines += [f"{name}: smallest relative deviation of an unbiased estimate", columns([head, *rows]), ""]
        parts += [
            heading(name),
            *(sentence(s) for s in _sentences(data, wanted)),
            table(head, rows),
            figure(_picture(data, name), "Cramér-Rao bound against the length of the record."),
        ]
        channels[name] = data
    data = {
        "format": "kfgen-plan-1",
        "kfgen": kfgen.__version__,
        "rate_hz": rate,
        "wanted": wanted,
        "channels": channels,
    }
    return Answer("\n".join(lines).rstrip(), data, Page("How long to log", tuple(parts)))


def _table(effects: Sequence[Effect], rate: float, wanted: float) -> tuple[list[list[str]], dict[str, Any]]:
    bounds = [relative_bound(effects, 1.0 / rate, max(64, round(h * 3600.0 * rate))) for h in HOURS]
    rows, data = [], {}
    for key in bounds[0]:
        before = sum(e.name == effects[key[0]].name for e in effects[: key[0]])
        label = f"{effects[key[0]].name}{f'_{before + 1}' if before else ''} {key[1]}"
        hours = seconds_for(effects, 1.0 / rate, key, wanted) / 3600.0
        rows.append(
            [label, *(_percent(b[key]) for b in bounds), f"{hours:.2g} h" if np.isfinite(hours) else "never"]
        )
        data[label] = {
            "hours": list(HOURS),
            "bound_rel": [finite(b[key]) for b in bounds],
            "hours_for_wanted": finite(hours),
        }
    return rows, data


def _percent(value: float) -> str:
    if value >= 10.0:
        return "nothing"
    return f"{100 * value:.0f} %" if value >= 0.1 else f"{100 * value:.2g} %"


def _sentences(data: dict[str, Any], wanted: float) -> list[str]:
    return [
        f"{label}: {100 * wanted:g} % takes {d['hours_for_wanted']:.2g} h."
        for label, d in data.items()
        if d["hours_for_wanted"] is not None
    ]


def _picture(data: dict[str, Any], name: str) -> str:
    lines = [
        Line(label, np.array(d["hours"]), np.array(d["bound_rel"], dtype=float), COLORS[i % len(COLORS)])
        for i, (label, d) in enumerate(data.items())
    ]
    return bound_picture(lines, f"plan-{name}")
