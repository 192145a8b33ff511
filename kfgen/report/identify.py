"""The answer of ``identify``: text and page of an `Identification`."""

from __future__ import annotations

import numpy as np

from kfgen.core.numbers import few_digits, quantity
from kfgen.core.units import derived_unit, display_unit, from_si, parse_unit
from kfgen.effects.effect import Parameter
from kfgen.effects.noise_model import noise_text
from kfgen.identify.fit.limits import Limit
from kfgen.identify.fit.lines import PeriodicLine
from kfgen.identify.identification import (
    Identification,
    IdentifiedChannel,
    IdentifiedEffect,
    expected_deviation,
)
from kfgen.identify.words import measured_by, no_limit
from kfgen.report.convert import meaning_parts
from kfgen.report.page import (
    Answer,
    Page,
    code,
    columns,
    figure,
    heading,
    sentence,
    source_words,
    table,
    text,
)
from kfgen.report.plots import AFTER, BEFORE, Line, Panel, panels_picture

MAX_PANELS = 12
"""Channels that are drawn side by side."""
SHOWN_BOUND = 10.0
"""Relative standard deviation from which a record says nothing of a parameter [1]."""


def identify_answer(found: Identification) -> Answer:
    """Text, JSON and page of what was identified."""
    lines, parts = [], []
    for name, channel in found.channels.items():
        unit = display_unit(channel.unit)
        rows, missing = _rows(channel, unit), _missing(channel, unit)
        words = channel.fitted.record.words
        lines += ["", f"{name}: {words}", columns(rows)]
        lines += [f"  {e.name}: {e.said(unit)}" for e in channel.effects if not e.values]
        lines += [f"  {line}" for line in missing]
        parts += [
            heading(name),
            *(sentence(f"{e.effect.sentence(name, unit)}.") for e in channel.effects if is_shown(e)),
            figure(
                panels_picture([panel(channel, "")], f"allan-{name}"),
                f"Allan deviation of {name}, {words}; the curve is the identified model.",
            ),
            table(
                ("effect", "parameter", "value", "95 % interval", "Cramér-Rao bound"),
                [[*r[:3], r[3].removeprefix("95 % "), r[4].removeprefix("bound ")] for r in rows],
            ),
            *meaning_parts(name, tuple(e.effect for e in channel.effects), unit),
            *(
                [table(("what this record cannot tell",), [[m] for m in missing], "Limits", True)]
                if missing
                else []
            ),
            *(text(w) for w in channel.warnings),
        ]
    if 1 < len(found.channels) <= MAX_PANELS:
        panels = [panel(c, name) for name, c in found.channels.items()]
        parts.insert(
            0, figure(panels_picture(panels, "allan"), "Allan deviations of all channels, on the same page.")
        )
    verdict = (
        *(f"{w[0].upper()}{w[1:]}." for w in found.cautions),
        *(f"{name}: {one_line(c) or 'nothing was identified'}." for name, c in found.channels.items()),
    )
    said = [[w] for w in found.warnings if w not in found.cautions]
    parts += [table(("what the reader and the fits say",), said, "Warnings", folded=True)] if said else []
    facts = (*(("log", source_words(*log)) for log in found.logs), ("method", found.method))
    saved = code(noise_text(found.noise), "The noise file, ready to be copied", folded=True)
    page = Page(
        f"Sensor noise in {found.logs[0][0].rsplit('/', 1)[-1]}", (*parts, saved), verdict, None, facts
    )
    return Answer("\n".join(lines).lstrip("\n"), found.to_dict(), page, warnings=found.warnings)


def _rows(channel: IdentifiedChannel, unit: str) -> list[list[str]]:
    """A row for each estimated parameter."""
    rows = []
    for e in channel.effects:
        for p in e.effect.estimated():
            u = derived_unit(p.unit, unit)
            lo, hi = e.ci95[p.name]
            bound = e.crlb_rel.get(p.name)
            rows.append(
                [
                    e.name,
                    p.name,
                    quantity(e.values[p.name], u),
                    f"95 % {from_si(lo, u):.4g} to {_end(hi, u)}",
                    _bound(bound),
                ]
            )
    return rows


def _end(hi: float, unit: str) -> str:
    """The upper end of an interval [SI], where the record has one."""
    return f"{from_si(hi, unit):.4g}" if np.isfinite(hi) else "unbounded by this record"


