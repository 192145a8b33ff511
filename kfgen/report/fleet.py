"""The answer of ``fleet``: what sensors of one kind have in common, and which is not like the others."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

import kfgen
from kfgen.core.errors import InputError
from kfgen.core.numbers import finite, quantity
from kfgen.core.units import display_unit, from_si
from kfgen.effects import make
from kfgen.effects.noise_model import ChannelNoise, NoiseModel, Term
from kfgen.fleet.fleet import RATE, Fleet, Outcome, Shared
from kfgen.fleet.population import TESTED, Interval
from kfgen.fleet.reading import LogReading, ReadNumber
from kfgen.report.page import Answer, Page, PagePart, columns, figure, heading, sentence, table, text
from kfgen.report.plots import Dot, dots_picture

MOST_SHARE = 0.3
"""Spread in logarithms up to which it is said in per cent, beyond as a factor."""
BOUNDLESS = 5.0
"""Spread in logarithms beyond which an interval has no upper end worth printing."""
_HEAD = ("number", "sensors", "typical, 95 %", "between sensors, 95 %", "where a new one lies, 95 %")
_VALUES = ("log", "number", "value", "95 % interval", "")
_EFFECTS = ("channel", "effect", "found in", "")


def fleet_answer(fleet: Fleet, model: str = "", hashes: Mapping[str, str] | None = None) -> Answer:
    """Text, JSON and page of a fleet.

    Parameters
    ----------
    model : str
        What was believed of every sensor; empty where they were identified.
    hashes : mapping of str to str
        SHA-256 of what was read beside the logs, by name.
    """
    names = short_names([o.log for o in (*fleet.done, *fleet.failed)])
    words, apart = _sentences(fleet, model, names), _apart_rows(fleet, names)
    lines, parts = [f"{w}." for w in words], [sentence(f"{w}.") for w in words]
    parts += [text(f"Not used: {o.complaint}.") for o in fleet.failed]
    for channel in dict.fromkeys(s.number.channel for s in fleet.numbers):
        numbers = [s for s in fleet.numbers if s.number.channel == channel]
        rows, values = [_row(s, fleet) for s in numbers], _value_rows(numbers, names)
        lines += ["", channel, columns([_HEAD, *rows]), "", columns(values)]
        parts += [heading(channel), table(_HEAD, rows), *(_figure(s, names) for s in numbers)]
        parts.append(table(_VALUES, values))
    found = [
        [t.found.channel, t.found.effect, f"{len(t.logs)} of {t.of}", _which(t.kind, t.logs, names)]
        for t in fleet.tallies
    ]
    lines += ["", "effects", columns(found)] if found else []
    parts += [heading("Effects"), table(_EFFECTS, found)] if found else []
    lines += ["", _APART, columns(apart)] if apart else []
    parts += (
        [heading("Not like the others"), text(f"{_APART}."), table(("log", "number", "", ""), apart)]
        if apart
        else []
    )
    lines += [*([""] if fleet.failed else []), *(f"not used: {o.complaint}" for o in fleet.failed)]
    said = tuple(f"{o.log}: {w}" for o in fleet.done for w in o.warnings)
    page = Page("Sensors of one kind", tuple(parts))
    data = _data(fleet, model, dict(hashes or {}))
    return Answer("\n".join(lines), data, page, ok=not fleet.failed, warnings=said)


_APART = (
    f"sensors apart from their fleet; in about {100 * RATE:g} % of fleets without such a sensor one is named"
)


def short_names(paths: Sequence[str]) -> dict[str, str]:
    """Paths without the folder that all of them have."""
    if len(paths) < 2:
        return {p: os.path.basename(p) for p in paths}
    folder = os.path.commonpath([os.path.dirname(os.path.abspath(p)) for p in paths])
    return {p: os.path.relpath(os.path.abspath(p), folder) for p in paths}


def _sentences(fleet: Fleet, model: str, names: Mapping[str, str]) -> list[str]:
    """What was read, then what differs, then who is apart, in words."""
    failed = f"; {len(fleet.failed)} could not be used" if fleet.failed else ""
    many = "1 log was" if len(fleet.done) == 1 else f"{len(fleet.done)} logs were"
    words = [f"{many} {'held against ' + model if model else 'identified'}{failed}"]
    if model:
        verdicts = [str((o.data or {}).get("verdict")) for o in fleet.done]
        words.append(", ".join(f"{v} in {verdicts.count(v)}" for v in sorted(set(verdicts))))
        words += [
            f"{t.found.channel} misses {t.found.effect} in all of them"
            for t in fleet.tallies
            if t.kind == "common"
        ]
    widest = max((s for s in fleet.numbers if _differs(s)), key=_excess, default=None)
    if widest is not None:
        words.append(
            f"The sensors differ by more than their intervals, most in {widest.number.channel} "
            f"{widest.number.label}: {_spread(widest)}"
        )
    elif any(s.population and s.population.size > 2 for s in fleet.numbers):
        words.append("No number differs between the sensors by more than its intervals")
    apart: dict[str, list[str]] = {}
    for s in fleet.numbers:
        for r, _ in s.outliers:
            apart.setdefault(names[r.log], []).append(f"{s.number.channel} {s.number.label}")
    words += [f"{log} is not like the others in {', '.join(which)}" for log, which in sorted(apart.items())]
    if fleet.tested and not apart:
        words.append("None of them is apart from the others")
    return words


def _differs(s: Shared) -> bool:
    return s.population is not None and s.population.size > 2 and s.population.spread95[0] > 0.0


def _excess(s: Shared) -> float:
    """The least spread that the intervals allow: of logarithms, or over the mean."""
    assert s.population is not None
    least = s.population.spread95[0]
    return least if s.number.positive else least / max(abs(s.population.mean), 1e-300)


def shown_unit(unit: str) -> str:
    """A unit of SI as a person reads it: degrees, microtesla."""
    if unit.startswith("rad"):
        return "deg" + unit[3:]
    return display_unit(unit)


def _span(s: Shared, interval: Interval) -> str:
    """An interval of the population's scale in the shown unit."""
    if not np.isfinite(interval).all():
        return "unknown"
    unit = shown_unit(s.unit)
    return " to ".join(f"{from_si(s.back(v), unit):.4g}" for v in interval)


