"""The answer of ``fleet``: what sensors of one kind have in common, and which is not like the others."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence

import numpy as np

from kfgen.core.numbers import quantity
from kfgen.core.units import from_si
from kfgen.fleet.answer import SensorNumber
from kfgen.fleet.population import Interval
from kfgen.fleet.result import (
    FALSE_ALARM_SHARE_OF_FLEETS,
    FleetResult,
    PooledNumber,
    SensorEstimate,
    shown_unit,
)
from kfgen.report.page import Answer, Page, PagePart, columns, figure, heading, table, text
from kfgen.report.plots import Dot, Picture, dots_picture

MAX_LOG_SPREAD_SAID_IN_PER_CENT = 0.3
"""Spread in logarithms up to which it is said in per cent, beyond as a factor."""
MAX_LOG_SPREAD_PRINTED = 5.0
"""Spread in logarithms beyond which an interval has no upper end worth printing."""
_HEAD = ("number", "sensors", "typical, 95 %", "between sensors, 95 %", "95 % prediction interval")
_VALUES = ("log", "number", "value", "95 % interval", "")
_EFFECTS = ("channel", "effect", "found in", "")


def fleet_answer(fleet: FleetResult) -> Answer:
    """Text, JSON and page of a fleet."""
    names = short_names([o.log for o in (*fleet.done, *fleet.failed)])
    words, outlying = _sentences(fleet, names), _outlier_rows(fleet, names)
    lines, verdict = [f"{w}." for w in words], tuple(f"{w}." for w in words)
    parts = [text(f"Not used: {o.complaint}.") for o in fleet.failed]
    for channel in dict.fromkeys(s.number.channel for s in fleet.numbers):
        numbers = [s for s in fleet.numbers if s.number.channel == channel]
        rows, values = [_row(s, fleet) for s in numbers], _value_rows(numbers, names)
        lines += ["", channel, columns([_HEAD, *rows]), "", columns(values)]
        parts += [heading(channel), table(_HEAD, rows), *(_figure(s, names) for s in numbers)]
        parts.append(table(_VALUES, values))
    found = [
        [e.channel, e.effect, f"{len(e.logs)} of {e.of}", _which(e.kind, e.logs, names)]
        for e in fleet.effects
    ]
    lines += ["", "effects", columns(found)] if found else []
    parts += [heading("Effects"), table(_EFFECTS, found)] if found else []
    lines += ["", _OUTLIERS, columns(outlying)] if outlying else []
    parts += (
        [heading("Not like the others"), text(f"{_OUTLIERS}."), table(("log", "number", "", ""), outlying)]
        if outlying
        else []
    )
    lines += [*([""] if fleet.failed else []), *(f"not used: {o.complaint}" for o in fleet.failed)]
    page = Page("Sensors of one kind", tuple(parts), verdict)
    return Answer("\n".join(lines), fleet.to_dict(), page, ok=not fleet.failed, warnings=fleet.warnings)


_OUTLIERS = (
    f"outliers; in about {100 * FALSE_ALARM_SHARE_OF_FLEETS:g} % of fleets without an outlier one is named"
)


def short_names(paths: Sequence[str]) -> dict[str, str]:
    """Paths without the folder that all of them have."""
    if len(paths) < 2:
        return {p: os.path.basename(p) for p in paths}
    folder = os.path.commonpath([os.path.dirname(os.path.abspath(p)) for p in paths])
    return {p: os.path.relpath(os.path.abspath(p), folder) for p in paths}


def _sentences(fleet: FleetResult, names: Mapping[str, str]) -> list[str]:
    """What was read, then what differs, then which are outliers, in words."""
    failed = f"; {len(fleet.failed)} could not be used" if fleet.failed else ""
    many = "1 log was" if len(fleet.done) == 1 else f"{len(fleet.done)} logs were"
    words = [f"{many} {'compared with ' + fleet.model if fleet.model else 'identified'}{failed}"]
    if fleet.model:
        verdicts = [o.answer.verdict for o in fleet.done if o.answer]
        words.append(", ".join(f"{v} in {verdicts.count(v)}" for v in sorted(set(verdicts))))
        words += [
            f"The model of {e.channel} is missing {e.effect} in all of them"
            for e in fleet.effects
            if e.kind == "common"
        ]
    widest = max((s for s in fleet.numbers if _differs(s)), key=_excess, default=None)
    if widest is not None:
        words.append(
            f"The spread between the sensors exceeds their measurement uncertainty, most in {widest.number.channel} "
            f"{widest.number.label}: {_spread(widest)}"
        )
    elif any(s.population and s.population.size > 2 for s in fleet.numbers):
        words.append("In no number does the spread between the sensors exceed their measurement uncertainty")
    outlying: dict[str, list[str]] = {}
    for s in fleet.numbers:
        for r, _ in s.outliers:
            outlying.setdefault(names[r.log], []).append(f"{s.number.channel} {s.number.label}")
    words += [
        f"{log} is not like the others in {', '.join(which)}" for log, which in sorted(outlying.items())
    ]
    words += [f"{names[c.log]}: {c.sentence}" for c in fleet.clocks]
    if fleet.tested and not outlying and not fleet.clocks:
        words.append("None of them is an outlier")
    return words


def _differs(s: PooledNumber) -> bool:
    return s.population is not None and s.population.size > 2 and s.population.spread95[0] > 0.0


def _excess(s: PooledNumber) -> float:
    """The least spread that the intervals allow: of logarithms, or over the mean."""
    assert s.population is not None
    least = s.population.spread95[0]
    return least if s.number.positive else least / max(abs(s.population.mean), 1e-300)


def _span(s: PooledNumber, interval: Interval) -> str:
    """An interval of the population's scale in the shown unit."""
    if not np.isfinite(interval).all():
        return "unknown"
    unit = shown_unit(s.unit)
    return " to ".join(f"{from_si(s.value(v), unit):.4g}" for v in interval)