def _bound(bound: float | None) -> str:
    """The Cramér-Rao bound in words."""
    if bound is None:
        return ""
    return (
        f"bound {few_digits(100 * bound)} %"
        if bound < SHOWN_BOUND
        else "no bound: the record does not show it"
    )


def one_line(channel: IdentifiedChannel) -> str:
    """What was found of a channel, in one line."""
    parts, unit = [], display_unit(channel.unit)
    for e in channel.effects:
        sizes = [_size(e, p, derived_unit(p.unit, unit)) for p in e.effect.estimated()] or [e.said(unit)]
        parts.append(sizes[0] if len(sizes) == 1 else f"{e.name} ({', '.join(sizes)})")
    tones = [f"{line.frequency:.3g}" for line in channel.lines]
    parts += [f"line {tones[0]} Hz"] if len(tones) == 1 else []
    parts += [f"{len(tones)} lines at {tones[0]} to {tones[-1]} Hz"] if len(tones) > 1 else []
    return ", ".join(parts) + ("; a drift of unknown kind" if channel.fitted.unresolved else "")


def _size(e: IdentifiedEffect, p: Parameter, unit: str) -> str:
    """A parameter in short: its value, or its limit where it may be zero."""
    lo, hi = e.ci95[p.name]
    if lo > 0.0 or p.kind != "size":
        return f"{p.name} {quantity(e.values[p.name], unit)}"
    return f"{p.name} below {quantity(hi, unit)}" if np.isfinite(hi) else f"{p.name} unknown"


def is_shown(e: IdentifiedEffect) -> bool:
    """Whether the record shows an effect: a size that may be zero is a limit, and no sentence is made of it."""
    sizes = [e.ci95[name] for name in e.effect.sizes() if name in e.ci95]
    return not sizes or any(lo > 0.0 for lo, _ in sizes)


def _missing(channel: IdentifiedChannel, unit: str) -> list[str]:
    """Spectral lines that were found, then what the record cannot show."""
    lines = [
        f"line at {line.frequency:.4g} Hz{_multiple(line)}, amplitude {quantity(line.amplitude, unit)}, "
        "removed before the fit"
        for line in channel.lines
    ]
    return lines + [_limit(limit, channel.fitted.record.longest, unit) for limit in channel.limits]


def _multiple(line: PeriodicLine) -> str:
    """Of which line it is a harmonic, in words."""
    return f" (harmonic {line.harmonic} of {line.fundamental:.4g} Hz)" if line.fundamental else ""


def _limit(limit: Limit, seconds: float, unit: str) -> str:
    """An upper limit in words, of a record of so many seconds, or why there is none."""
    if not limit.is_known:
        return f"{limit.effect.name} {limit.parameter} is {no_limit(limit.ended_early)}"
    u = derived_unit({p.name: p.unit for p in limit.effect.parameters()}[limit.parameter], unit)
    times = [
        f" (at {p.name} = {getattr(limit.effect, p.name):.3g} s)"
        for p in limit.effect.parameters()
        if p.kind == "time"
    ]
    return (
        f"not identifiable in {seconds:.0f} s: {limit.effect.name} {limit.parameter} below "
        f"{quantity(limit.upper95, u)}{''.join(times)} at 95 %; {measured_by(limit.hours)}"
    )


def panel(channel: IdentifiedChannel, title: str) -> Panel:
    """The Allan deviation of a channel with its model, as a panel of a picture.

    Parameters
    ----------
    channel : IdentifiedChannel
    title : str
        Above the panel; may be empty.
    """
    found, unit = channel.fitted, display_unit(channel.unit)
    curve = found.record.curve
    seen = curve.tau >= 0.999 * found.record.dt  # of a published curve the first points may be left out
    tau = curve.tau[seen]
    written = expected_deviation(found.record, tuple(e.effect for e in channel.effects))[seen]
    lines = [Line("model, as written", tau, written, AFTER)]
    if found.unresolved:
        whole = expected_deviation(found.record, found.fit.effects)[seen]
        lines.append(Line("with the drift that is not resolved", tau, whole, BEFORE, dashed=True))
    return Panel(curve, lines, unit, parse_unit(unit).factor, title)