def _row(s: Shared, fleet: Fleet) -> list[str]:
    p = s.population
    have = len({r.log for r in s.readings})
    row = [s.number.label, f"{have} of {_of(s.number, fleet)}"]
    if p is None:
        return [*row, "no closed interval" if s.number.lasting else "of each record its own", "", ""]
    typical = quantity(s.back(p.mean), shown_unit(s.unit))
    if p.size < 2:
        return [*row, typical, "", ""]
    if p.size < 3:  # the interval of a mean of two says nothing
        return [*row, typical, _spread(s), ""]
    return [*row, f"{typical} ({_span(s, p.mean95)})", _spread(s), _span(s, p.next95)]


def _of(number: ReadNumber, fleet: Fleet) -> int:
    return next(
        t.of for t in fleet.tallies if (t.found.channel, t.found.effect) == (number.channel, number.effect)
    )


def _spread(s: Shared) -> str:
    """The spread between sensors with its interval, in per cent, as a factor, or in the unit."""
    assert s.population is not None
    value, (lo, hi) = s.population.spread, s.population.spread95
    if not s.number.positive:
        unit = shown_unit(s.unit)
        scale = from_si(1.0, unit) - from_si(0.0, unit)
        return f"{value * scale:.3g} {unit} ({lo * scale:.2g} to {hi * scale:.2g})"
    if hi <= MOST_SHARE:
        return f"{100 * value:.2g} % ({100 * lo:.2g} to {100 * hi:.2g} %)"
    end = f"{np.exp(lo):.3g} to {np.exp(hi):.3g}" if hi < BOUNDLESS else f"at least {np.exp(lo):.3g}"
    return f"a factor of {np.exp(value):.3g} ({end})"


def _value_rows(numbers: Sequence[Shared], names: Mapping[str, str]) -> list[list[str]]:
    rows = []
    for log in sorted({r.log for s in numbers for r in s.readings}):
        for s in numbers:
            for r in (r for r in s.readings if r.log == log):
                rows.append([names[log], s.number.label, *_value(s, r), "apart" if _is_apart(s, r) else ""])
    return rows


def _value(s: Shared, r: LogReading) -> tuple[str, str]:
    unit = shown_unit(s.unit)
    closed = f"{from_si(r.lo, unit):.4g} to {from_si(r.hi, unit):.4g}" if r.known(False) else "not known"
    return quantity(r.value, unit), closed


def _is_apart(s: Shared, r: LogReading) -> bool:
    return any(r is out for out, _ in s.outliers)


def _apart_rows(fleet: Fleet, names: Mapping[str, str]) -> list[list[str]]:
    return [
        [
            names[r.log],
            f"{s.number.channel} {s.number.label}",
            quantity(r.value, shown_unit(s.unit)),
            f"{a.deviations:.3g} deviations from the others, adjusted p {min(1.0, a.p * fleet.tested):.2g}",
        ]
        for s in fleet.numbers
        for r, a in s.outliers
    ]


def _which(kind: str, logs: Sequence[str], names: Mapping[str, str]) -> str:
    if kind == "common":
        return "common to all"
    return ("one-off: " if kind == "one-off" else "") + ", ".join(names[log] for log in logs)


