"""The answer of ``gap``: a sentence first, then before and after."""

from __future__ import annotations

import difflib
from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

import kfgen
from kfgen.core.units import derived_unit, parse_unit
from kfgen.effects import Effect
from kfgen.effects.noise_model import NoiseModel, noise_text
from kfgen.gap.core.battery import RATE, Test, bands
from kfgen.gap.core.holdout import METRIC, Gap
from kfgen.gap.core.whitener import Whitener
from kfgen.gap.rest.finding import ChannelGap, Finding
from kfgen.identify.evidence.allan import overlapping_variance
from kfgen.identify.evidence.record import Record
from kfgen.identify.evidence.whittle import block_means, residual_ratio
from kfgen.log.log import Log
from kfgen.report.gap_words import finding_sentence, sentences
from kfgen.report.identify import finite, quantity
from kfgen.report.page import Answer, Page, PagePart, code, columns, figure, heading, sentence, table, text
from kfgen.report.plots import (
    AFTER,
    BEFORE,
    MEASURED,
    Line,
    allan_picture,
    bars_picture,
    series_picture,
    spectrum_picture,
    thin,
)

Array = NDArray[np.float64]


def mended_model(noise: NoiseModel, gaps: Mapping[str, ChannelGap]) -> NoiseModel:
    """The noise model with every finding added."""
    return NoiseModel(
        {n: gaps[n].mended if n in gaps else c for n, c in noise.channels.items()}, noise.provenance
    )


def model_diff(before: NoiseModel, after: NoiseModel) -> str:
    """What changes in the noise file."""
    lines = difflib.unified_diff(
        noise_text(before).splitlines(),
        noise_text(after).splitlines(),
        "believed",
        "mended",
        lineterm="",
        n=1,
    )
    return "\n".join(lines)


def gap_answer(log: Log, believed: NoiseModel, gaps: Mapping[str, ChannelGap]) -> Answer:
    """Text, JSON and page of all channels."""
    lines, parts = [], []
    for g in gaps.values():
        checked = [f"  check: {w}" for w in g.checks.words] if g.checks else []
        lines += [f"{w}." for w in sentences(g)] + [columns(_gap_rows(g)), *checked]
        lines += [*(f"  {m}" for m in _limit_lines(g)), ""]
        parts += _parts(g)
    diff = model_diff(believed, mended_model(believed, gaps))
    if diff:
        lines += ["The model changes by", diff]
        parts += [heading("What changes in the model"), code(diff)]
    data = {
        "format": "kfgen-gap-1",
        "kfgen": kfgen.__version__,
        "log": log.source,
        "sha256": log.sha256,
        **gap_data(gaps),
    }
    page = Page(f"Model against {log.source.rsplit('/', 1)[-1]}", tuple(parts))
    return Answer("\n".join(lines).rstrip(), data, page)


def gap_rows(gap: Gap, found: bool) -> list[list[str]]:
    """The gap on held-out data, before and after."""

    def nats(value: float) -> str:
        return f"{value:.3g} nats per sample" if value > 0.0 else "none above chance"

    closed = "nothing to close"
    if gap.before > 0.0 and found:
        lo, hi = gap.ci95
        closed = f"{100 * gap.closed:.0f} % (95 %: {100 * lo:.0f} to {100 * hi:.0f})"
    rows = [["held-out gap before", nats(gap.before)], ["held-out gap after", nats(gap.after)]]
    return [*rows, ["closed", closed]]


def _gap_rows(g: ChannelGap) -> list[list[str]]:
    return [
        *gap_rows(g.gap, bool(g.findings or g.retuned)),
        ["significant tests before", str(sum(t.significant for t in g.before))],
        ["significant tests after", str(sum(t.significant for t in g.after))],
    ]


def _limit_lines(g: ChannelGap) -> list[str]:
    seen = []
    for effect, name, value in g.limits:
        unit = derived_unit({p.name: p.unit for p in effect.parameters()}[name], g.unit)
        times = [
            f" at tau = {getattr(effect, p.name):.3g} s" for p in effect.parameters() if p.kind == "time"
        ]
        seen.append(
            f"would not have been seen: {effect.name} {name} below {quantity(value, unit)}{''.join(times)}"
        )
    return seen


