"""The answer of ``gap`` for a world that moves: a sensor with a reference, a plant."""

from __future__ import annotations

import difflib
import math
from collections.abc import Callable, Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

import kfgen
from kfgen.core.units import derived_unit, from_si, parse_unit
from kfgen.effects.effect import Parameter
from kfgen.effects.faults.samples import Fault
from kfgen.effects.inertial.magnetic import SoftIron
from kfgen.gap.core.battery import RATE, Test
from kfgen.gap.core.holdout import METRIC
from kfgen.gap.core.noise_scale import NoiseScale
from kfgen.gap.core.outcome import PlacedFinding, SceneGap
from kfgen.gap.core.scene import Placed
from kfgen.gap.core.whitener import Whitener
from kfgen.identify.evidence.whittle import block_means
from kfgen.log.log import Log
from kfgen.report.gap import gap_rows
from kfgen.report.gap_words import VERDICTS, percent
from kfgen.report.identify import finite, quantity
from kfgen.report.page import Answer, Page, PagePart, code, columns, figure, heading, sentence, table, text
from kfgen.report.plots import AFTER, BEFORE, Line, bars_picture, series_picture

Array = NDArray[np.float64]

UnitOf = Callable[[Placed], str]
"""The unit ``U`` of a placed effect's parameters."""


def scene_answer(log: Log, g: SceneGap, unit_of: UnitOf, texts: tuple[str, str]) -> Answer:
    """Text, JSON and page.

    Parameters
    ----------
    texts : (str, str)
        The model's file before and after.
    """
    words = [
        _verdict(g),
        *map(_louder_words, g.noise_scales),
        *(finding_words(f, unit_of, g.unknowns) for f in g.findings),
    ]
    rows = [*gap_rows(g.gap, bool(g.findings or g.noise_scales)), *_rms_rows(g)]
    unseen = _limit_lines(g, unit_of)
    lines = [f"{w}." for w in words] + [columns(rows), *(f"  {w}" for w in unseen)]
    diff = "\n".join(
        difflib.unified_diff(
            texts[0].splitlines(), texts[1].splitlines(), "believed", "mended", lineterm="", n=1
        )
    )
    parts: list[PagePart] = [heading("The gap"), *(sentence(w + ".") for w in words), *_figures(g)]
    parts += [table(("gap", ""), rows), table(_HEAD, _test_rows(g), _CAPTION)]
    parts += [text(w) for w in unseen]
    if diff:
        lines += ["", "The model changes by", diff]
        parts += [heading("What changes in the model"), code(diff)]
    data = {
        "format": "kfgen-gap-1",
        "kfgen": kfgen.__version__,
        "log": log.source,
        "sha256": log.sha256,
        **scene_data(g, unit_of),
    }
    page = Page(f"Model against {log.source.rsplit('/', 1)[-1]}", tuple(parts))
    said = tuple(f"the input {n} never changes: no effect of it can be seen" for n in g.constant_inputs)
    return Answer("\n".join(lines), data | {"warnings": list(said)}, page, warnings=said)


_HEAD = ("channel", "test", "time [s]", "band [Hz]", "power found / expected", "adjusted p")
_CAPTION = f"Tests that the believed model fails (family-wise rate {100 * RATE:g} %)."


def _verdict(g: SceneGap) -> str:
    if g.verdict == "bad_data" and g.constant_inputs:
        moving, still = ", ".join(g.scene.channels), ", ".join(g.constant_inputs)
        return f"{moving}: what was recorded is not driven by the input {still}, which never changes; check its column"
    if g.noise_scales and not g.findings:
        return (
            f"{', '.join(g.scene.channels)}: the structure of the model holds, the size of its noise does not"
        )
    return f"{', '.join(g.scene.channels)}: {VERDICTS[g.verdict]}"


def _louder_words(c: NoiseScale) -> str:
    """Noise of another size in words."""
    lo, hi = c.ci95
    return f"{c.channel}: its noise is {c.times:.3g} times as large as believed (95 %: {lo:.3g} to {hi:.3g})"


