"""Pictures as SVG: the only place that knows matplotlib."""

from __future__ import annotations

import io
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kfgen.identify.evidence.allan import AllanCurve

Array = NDArray[np.float64]

MEASURED, BEFORE, AFTER, BAND = "#1b2430", "#c4452f", "#1f5fa8", "#b9c4d0"


@dataclass(frozen=True)
class Line:
    """A curve of a picture: what it is called, its points, a color, a band around it."""

    label: str
    x: Array
    y: Array
    color: str
    lo: Array | None = None
    hi: Array | None = None
    dashed: bool = False


def _figure(width: float, height: float, count: int = 1, rows: int = 1) -> tuple[Any, list[Any]]:
    import matplotlib as mpl
    from matplotlib.figure import Figure

    with mpl.rc_context({"font.size": 9.5}):
        fig = Figure(figsize=(width, height), layout="constrained")
        axes = fig.subplots(rows, count, squeeze=False).ravel().tolist()
    for ax in axes:
        ax.grid(True, which="major", color="#e6ebf0", linewidth=0.8)
        ax.set_axisbelow(True)
        for side in ("top", "right"):
            ax.spines[side].set_visible(False)
    return fig, axes


def _svg(fig: Any, key: str) -> str:
    import matplotlib as mpl

    key = re.sub(r"\W", "-", key)  # a channel's name may be anything
    buffer = io.StringIO()
    with mpl.rc_context({"svg.fonttype": "none", "svg.hashsalt": key}):
        fig.savefig(buffer, format="svg", transparent=True, metadata={"Date": None, "Creator": None})
    text = buffer.getvalue()
    text = re.sub(r"<metadata>.*?</metadata>", "", text[text.index("<svg") :], flags=re.S)
    # Pictures share a page: their inner names must not meet.
    text = re.sub(r'id="', f'id="{key}-', text)
    text = re.sub(r'href="#', f'href="#{key}-', text)
    return re.sub(r"url\(#", f"url(#{key}-", text)


@dataclass(frozen=True)
class Panel:
    """An Allan deviation [SI] with model curves, to be shown in a unit of so much SI."""

    curve: AllanCurve
    models: Sequence[Line]
    unit: str
    factor: float
    title: str = ""


def allan_picture(curve: AllanCurve, models: Sequence[Line], unit: str, factor: float, key: str) -> str:
    """Allan deviation with its 95 % band and model curves, in the user's unit."""
    return panels_picture([Panel(curve, models, unit, factor)], key)