def _row(s: PooledNumber, fleet: FleetResult) -> list[str]:
    p = s.population
    have = len({r.log for r in s.estimates})
    row = [s.number.label, f"{have} of {_of(s.number, fleet)}"]
    if p is None:
        return [*row, "no closed interval" if s.number.lasting else "of each record its own", "", ""]
    typical = quantity(s.value(p.mean), shown_unit(s.unit))
    if p.size < 2:
        return [*row, typical, "", ""]
    if p.size < 3:  # the interval of a mean of two says nothing
        return [*row, typical, _spread(s), ""]
    return [*row, f"{typical} ({_span(s, p.mean95)})", _spread(s), _span(s, p.next95)]


def _of(number: SensorNumber, fleet: FleetResult) -> int:
    return next(e.of for e in fleet.effects if (e.channel, e.effect) == (number.channel, number.effect))


def _spread(s: PooledNumber) -> str:
    """The spread between sensors with its interval, in per cent, as a factor, or in the unit."""
    assert s.population is not None
    value, (lo, hi) = s.population.spread, s.population.spread95
    if not s.number.positive:
        unit = shown_unit(s.unit)
        scale = from_si(1.0, unit) - from_si(0.0, unit)
        return f"{value * scale:.3g} {unit} ({lo * scale:.2g} to {hi * scale:.2g})"
    if hi <= MAX_LOG_SPREAD_SAID_IN_PER_CENT:
        return f"{100 * value:.2g} % ({100 * lo:.2g} to {100 * hi:.2g} %)"
    end = (
        f"{np.exp(lo):.3g} to {np.exp(hi):.3g}"
        if hi < MAX_LOG_SPREAD_PRINTED
        else f"at least {np.exp(lo):.3g}"
    )
    return f"a factor of {np.exp(value):.3g} ({end})"


def _value_rows(numbers: Sequence[PooledNumber], names: Mapping[str, str]) -> list[list[str]]:
    rows = []
    for log in sorted({r.log for s in numbers for r in s.estimates}):
        for s in numbers:
            for r in (r for r in s.estimates if r.log == log):
                rows.append([names[log], s.number.label, *_value(s, r), "outlier" if s.is_outlier(r) else ""])
    return rows


def _value(s: PooledNumber, r: SensorEstimate) -> tuple[str, str]:
    unit = shown_unit(s.unit)
    closed = (
        f"{from_si(r.estimate.lo, unit):.4g} to {from_si(r.estimate.hi, unit):.4g}"
        if r.is_closed(False)
        else "not known"
    )
    return quantity(r.estimate.value, unit), closed


def _outlier_rows(fleet: FleetResult, names: Mapping[str, str]) -> list[list[str]]:
    return [
        [
            names[r.log],
            f"{s.number.channel} {s.number.label}",
            quantity(r.estimate.value, shown_unit(s.unit)),
            f"{a.deviations:.3g} standard deviations from the others, adjusted p {fleet.adjusted(a):.2g}",
        ]
        for s in fleet.numbers
        for r, a in s.outliers
    ]


def _which(kind: str, logs: Sequence[str], names: Mapping[str, str]) -> str:
    if kind == "common":
        return "common to all"
    return ("one-off: " if kind == "one-off" else "") + ", ".join(names[log] for log in logs)


def _figure(s: PooledNumber, names: Mapping[str, str]) -> PagePart:
    return figure(
        _dots(s, names),
        f"{s.number.label} of each sensor with its 95 % interval; grey, the 95 % prediction interval of a new sensor.",
    )


def fleet_pictures(fleet: FleetResult) -> list[tuple[str, Picture]]:
    """Each number of each sensor with its interval, titled by channel and number."""
    names = short_names([o.log for o in (*fleet.done, *fleet.failed)])
    return [(f"{s.number.channel}: {s.number.label}", _dots(s, names)) for s in fleet.numbers]


def _dots(s: PooledNumber, names: Mapping[str, str]) -> Picture:
    unit = shown_unit(s.unit)

    def shown(value: float) -> float:
        return float(from_si(value, unit))

    dots = [
        Dot(
            names[r.log], shown(r.estimate.value), shown(r.estimate.lo), shown(r.estimate.hi), s.is_outlier(r)
        )
        for r in s.estimates
    ]
    band = (np.nan, np.nan)
    if s.population and np.isfinite(s.population.next95).all():
        band = (shown(s.value(s.population.next95[0])), shown(s.value(s.population.next95[1])))
    key = f"fleet-{s.number.channel}-{s.number.label}"
    label = f"{s.number.label} [{unit}]"
    return dots_picture(dots, band, label, key, s.number.positive)