def _parts(g: ChannelGap) -> list[PagePart]:
    key = g.channel
    parts = [
        heading(g.channel),
        *(sentence(f"{w}.") for w in sentences(g)),
        figure(
            partial(_allan, g),
            "Allan deviation: the record with its 95 % band, what the believed model expects of "
            "this record, what the mended model expects.",
        ),
        figure(
            partial(_spectrum, g),
            "What the models leave, over what they expect: one everywhere when a model holds.",
        ),
    ]
    parts += [
        figure(
            partial(_near_line, g, f),
            f"Power near the line at {f.effect.row(g.unit)['frequency'][0]:.6g} Hz.",
        )
        if "frequency" in f.effect.row(g.unit)
        else figure(
            partial(_driven, g, f), f"The record in blocks, and the part that {f.effect.title} explains."
        )
        for f in g.findings
        if f.effect.coefficients()
    ]
    for f in g.findings:
        names = [f.effect.name, *(n for n, _ in f.alternatives[:5])]
        shares = [f.probability, *(p for _, p in f.alternatives[:5])]
        parts.append(
            figure(
                partial(bars_picture, names, shares, "probability", f"rank-{key}-{f.effect.name}"),
                "The candidates by probability.",
            )
        )
    parts += [
        table(("gap", ""), _gap_rows(g)),
        table(
            ("test", "time [s]", "band [Hz]", "power found / expected", "adjusted p"),
            [_test_cells(g, t) for t in g.before if t.significant][:MOST_TESTS]
            or [["none significant", "", "", "", ""]],
            f"Tests that the believed model fails (family-wise rate {100 * RATE:g} %).",
        ),
    ]
    parts += [text(f"Check: {w}.") for w in (g.checks.words if g.checks else ())]
    parts += [text(m) for m in _limit_lines(g)]
    return parts


MOST_TESTS = 15
"""Rows of a table of tests."""


def _test_cells(g: ChannelGap, t: Test) -> list[str]:
    t0 = float(g.record.t[0])
    lo, hi = (t0 + t.span[0], t0 + t.span[1]) if t.span else (t0, float(g.record.t[-1]))
    band = (
        f"{t.band_hz[0]:.4g}" if t.band_hz[0] == t.band_hz[1] else f"{t.band_hz[0]:.2g} to {t.band_hz[1]:.2g}"
    )
    return [t.name, f"{lo:.4g} to {hi:.4g}", band, f"{t.ratio:.3g}", f"{t.p:.2g}"]


def _without(record: Record, effects: Sequence[Effect]) -> Array:
    return record.y - sum(
        (e.mean(record.elapsed, record.drive) for e in effects if e.coefficients()), np.zeros(record.y.size)
    )


def _allan(g: ChannelGap) -> str:
    lines = [_model_line("believed model", g.believed, g, BEFORE)]
    if g.findings or g.retuned:
        lines.append(_model_line("mended model", g.mended.effects, g, AFTER))
    altering = [f.effect.title for f in g.findings if f.effect.changes_samples]
    if altering and g.clean is not None:
        c = g.clean.curve
        lines.append(
            Line(f"measured, without {' and '.join(altering)}", c.tau, c.deviation, AFTER, dashed=True)
        )
    return allan_picture(g.record.curve, lines, g.unit, parse_unit(g.unit).factor, f"gap-allan-{g.channel}")


def _model_line(label: str, effects: Sequence[Effect], g: ChannelGap, color: str) -> Line:
    """A model's Allan deviation on this record: of its noise, and of what it says of time and drivers."""
    tau, record = g.record.curve.tau, g.record
    total = sum((e.allan_variance(tau) for e in effects if not e.coefficients()), np.zeros(tau.size))
    explained = record.y - _without(record, effects)
    if np.ptp(explained) > 0.0:
        total = total + overlapping_variance(explained, np.round(tau / record.dt).astype(np.int64))
    return Line(label, tau, np.sqrt(total), color)


def _spectrum(g: ChannelGap) -> str:
    ratios = []
    for effects, record in ((g.believed, g.record), (g.mended.effects, g.clean or g.record)):
        data = record.ordinates(effects)
        theta = np.array([v for e in effects if e.coefficients() for v in e.values])
        ratio = residual_ratio(data, effects, theta)
        groups = bands(data)
        f = np.array([np.sqrt(data.frequency[lo] * data.frequency[hi - 1]) for lo, hi in groups])
        ratios.append(
            np.array([data.count[lo:hi] @ ratio[lo:hi] / data.count[lo:hi].sum() for lo, hi in groups])
        )
    return spectrum_picture(f, ratios[0], ratios[1], f"gap-spectrum-{g.channel}")


NEAR = 60
"""Ordinates beside a line that are shown."""