def panels_picture(panels: Sequence[Panel], key: str) -> str:
    """Allan deviations side by side, three to a row."""
    alone = len(panels) == 1
    columns = min(len(panels), 3)
    rows = -(-len(panels) // columns)
    size = (7.4, 4.2) if alone else (3.6 * columns, 2.9 * rows)
    fig, axes = _figure(*size, columns, rows)
    for ax, p in zip(axes, panels):
        _allan_axes(ax, p)
    for ax in axes[len(panels) :]:
        ax.set_visible(False)
    axes[0].legend(frameon=False, fontsize=8.5 if alone else 7)
    return _svg(fig, key)


def _allan_axes(ax: Any, p: Panel) -> None:
    c = p.curve
    band = {"color": BAND, "alpha": 0.55, "linewidth": 0, "label": "measured, 95 % band"}
    ax.fill_between(c.tau, c.lo / p.factor, c.hi / p.factor, **band)
    ax.plot(c.tau, c.deviation / p.factor, ".", color=MEASURED, markersize=4, label="measured")
    for line in p.models:
        style = "--" if line.dashed else "-"
        ax.plot(line.x, line.y / p.factor, color=line.color, linewidth=1.8, linestyle=style, label=line.label)
    ax.set(xscale="log", yscale="log", xlabel="averaging time τ [s]", ylabel=f"Allan deviation [{p.unit}]")
    ax.set_title(p.title, fontsize=9.5)
    lo, hi = c.deviation.min() / p.factor, c.deviation.max() / p.factor
    ax.set_ylim(lo / 3.0, hi * 3.0)


def spectrum_picture(frequency: Array, before: Array, after: Array, key: str) -> str:
    """Residual power over its expectation, before and after."""
    fig, (ax,) = _figure(7.4, 3.0)
    ax.axhline(1.0, color=MEASURED, linewidth=0.8)
    ax.plot(frequency, before, color=BEFORE, linewidth=1.2, marker=".", label="assumed model")
    ax.plot(frequency, after, color=AFTER, linewidth=1.2, marker=".", label="updated model")
    ax.set(xscale="log", yscale="log", xlabel="frequency [Hz]", ylabel="residual power / expected")
    ax.legend(frameon=False, fontsize=8.5)
    return _svg(fig, key)


def series_picture(lines: Sequence[Line], ylabel: str, key: str, xlabel: str = "time [s]") -> str:
    """Curves over time, with bands."""
    fig, (ax,) = _figure(7.4, 3.0)
    for line in lines:
        if line.lo is not None and line.hi is not None:
            ax.fill_between(line.x, line.lo, line.hi, color=line.color, alpha=0.2, linewidth=0)
        ax.plot(
            line.x,
            line.y,
            color=line.color,
            linewidth=1.1,
            label=line.label,
            linestyle="--" if line.dashed else "-",
        )
    ax.set(xlabel=xlabel, ylabel=ylabel)
    ax.legend(frameon=False, fontsize=8.5)
    return _svg(fig, key)


def curves_picture(panels: Sequence[tuple[str, Sequence[Line]]], key: str) -> str:
    """Curves over time on logarithmic scales, a panel for each label of an axis, two to a row."""
    columns = min(len(panels), 2)
    rows = -(-len(panels) // columns)
    fig, axes = _figure(3.7 * columns, 2.5 * rows, columns, rows)
    for ax, (ylabel, lines) in zip(axes, panels):
        for line in lines:
            style = "--" if line.dashed else "-"
            ax.plot(line.x, line.y, linewidth=1.3, linestyle=style, label=line.label)
        ax.set(xlabel="time [s]", ylabel=ylabel, yscale="log")
        ax.legend(frameon=False, fontsize=7, ncols=-(-len(lines) // 6))
    for ax in axes[len(panels) :]:
        ax.set_visible(False)
    return _svg(fig, key)


def bound_picture(lines: Sequence[Line], key: str) -> str:
    """Relative bounds against hours of record."""
    fig, (ax,) = _figure(7.4, 3.4)
    shown = [line for line in lines if (np.isfinite(line.y) & (line.y > 0.0)).any()]
    for line in shown:
        ax.plot(line.x, 100.0 * line.y, color=line.color, marker=".", label=line.label)
    ax.set(
        xscale="log" if shown else "linear",
        yscale="log" if shown else "linear",
        xlabel="length of the record [h]",
        ylabel="bound [%]",
    )
    if shown:
        ax.legend(frameon=False, fontsize=8.5)
    return _svg(fig, key)


def bars_picture(names: Sequence[str], values: Sequence[float], xlabel: str, key: str) -> str:
    """Horizontal bars, the first on top."""
    fig, (ax,) = _figure(7.4, 0.6 + 0.3 * len(names))
    ax.barh(range(len(names)), values, color=AFTER, height=0.62)
    ax.set_yticks(range(len(names)), names)
    ax.invert_yaxis()
    ax.set(xlabel=xlabel)
    return _svg(fig, key)


@dataclass(frozen=True)
class Map:
    """Levels over a plane of logarithms: `values` of shape (y, x)."""

    title: str
    x: Array
    y: Array
    values: Array


def maps_picture(maps: Sequence[Map], xlabel: str, ylabel: str, key: str) -> str:
    """Contour maps side by side."""
    fig, axes = _figure(3.9 * len(maps), 3.5, len(maps))
    for ax, m in zip(axes, maps):
        drawn = ax.contourf(m.x, m.y, m.values, levels=12, cmap="Blues")
        lines = ax.contour(m.x, m.y, m.values, levels=drawn.levels[::2], colors=MEASURED, linewidths=0.6)
        ax.clabel(lines, fontsize=7)
        ax.set(xscale="log", yscale="log", xlabel=xlabel, ylabel=ylabel)
        ax.set_title(m.title, fontsize=9.5)
    return _svg(fig, key)


def thin(x: Array, most: int = 1500) -> slice:
    """A stride that keeps a picture small."""
    return slice(None, None, max(1, x.size // most))


@dataclass(frozen=True)
class Dot:
    """One row of a comparison: its name, value and interval; whether it is an outlier."""

    name: str
    value: float
    lo: float
    hi: float
    outlier: bool = False


def dots_picture(
    dots: Sequence[Dot], band: tuple[float, float], xlabel: str, key: str, logarithmic: bool = False
) -> str:
    """Values with intervals below each other, over the band where the next one is expected."""
    fig, (ax,) = _figure(7.4, 0.9 + 0.24 * len(dots))
    if np.isfinite(band).all():
        ax.axvspan(*band, color=BAND, alpha=0.35, linewidth=0)
    for k, d in enumerate(dots):
        color = BEFORE if d.outlier else AFTER
        if np.isfinite([d.lo, d.hi]).all():
            ax.plot([d.lo, d.hi], [k, k], color=color, linewidth=1.6)
        ax.plot([d.value], [k], ".", color=color, markersize=7)
    ax.set_yticks(range(len(dots)), [d.name for d in dots])
    ax.invert_yaxis()
    values = [d.value for d in dots]
    if logarithmic and max(values) > 10.0 * min(values):
        ax.set_xscale("log")
    ax.set(xlabel=xlabel)
    return _svg(fig, key)