def finding_words(f: PlacedFinding, unit_of: UnitOf, unknowns: Iterable[str] = ()) -> str:
    """A missing effect in words: what, where, how large, how sure, what else it could be.

    Parameters
    ----------
    unknowns : iterable of str
        What was fitted beside the effects.
    """
    if isinstance(f.placed.effect, Fault):
        words = f.placed.effect.sentence(f.placed.where, unit_of(f.placed))
        others = [f"{name} of {where}" for name, where, _ in f.alternatives]
        own = f"{f.placed.effect.name} of {f.placed.where}"
        others = [w for w in dict.fromkeys(others) if w != own]
        return f"{words}. Just as well it is {' or '.join(others)}" if others else words
    words = f"{_what(f, unit_of)}{_measured_by(f, unknowns)}. It is {percent(f.probability)} probable among all candidates"
    near = [n for (n, _), c in sorted(f.alike.items(), key=lambda a: -a[1]) if c > 0.95]
    near = [n for n in dict.fromkeys(near) if n != f.placed.effect.name]
    if f.indistinguishable:
        words += f". This log does not rule out {' or '.join(_likened(f, n) for n in f.indistinguishable)}"
        words += f"; {_told(f)} would tell" if _told(f) else ""
    near = [n for n in near if n not in f.indistinguishable]
    if near:
        words += f"; in this log it looks nearly like {', '.join(near[:3])}"
    return words


def _measured_by(f: PlacedFinding, unknowns: Iterable[str]) -> str:
    """Which scales of soft iron were taken to be zero, where nobody knows how large the field is."""
    scales = ("xx", "yy", "zz")
    taken = [e for e in scales if e not in f.ci95]
    unknown = any("field" in name.split() for name in unknowns)
    if not (isinstance(f.placed.effect, SoftIron) and unknown and 0 < len(taken) < len(scales)):
        return ""
    held = f"{' and '.join(taken)} {'is' if len(taken) == 1 else 'are'} taken to be zero"
    return f"; in a field of unknown size only differences of xx, yy and zz can be seen: {held}"


def _likened(f: PlacedFinding, name: str) -> str:
    """Another name, and how much it looks like what was found in this log."""
    cos2 = max((c for (n, _), c in f.alike.items() if n == name), default=0.0)
    return f"{name} (cos2 {cos2:.2f})" if cos2 > 0.5 else name


def _told(f: PlacedFinding) -> str:
    """What would tell it from every other name that the log does not rule out."""
    found = dict.fromkeys(f.placed.effect.distinguishing_experiment(n) for n in f.indistinguishable)
    return " and ".join(w for w in found if w)


def _what(f: PlacedFinding, unit_of: UnitOf) -> str:
    """The effect with its size; of a wrong number, what it is and what the model says."""
    if f.stated is None:
        size = ", ".join(_shown(f, p, derived_unit(p.unit, unit_of(f.placed))) for p in _known(f))
        return f"{f.placed.where} misses an effect of the model: {f.placed.effect.title}, {size}{_when(f)}"
    unit, error = unit_of(f.placed), float(getattr(f.placed.effect, _VALUE))
    away = derived_unit("U", unit)
    new, old = (_beside(v, error, unit) for v in (f.stated + error, f.stated))
    words = f"{f.placed.where} {'starts at' if f.once else 'is'} {new} instead of {old}"
    lo, hi = (from_si(v, away) for v in f.ci95[_VALUE])
    return f"{words}, off by {quantity(error, away)} (95 %: {lo:.3g} to {hi:.3g})"


def _beside(value: float, error: float, unit: str) -> str:
    """A value [SI] in a unit, with as many digits as its error has."""
    orders = [math.floor(math.log10(abs(v))) if v else 0 for v in (value, error)]
    return f"{from_si(value, unit):.{min(3 + max(orders[0] - orders[1], 0), 12)}g} {unit}".rstrip()


_VALUE = "value"


