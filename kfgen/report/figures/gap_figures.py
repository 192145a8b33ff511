"""The pictures of ``gap``: what was measured, and what the assumed and the updated model leave of it."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray

from kfgen.core.units import parse_unit
from kfgen.effects import Effect
from kfgen.gap.core.battery import bands
from kfgen.gap.core.result import Comparison, Finding
from kfgen.gap.core.whitener import Whitener
from kfgen.gap.rest.comparison import ChannelGap
from kfgen.gap.scene.scene_gap import SceneGap
from kfgen.identify.evidence.allan import overlapping_variance
from kfgen.identify.evidence.record import Record
from kfgen.identify.evidence.whittle import block_means, residual_ratio
from kfgen.report.figures.band import band_picture
from kfgen.report.page import PagePart, figure
from kfgen.report.plots import (
    AFTER,
    BEFORE,
    MEASURED,
    Line,
    Picture,
    allan_picture,
    bars_picture,
    series_picture,
    spectrum_picture,
    thin,
)
from kfgen.run.band import outside_words

Array = NDArray[np.float64]

ASSUMED, UPDATED = "assumed model", "updated model"
UNCONTESTED = 0.99
"""Probability of a finding above which its candidates need no picture."""
MAX_ALTERNATIVES = 5
"""Other names in the picture of the candidates."""
RESIDUAL_BLOCKS = 600
"""Blocks of time in the picture of the residuals."""
RECORD_BLOCKS = 400
"""Blocks of time in the picture of a record and what a driver explains of it."""
ORDINATES_BESIDE_LINE = 60


def figures(c: Comparison) -> list[PagePart]:
    """The pictures of a comparison: of what the models leave, and of the candidates for each finding."""
    parts: list[PagePart] = []
    if isinstance(c, ChannelGap):
        parts = _channel_figures(c)
    elif isinstance(c, SceneGap):
        parts = _scene_figures(c)
    for k, f in enumerate(c.findings):
        if f.probability > UNCONTESTED:
            continue
        beside = [(f"{n} ({w})" if w and not c.is_at_rest else n, p) for n, w, p in f.alternatives]
        own = f.name if c.is_at_rest else f"{f.name} ({f.where})"
        top = [(own, f.probability), *beside[:MAX_ALTERNATIVES]]
        names, shares = [n for n, _ in top], [p for _, p in top]
        draw = partial(bars_picture, names, shares, "probability", f"rank-{'-'.join(c.channels)}-{k}")
        parts.append(
            figure(draw, f"The candidates for what the model of {f.where} is missing, by probability.")
        )
    return parts


def _scene_figures(c: SceneGap) -> list[PagePart]:
    cuts = np.cumsum(c.scene.lengths)[:-1]
    pairs = zip(c.channels, np.split(c.assumed.residual, cuts), np.split(c.fit.residual, cuts))
    parts = []
    for channel, *ordinates in pairs:
        before, after = (Whitener.back(X) for X in ordinates)
        t = np.linspace(*c.span_s, before.size)
        caption = f"What the models leave of {channel}, in standard deviations of its noise. "
        caption += outside_words("Assumed", before, t)
        if c.is_updated:
            caption += f" {outside_words('Updated', after, t)}"
        parts.append(figure(partial(_residuals, c, channel, before, after), caption))
    return parts


def _residuals(c: SceneGap, channel: str, before: Array, after: Array) -> Picture:
    block = max(1, before.size // RESIDUAL_BLOCKS)
    t = np.linspace(*c.span_s, before.size)
    lines = [Line(ASSUMED, *_blocks(t, before, block), BEFORE)]
    if c.is_updated:
        lines.append(Line(UPDATED, *_blocks(t, after, block), AFTER))
    panel = (f"{channel} [standard deviations]", np.array(c.span_s), np.ones(2), lines)
    return band_picture([panel], f"left-{channel}")


def _blocks(t: Array, x: Array, block: int) -> tuple[Array, Array]:
    return block_means(t, block), block_means(x, block) * np.sqrt(block)


def _channel_figures(g: ChannelGap) -> list[PagePart]:
    allan = (
        "Allan deviation: the record with its 95 % band, what the assumed model expects of "
        "this record, what the updated model expects."
    )
    spectrum = "What the models leave, over what they expect: one everywhere when a model holds."
    parts = [figure(partial(_allan, g), allan), figure(partial(_spectrum, g), spectrum)]
    for f in (f for f in g.findings if f.effect.coefficients()):
        row = f.effect.row(g.unit)
        if "frequency" in row:
            caption = f"Power near the line at {row['frequency'][0]:.6g} Hz."
            parts.append(figure(partial(_near_line, g, f), caption))
        else:
            caption = f"The record in blocks, and the part that {f.effect.title} explains."
            parts.append(figure(partial(_driven, g, f), caption))
    return parts


def _without(record: Record, effects: Sequence[Effect]) -> Array:
    return record.y - record.drift(effects)


def _allan(g: ChannelGap) -> Picture:
    lines = [_model_line(ASSUMED, g.assumed, g, BEFORE)]
    if g.is_updated:
        lines.append(_model_line(UPDATED, g.updated.effects, g, AFTER))
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


def _spectrum(g: ChannelGap) -> Picture:
    ratios = []
    for effects, record in ((g.assumed, g.record), (g.updated.effects, g.clean or g.record)):
        data = record.ordinates(effects)
        theta = np.array([v for e in effects if e.coefficients() for v in e.values])
        ratio = residual_ratio(data, effects, theta)
        groups = bands(data)
        f = np.array([np.sqrt(data.frequency[lo] * data.frequency[hi - 1]) for lo, hi in groups])
        ratios.append(
            np.array([data.count[lo:hi] @ ratio[lo:hi] / data.count[lo:hi].sum() for lo, hi in groups])
        )
    return spectrum_picture(f, ratios[0], ratios[1], f"gap-spectrum-{g.channel}")


def _near_line(g: ChannelGap, f: Finding) -> Picture:
    """White power of the record beside a line, with it and without."""
    record, effects = g.record, g.updated.effects
    whitener = Whitener.on(record, effects)
    others = tuple(e for e in effects if e.coefficients() and e != f.effect)
    at = round(2.0 * float(f.effect.row("")["frequency"][0]) * record.duration)
    keep = slice(max(at - ORDINATES_BESIDE_LINE, 1), at + ORDINATES_BESIDE_LINE)
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


def _driven(g: ChannelGap, f: Finding) -> Picture:
    block, factor = max(1, g.record.y.size // RECORD_BLOCKS), parse_unit(g.unit).factor
    t = block_means(g.record.t, block)
    part = g.record.drift([f.effect])
    others = tuple(e for e in g.updated.effects if e.coefficients() and e != f.effect)
    y = block_means(_without(g.record, others), block) / factor
    explained = block_means(part, block) / factor
    keep = thin(t)
    shift = y.mean() - explained.mean()
    lines = [
        Line("record", t[keep], y[keep], MEASURED),
        Line("explained", t[keep], explained[keep] + shift, AFTER),
    ]
    return series_picture(lines, f"{g.channel} [{g.unit}]", f"driven-{g.channel}-{f.effect.name}")
