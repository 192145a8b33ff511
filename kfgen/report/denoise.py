"""The answer of ``denoise``."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

import kfgen
from kfgen.arma.process import Arma
from kfgen.core.numbers import quantity
from kfgen.core.units import display_unit, parse_unit
from kfgen.log.log import Log
from kfgen.report.page import Answer, Page, PagePart, columns, figure, heading, sentence, table, text
from kfgen.report.plots import AFTER, BEFORE, MEASURED, Line, Panel, panels_picture, series_picture, thin
from kfgen.run.adaptive.cost import HIDDEN, STEP
from kfgen.run.adaptive.denoise import Denoised, Settings
from kfgen.run.adaptive.rules import rule_named

NOISE_HEAD = ("", "before", "after", "share")
TEST_HEAD = ("test", "null", "p", "rejected")


def process_words(process: Arma, unit: str) -> str:
    """An ARMA process in words."""
    parts = [f"phi{i + 1} {v:.4g}" for i, v in enumerate(process.phi)]
    parts += [f"theta{i + 1} {v:.4g}" for i, v in enumerate(process.theta)]
    p, q = process.order
    return f"ARMA({p},{q}): {', '.join(parts)}, noise {quantity(process.sigma, unit)}"


def noise_rows(found: Denoised, unit: str) -> list[list[str]]:
    """N, B and drift before and after."""
    rows = []
    for label, name, u in (
        ("N (Allan deviation at 1 s)", "N", f"{unit}/sqrt(Hz)"),
        ("lowest point / 0.664", "B", unit),
        ("drift (means of 10 s)", "drift", unit),
    ):
        a, b = float(getattr(found.before, name)), float(getattr(found.after, name))
        rows.append([label, quantity(a, u), quantity(b, u), f"{b / a:.3g}" if a > 0.0 else "-"])
    return rows


def cost_words(found: Denoised) -> str:
    """The price in one line."""
    c = found.cost
    return (
        f"under motion: a constant rate of {STEP:g} deviations becomes {c.dc:.3g} of itself, one of {HIDDEN:g} "
        f"{c.hidden:.3g}; half of a step comes after {c.delay:.3g} s, "
        f"-3 dB at {c.bandwidth:.3g} Hz"
    )


def denoise_answer(log: Log, found: Mapping[str, Denoised], settings: Settings) -> Answer:
    """Text, JSON and page of the filtered channels."""
    title = rule_named(settings.filter).title
    lines, parts, warnings = [f"{title} over {log.duration:.6g} s of {log.source}"], [], list(log.warnings)
    data: dict[str, Any] = {
        "format": "kfgen-denoise-1",
        "kfgen": kfgen.__version__,
        "log": log.source,
        "sha256": log.sha256,
        "filter": settings.filter,
        "window": settings.window,
        "channels": {},
    }
    for name, one in found.items():
        unit = display_unit(log.channel(name).unit)
        words = f"{name}: {one.cost.words}"
        lines += ["", words, f"  {process_words(one.rest.process, unit)}"]
        lines += [columns([list(NOISE_HEAD), *noise_rows(one, unit)]), f"  {cost_words(one)}"]
        warnings += [f"{name}: {w}" for w in one.rest.warnings]
        parts += _parts(log, name, one, unit)
        data["channels"][name] = _channel(one, log.channel(name).si)
    return Answer("\n".join(lines), data, Page(f"{title}", tuple(parts)), warnings=tuple(warnings))


def _parts(log: Log, name: str, one: Denoised, unit: str) -> list[PagePart]:
    tests = one.rest.tests
    rows = [[v.name, v.null, f"{v.p:.2g}", "yes" if v.rejected else "no"] for v in tests.verdicts]
    factor, keep = parse_unit(unit).factor, thin(log.t)
    series = [
        Line("before", log.t[keep], log.channel(name).values[keep] / factor, BEFORE),
        Line("after", log.t[keep], one.values[keep] / factor, AFTER),
    ]
    panels = [
        Panel(c, [], unit, factor, title)
        for c, title in ((one.before.curve, "before"), (one.after.curve, "after"))
    ]
    curve = panels_picture(panels, f"denoise-{name}")
    nis = [Line("factor on R", log.t[keep], one.filtered.r[keep], MEASURED)]
    return [
        heading(name),
        sentence(f"{name}: {one.cost.words}."),
        text(f"{process_words(one.rest.process, unit)}."),
        text(f"{cost_words(one)[0].upper()}{cost_words(one)[1:]}."),
        table(NOISE_HEAD, noise_rows(one, unit)),
        figure(curve, f"Allan deviation of {name} before and after; mind the scales."),
        figure(series_picture(series, f"{name} [{unit}]", f"series-{name}"), "The channel before and after."),
        figure(series_picture(nis, "factor on R", f"factor-{name}"), "What the rule makes of R."),
        figure(
            _correlations(one, name), "Autocorrelation and partial autocorrelation, with their 95 % band."
        ),
        *_orders(one),
        table(
            TEST_HEAD,
            rows,
            f"Skewness {tests.skewness:.3g}, kurtosis {tests.kurtosis:.3g} (normal: 0 and 3).",
        ),
        *(text(w) for w in one.rest.warnings),
    ]


def _correlations(one: Denoised, name: str) -> str:
    c = one.rest.correlations
    lag = np.arange(1.0, c.acf.size)
    band = np.full(lag.size, c.band)
    lines = [
        Line("autocorrelation", lag, c.acf[1:], AFTER, -band, band),
        Line("partial autocorrelation", lag, c.pacf[1:], BEFORE, dashed=True),
    ]
    return series_picture(lines, "correlation", f"correlation-{name}", "lag [samples]")


def _orders(one: Denoised) -> list[PagePart]:
    tried = one.rest.orders
    rows = [[str(o.model.order), f"{o.aic:.6g}", f"{o.aic - tried[0].aic:.2g}"] for o in tried]
    return [table(("order (p, q)", "AIC per sample", "above the least"), rows)] if rows else []


def _channel(one: Denoised, si: str) -> dict[str, Any]:
    c, used = one.cost, one.filtered.nis > 0.0
    return {
        "unit": si,
        "process": {"phi": one.rest.process.phi, "theta": one.rest.process.theta, "sigma": one.rest.process.sigma},
        "level": one.rest.level,
        "before": {"N": one.before.N, "B": one.before.B, "drift": one.before.drift},
        "after": {"N": one.after.N, "B": one.after.B, "drift": one.after.drift},
        "cost": {"dc": c.dc, "dc_hidden": c.hidden, "delay_s": c.delay, "bandwidth_hz": c.bandwidth, "attenuation": c.attenuation,
                 "sentence": c.words},
        "mean_nis": float(np.mean(one.filtered.nis[used])) if used.any() else None,
        "tests": {v.name: {"p": v.p, "rejected": v.rejected} for v in one.rest.tests.verdicts},
        "aic": {f"{o.model.order[0]},{o.model.order[1]}": o.aic for o in one.rest.orders},
        "skewness": one.rest.tests.skewness,
        "kurtosis": one.rest.tests.kurtosis,
    }  # fmt: skip