def _shown(f: PlacedFinding, p: Parameter, unit: str) -> str:
    """A parameter with its interval in the user's unit."""
    words = f"{p.name} = {quantity(float(getattr(f.placed.effect, p.name)), unit)}"
    if p.name in f.ci95:
        lo, hi = (from_si(v, unit) for v in f.ci95[p.name])
        words += f" (95 %: {lo:.3g} to {hi:.3g})"
    return words


def _when(f: PlacedFinding) -> str:
    """The span of an effect that is not always there."""
    start, lasts = (float(getattr(f.placed.effect, n, 0.0)) for n in ("time", "duration"))
    return f", from {start:.4g} to {start + lasts:.4g} s" if lasts else ""


def _known(f: PlacedFinding) -> list[Parameter]:
    """The parameters that were found."""
    return [p for p in f.placed.effect.estimated() if p.name in f.ci95 or getattr(f.placed.effect, p.name)]


def _si(unit: str) -> str:
    """The SI form of a unit, in the user's own words where these are SI already."""
    found = parse_unit(unit)
    return unit if found.factor == 1.0 and not found.offset and unit.strip() else found.si


def parameters_of(f: PlacedFinding, unit_of: UnitOf) -> dict[str, dict[str, Any]]:
    """Its parameters by name, with units and intervals [SI]; a wrong number by its own name, with its new value."""
    out = {}
    for p in _known(f):
        value, base = float(getattr(f.placed.effect, p.name)), f.stated or 0.0
        entry: dict[str, Any] = {
            "value": base + value,
            "unit": _si(derived_unit(p.unit, unit_of(f.placed))),
        }
        if p.name in f.ci95:
            entry["ci95"] = [finite(base + v) for v in f.ci95[p.name]]
        if f.stated is not None:
            entry |= {"believed": base, "off_by": value}
        out[p.name if f.stated is None else f.placed.where] = entry
    return out


def _rms_rows(g: SceneGap) -> list[list[str]]:
    return [
        [f"rms residual of {c}", f"{a:.3g} deviations of its noise before, {b:.3g} after"]
        for c, a, b in g.rms
    ]


def _test_rows(g: SceneGap) -> list[list[str]]:
    rows = [[c, *_test_cells(g, t)] for c, t in g.before if t.significant]
    return rows[:20] or [["none significant", "", "", "", "", ""]]


def _test_cells(g: SceneGap, t: Test) -> list[str]:
    lo, hi = _span(g, t)
    band = f"{t.band_hz[0]:.2g} to {t.band_hz[1]:.2g}"
    return [t.name, f"{lo:.4g} to {hi:.4g}", band, f"{t.ratio:.3g}", f"{t.p:.2g}"]


def _span(g: SceneGap, t: Test) -> tuple[float, float]:
    t0, t1 = g.scene.span
    return (t0 + t.span[0], t0 + t.span[1]) if t.span else (t0, t1)