def _figure(s: Shared, names: Mapping[str, str]) -> PagePart:
    unit = shown_unit(s.unit)

    def shown(value: float) -> float:
        return float(from_si(value, unit))

    dots = [Dot(names[r.log], shown(r.value), shown(r.lo), shown(r.hi), _is_apart(s, r)) for r in s.readings]
    band = (np.nan, np.nan)
    if s.population and np.isfinite(s.population.next95).all():
        band = (shown(s.back(s.population.next95[0])), shown(s.back(s.population.next95[1])))
    key = f"fleet-{s.number.channel}-{s.number.label}"
    label = f"{s.number.label} [{unit}]"
    return figure(
        dots_picture(dots, band, label, key, s.number.positive),
        f"{s.number.label} of each sensor with its 95 % interval; grey, where a new sensor lies.",
    )


def typical(fleet: Fleet) -> NoiseModel:
    """The noise of a typical sensor: effects that most have, at the population's median.

    The interval written beside each value is that in which a new sensor lies: what ``gap`` takes it for.

    Raises
    ------
    InputError
        No effect is found in more than half of the logs.
    """
    channels: dict[str, ChannelNoise] = {}
    for t in fleet.tallies:
        own = [
            s
            for s in fleet.numbers
            if (s.number.channel, s.number.effect) == (t.found.channel, t.found.effect)
        ]
        for place in sorted({s.number.place for s in own}):
            numbers = [s for s in own if s.number.place == place]
            if all(2 * len(s.readings) > t.of and s.population for s in numbers):
                old = channels.get(t.found.channel) or ChannelNoise(_unit(fleet, t.found.channel), ())
                channels[t.found.channel] = replace(old, terms=(*old.terms, _term(numbers)))
    if not channels:
        raise InputError("no effect is found in more than half of the logs", remedy="Leave -o out")
    return NoiseModel(channels, {"logs": str(len(fleet.done)), "kfgen": kfgen.__version__})


def _unit(fleet: Fleet, channel: str) -> str:
    """Of a channel, as a person reads it."""
    having = (o.data or {} for o in fleet.done)
    return shown_unit(next(d["channels"][channel]["unit"] for d in having if channel in d["channels"]))


def _term(numbers: Sequence[Shared]) -> Term:
    values, ci95 = {}, {}
    for s in numbers:
        assert s.population is not None
        values[s.number.parameter] = s.back(s.population.mean)
        lo, hi = (s.back(v) for v in s.population.next95)
        if s.population.size > 2 and np.isfinite([lo, hi]).all():
            ci95[s.number.parameter] = (lo, hi)
    return Term(make(numbers[0].number.effect, **values), ci95)


def _data(fleet: Fleet, model: str, hashes: dict[str, str]) -> dict[str, Any]:
    return {
        "format": "kfgen-fleet-1",
        "kfgen": kfgen.__version__,
        "task": "gap" if model else "identify",
        **({"model": model, "model_sha256": hashes.get(model)} if model else {}),
        "logs": [_log(o, model) for o in (*fleet.done, *fleet.failed)],
        "numbers": [_number(s) for s in fleet.numbers],
        "effects": [
            {
                "channel": t.found.channel,
                "effect": t.found.effect,
                "found_in": len(t.logs),
                "of": t.of,
                "kind": t.kind,
                "logs": list(t.logs),
            }
            for t in fleet.tallies
        ],
        "outliers": [
            {
                "log": r.log,
                "channel": s.number.channel,
                "effect": s.number.effect,
                "place": s.number.place,
                "parameter": s.number.parameter,
                "value": r.value,
                "unit": s.unit,
                "deviations": a.deviations,
                "p_adjusted": min(1.0, a.p * fleet.tested),
            }
            for s in fleet.numbers
            for r, a in s.outliers
        ],
        "outlier_rate": RATE,
        "outliers_tested": {"numbers": fleet.tested, "from_sensors": TESTED},
    }


def _log(o: Outcome, model: str) -> dict[str, Any]:
    out: dict[str, Any] = {"log": o.log, "sha256": o.sha256 or None}
    if o.data is None:
        return out | {"error": o.error}
    return out | ({"verdict": o.data["verdict"]} if model else {}) | {"warnings": list(o.warnings)}


def _number(s: Shared) -> dict[str, Any]:
    p = s.population
    return {
        "channel": s.number.channel,
        "effect": s.number.effect,
        "place": s.number.place,
        "parameter": s.number.parameter,
        "unit": s.unit,
        "scale": "logarithm" if s.number.positive else "linear",
        "values": [
            {"log": r.log, "value": r.value, "ci95": [finite(r.lo), finite(r.hi)], "outlier": _is_apart(s, r)}
            for r in s.readings
        ],
        "population": p
        and {
            "sensors": p.size,
            "median": s.back(p.mean),
            "median_ci95": [finite(s.back(v)) for v in p.mean95] if p.size > 1 else None,
            "spread": p.spread,
            "spread_ci95": [finite(v) for v in p.spread95],
            "new_sensor95": [finite(s.back(v)) for v in p.next95] if p.size > 2 else None,
        },
    }