def _near_line(g: ChannelGap, f: Finding) -> str:
    """White power of the record beside a line, with it and without."""
    record, effects = g.record, g.mended.effects
    whitener = Whitener.of(effects, record.n, record.dt)
    others = tuple(e for e in effects if e.coefficients() and e != f.effect)
    at = round(2.0 * float(f.effect.row("")["frequency"][0]) * record.duration)
    keep = slice(max(at - NEAR, 1), at + NEAR)
    frequency = np.arange(record.n)[keep] / (2.0 * record.duration)
    lines = [
        Line("record", frequency, whitener.ordinates(_without(record, others))[keep] ** 2, MEASURED),
        Line(
            "without the line",
            frequency,
            whitener.ordinates(_without(record, (*others, f.effect)))[keep] ** 2,
            AFTER,
        ),
    ]
    return series_picture(lines, "power over noise", f"line-{g.channel}-{at}", "frequency [Hz]")


def _driven(g: ChannelGap, f: Finding) -> str:
    block, factor = max(1, g.record.y.size // 400), parse_unit(g.unit).factor
    t = block_means(g.record.t, block)
    part = f.effect.mean(g.record.elapsed, g.record.drive)
    others = tuple(e for e in g.mended.effects if e.coefficients() and e != f.effect)
    y = block_means(_without(g.record, others), block) / factor
    explained = block_means(part, block) / factor
    keep = thin(t)
    shift = y.mean() - explained.mean()
    lines = [
        Line("record", t[keep], y[keep], MEASURED),
        Line("explained", t[keep], explained[keep] + shift, AFTER),
    ]
    return series_picture(lines, f"{g.channel} [{g.unit}]", f"driven-{g.channel}-{f.effect.name}")


def gap_data(gaps: Mapping[str, ChannelGap]) -> dict[str, Any]:
    """The interface's JSON, over all channels."""
    order = ("bad_data", "unknown_effect", "effects_found", "no_gap")
    verdict = next(v for v in order if any(g.verdict == v for g in gaps.values()))
    worst = max(gaps.values(), key=lambda g: g.gap.before)
    localised = [_test(g, t) for g in gaps.values() for t in g.before if t.significant]
    remaining = [_test(g, t) for g in gaps.values() for t in g.after if t.significant]
    return {
        "verdict": verdict,
        "localised": localised,
        "steps": [step_data(g, f) for g in gaps.values() for f in g.findings],
        "gap": {
            "metric": METRIC,
            "held_out": worst.gap.held_out,
            "channel": worst.channel,
            "before": worst.gap.before,
            "after": worst.gap.after,
            "closed_fraction": worst.gap.closed,
            "ci95": list(worst.gap.ci95),
        },
        "remaining": {"significant": bool(remaining), "tests": remaining},
        "checks": {
            g.channel: {
                "nested_nats": g.checks.nested,
                "seen": dict(g.checks.seen),
                "found_again": list(g.checks.again) if g.checks.again is not None else None,
            }
            for g in gaps.values()
            if g.checks
        },
        "retuned": [g.channel for g in gaps.values() if g.retuned],
        "limits": [_limit(g, *limit) for g in gaps.values() for limit in g.limits],
    }


def _test(g: ChannelGap, t: Any) -> dict[str, Any]:
    return {
        "channel": g.channel,
        "test": t.name,
        "p": t.p,
        "from_s": float(g.record.t[0]) + (t.span[0] if t.span else 0.0),
        "to_s": float(g.record.t[0]) + t.span[1] if t.span else float(g.record.t[-1]),
        "band_hz": list(t.band_hz),
        "regime": "a stretch" if t.span else "whole record",
        "ratio": t.ratio,
    }


def step_data(g: ChannelGap, f: Finding) -> dict[str, Any]:
    """A finding as the interface's JSON has it."""
    si = parse_unit(g.unit).si
    return {
        "effect": f.effect.name,
        "channel": g.channel,
        "probability": f.probability,
        "evidence_nats": f.evidence,
        "alternatives": [{"effect": n, "probability": p} for n, p in f.alternatives],
        "indistinguishable": list(f.indistinguishable),
        "apart": [
            {"effect": o.other, "cos2": o.cos2, "nats": o.nats, "record_factor": o.longer} for o in f.others
        ],
        "separator": f.effect.separating_experiment,
        "parameters": {
            p.name: {
                "value": float(getattr(f.effect, p.name)),
                "unit": derived_unit(p.unit, si),
                "ci95": [finite(v) for v in f.ci95.get(p.name, (np.nan, np.nan))],
            }
            for p in f.effect.estimated()
        },
        "where": {"from_s": float(g.record.t[0]), "to_s": float(g.record.t[-1])},
        "sentence": finding_sentence(g, f),
    }


def _limit(g: ChannelGap, effect: Effect, name: str, value: float) -> dict[str, Any]:
    unit = derived_unit({p.name: p.unit for p in effect.parameters()}[name], parse_unit(g.unit).si)
    return {
        "effect": effect.name,
        "channel": g.channel,
        "parameter": name,
        "would_not_see_below": finite(value),
        "unit": unit,
    }
