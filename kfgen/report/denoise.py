"""The answer of ``denoise``."""

from __future__ import annotations

import numpy as np

from kfgen.arma.process import Arma
from kfgen.core.numbers import quantity
from kfgen.core.units import display_unit, parse_unit
from kfgen.log.log import Log
from kfgen.report.page import (
    Answer,
    Page,
    PagePart,
    columns,
    figure,
    heading,
    source_words,
    table,
    text,
)
from kfgen.report.plots import (
    AFTER,
    BEFORE,
    MEASURED,
    Line,
    Panel,
    Picture,
    panels_picture,
    series_picture,
    thin,
)
from kfgen.run.adaptive.cost import HIDDEN, STEP
from kfgen.run.adaptive.denoise import Denoised
from kfgen.run.adaptive.denoise_log import DenoisedLog

NOISE_HEAD = ("", "before", "after", "share")
COST_HEAD = ("under motion", "")
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
        ("bias instability B (minimum / 0.664)", "B", unit),
        ("drift (means of 10 s)", "drift", unit),
    ):
        a, b = float(getattr(found.before, name)), float(getattr(found.after, name))
        rows.append([label, quantity(a, u), quantity(b, u), f"{b / a:.3g}" if a > 0.0 else "-"])
    return rows


def cost_rows(found: Denoised) -> list[list[str]]:
    """What becomes of a true rate."""
    c = found.cost
    return [
        [f"constant rate of {STEP:g} sigma: gain", f"{c.dc:.3g}"],
        [f"constant rate of {HIDDEN:g} sigma: gain", f"{c.hidden:.3g}"],
        ["step rise time (50 %)", f"{c.delay:.3g} s"],
        ["bandwidth (-3 dB)", f"{c.bandwidth:.3g} Hz"],
    ]


def denoise_answer(found: DenoisedLog) -> Answer:
    """Text, JSON and page of the filtered channels."""
    log = found.raw
    lines, parts = [f"{found.title} over {log.duration:.6g} s of {log.source}"], []
    for name, one in found.channels.items():
        unit = display_unit(log.channel(name).unit)
        lines += ["", f"{name}: {one.cost.words}", f"  {process_words(one.rest.process, unit)}"]
        lines += [columns([list(NOISE_HEAD), *noise_rows(one, unit)])]
        lines += [columns([list(COST_HEAD), *cost_rows(one)])]
        parts += _parts(log, name, one, unit)
    verdict = tuple(f"{name}: {one.cost.words}." for name, one in found.channels.items())
    page = Page(found.title, tuple(parts), verdict, None, (("log", source_words(log.source, log.sha256)),))
    return Answer("\n".join(lines), found.to_dict(), page, warnings=found.warnings)


def _parts(log: Log, name: str, one: Denoised, unit: str) -> list[PagePart]:
    tests = one.rest.tests
    rows = [[v.name, v.null, f"{v.p:.2g}", "yes" if v.rejected else "no"] for v in tests.verdicts]
    keep, factor = thin(log.t), parse_unit(unit).factor
    series = [
        Line("before", log.t[keep], log.channel(name).values[keep] / factor, BEFORE),
        Line("after", log.t[keep], one.values[keep] / factor, AFTER),
    ]
    nis = [Line("factor on R", log.t[keep], one.filtered.r[keep], MEASURED)]
    return [
        heading(name),
        text(f"{process_words(one.rest.process, unit)}."),
        table(NOISE_HEAD, noise_rows(one, unit)),
        table(COST_HEAD, cost_rows(one)),
        figure(
            denoise_picture(one, name, unit), f"Allan deviation of {name} before and after; mind the scales."
        ),
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


def denoise_picture(one: Denoised, name: str, unit: str) -> Picture:
    """The Allan deviation of a channel before and after.

    Parameters
    ----------
    one : Denoised
    name, unit : str
        Of the channel; the unit is the user's.
    """
    factor = parse_unit(unit).factor
    curves = ((one.before.curve, "before"), (one.after.curve, "after"))
    return panels_picture([Panel(c, [], unit, factor, title) for c, title in curves], f"denoise-{name}")


def _correlations(one: Denoised, name: str) -> Picture:
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