def _figures(g: SceneGap) -> list[PagePart]:
    parts: list[PagePart] = []
    cuts = np.cumsum(g.scene.lengths)[:-1]
    pairs = zip(g.scene.channels, np.split(g.believed.residual, cuts), np.split(g.fit.residual, cuts))
    for channel, a, b in pairs:
        block = max(1, a.size // 600)
        t = np.linspace(*g.scene.span, a.size)
        lines = [Line("believed model", *_blocks(t, a, block), BEFORE)]
        if g.findings or g.noise_scales:
            lines.append(Line("mended model", *_blocks(t, b, block), AFTER))
        label = f"{channel}, residual over noise"
        parts.append(
            figure(series_picture(lines, label, f"left-{channel}"), f"What the models leave of {channel}.")
        )
    for k, f in enumerate(g.findings):
        top = [(f"{f.placed.effect.name} ({f.placed.where})", f.probability)]
        top += [(f"{n} ({w})" if w else n, p) for n, w, p in f.alternatives[:5]]
        names, shares = [n for n, _ in top], [p for _, p in top]
        picture = bars_picture(names, shares, "probability", f"rank-{k}")
        parts.append(figure(picture, f"The candidates for what {f.placed.where} misses, by probability."))
    return parts


def _blocks(t: Array, X: Array, block: int) -> tuple[Array, Array]:
    z = Whitener.back(X)
    return block_means(t, block), block_means(z, block) * np.sqrt(block)


def scene_data(g: SceneGap, unit_of: UnitOf) -> dict[str, Any]:
    """The interface's JSON."""
    remaining = [_test(g, c, t) for c, t in g.after if t.significant]
    return {
        "verdict": g.verdict,
        "localised": [_test(g, c, t) for c, t in g.before if t.significant],
        "steps": [_step(g, f, unit_of) for f in g.findings],
        "gap": {
            "metric": METRIC,
            "held_out": g.gap.held_out,
            "channel": ", ".join(g.scene.channels),
            "before": g.gap.before,
            "after": g.gap.after,
            "closed_fraction": g.gap.closed,
            "ci95": list(g.gap.ci95),
        },
        "retuned": [c.channel for c in g.noise_scales],
        "noise_times": {c.channel: {"value": c.times, "ci95": list(c.ci95)} for c in g.noise_scales},
        "rms_in_deviations": {c: {"before": a, "after": b} for c, a, b in g.rms},
        "remaining": {"significant": bool(remaining), "tests": remaining},
        "unknowns": {n: {"value": v, "unit": u.unit} for n, (u, v) in g.unknowns.items()},
        "limits": [
            {
                "effect": p.effect.name,
                "channel": p.where,
                "parameter": name,
                "would_not_see_below": finite(value),
                "unit": _si(_unit(p, name, unit_of)),
            }
            for p, name, value in g.limits
        ],
    }


def _unit(placed: Placed, name: str, unit_of: UnitOf) -> str:
    return derived_unit({p.name: p.unit for p in placed.effect.parameters()}[name], unit_of(placed))


def _limit_lines(g: SceneGap, unit_of: UnitOf) -> list[str]:
    return [
        f"would not have been seen: {p.effect.name} of {p.where}, {n} below {quantity(v, _unit(p, n, unit_of))}"
        for p, n, v in g.limits
    ]


def _test(g: SceneGap, channel: str, t: Test) -> dict[str, Any]:
    lo, hi = _span(g, t)
    return {
        "channel": channel,
        "test": t.name,
        "p": t.p,
        "from_s": lo,
        "to_s": hi,
        "band_hz": list(t.band_hz),
        "regime": "all",
        "ratio": t.ratio,
    }


def _step(g: SceneGap, f: PlacedFinding, unit_of: UnitOf) -> dict[str, Any]:
    effect = f.placed.effect
    t0, t1 = g.scene.span
    values = {p.name: float(getattr(effect, p.name)) for p in effect.parameters()}
    if values.get("duration", 0.0) > 0.0:
        t0, t1 = values["time"], values["time"] + values["duration"]
    return {
        "effect": effect.name,
        "channel": f.placed.where,
        "probability": f.probability,
        "evidence_nats": f.evidence,
        "alternatives": [{"effect": n, "channel": w, "probability": p} for n, w, p in f.alternatives],
        "indistinguishable": list(f.indistinguishable),
        "separator": _told(f) or f.placed.effect.separating_experiment,
        "cos2": {f"{n} ({w})": c for (n, w), c in f.alike.items() if c > 0.5},
        "parameters": parameters_of(f, unit_of),
        "where": {"from_s": t0, "to_s": t1},
        "sentence": finding_words(f, unit_of, g.unknowns),
    }


def units_of_channels(log: Log) -> UnitOf:
    """Units of effects placed at channels, or at a triad of them."""
    known: Mapping[str, str] = {n: c.unit for n, c in log.channels.items()}

    def unit(placed: Placed) -> str:
        if placed.where in known:
            return known[placed.where]
        return next((u for n, u in known.items() if n.rpartition("_")[0] == placed.where), "")

    return unit
