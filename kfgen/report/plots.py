"""`Picture`: drawn into a page as SVG, or on axes of pyplot; the only place that knows matplotlib."""

from __future__ import annotations

import io
import re
import textwrap
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kfgen.identify.evidence.allan import AllanCurve

Array = NDArray[np.float64]

MEASURED, BEFORE, AFTER, BAND = "#1b2430", "#c4452f", "#1f5fa8", "#b9c4d0"


@dataclass(frozen=True)
class Line:
    """A curve of a picture: what it is called, its points, a color, a band around it; a band alone has no number in y."""

    label: str
    x: Array
    y: Array
    color: str
    lo: Array | None = None
    hi: Array | None = None
    dashed: bool = False


@dataclass(frozen=True)
class Picture:
    """A picture that is drawn when it is wanted: into a page, or into a notebook.

    Parameters
    ----------
    key : str
        Begins the inner names of the SVG: pictures share a page.
    draw : callable
        Draws on the axes that it is given.
    size : (float, float)
        Width and height [inch].
    grid : (int, int)
        Rows and columns of axes.
    """

    key: str
    draw: Callable[[list[Any]], None]
    size: tuple[float, float]
    grid: tuple[int, int] = (1, 1)

    @property
    def svg(self) -> str:
        """As text for a page."""
        import matplotlib as mpl
        from matplotlib.figure import Figure

        with mpl.rc_context({"font.size": 9.5}):
            fig = Figure(figsize=self.size, layout="constrained")
            self._drawn(fig)
        return _svg(fig, self.key)

    def open(self, title: str) -> list[Any]:
        """The axes of a figure of pyplot, which a notebook shows by itself and a script by ``plt.show()``."""
        import matplotlib.pyplot as plt

        with plt.rc_context({"font.size": 9.5}):
            fig = plt.figure(figsize=self.size, layout="constrained")
            axes = self._drawn(fig)
            lines = textwrap.fill(title, round(TITLE_SIGNS_PER_INCH * self.size[0]))
            fig.suptitle(lines, fontsize=10, parse_math=False)
        return [ax for ax in axes if ax.get_visible()]

    def _drawn(self, fig: Any) -> list[Any]:
        axes: list[Any] = fig.subplots(*self.grid, squeeze=False).ravel().tolist()
        for ax in axes:
            ax.grid(True, which="major", color="#e6ebf0", linewidth=0.8)
            ax.set_axisbelow(True)
            for side in ("top", "right"):
                ax.spines[side].set_visible(False)
        self.draw(axes)
        return axes


TITLE_SIGNS_PER_INCH = 12


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


def allan_picture(curve: AllanCurve, models: Sequence[Line], unit: str, factor: float, key: str) -> Picture:
    """Allan deviation with its 95 % band and model curves, in the user's unit."""
    return panels_picture([Panel(curve, models, unit, factor)], key)


def panels_picture(panels: Sequence[Panel], key: str) -> Picture:
    """Allan deviations side by side, three to a row."""
    alone = len(panels) == 1
    columns = min(len(panels), 3)
    rows = -(-len(panels) // columns)
    size = (7.4, 4.2) if alone else (3.6 * columns, 2.9 * rows)

    def draw(axes: list[Any]) -> None:
        for ax, p in zip(axes, panels):
            _allan_axes(ax, p)
        for ax in axes[len(panels) :]:
            ax.set_visible(False)
        axes[0].legend(frameon=False, fontsize=8.5 if alone else 7)

    return Picture(key, draw, size, (rows, columns))


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


def spectrum_picture(frequency: Array, before: Array, after: Array, key: str) -> Picture:
    """Residual power over its expectation, before and after."""

    def draw(axes: list[Any]) -> None:
        (ax,) = axes
        ax.axhline(1.0, color=MEASURED, linewidth=0.8)
        ax.plot(frequency, before, color=BEFORE, linewidth=1.2, marker=".", label="assumed model")
        ax.plot(frequency, after, color=AFTER, linewidth=1.2, marker=".", label="updated model")
        ax.set(xscale="log", yscale="log", xlabel="frequency [Hz]", ylabel="residual power / expected")
        ax.legend(frameon=False, fontsize=8.5)

    return Picture(key, draw, (7.4, 3.0))


def series_picture(lines: Sequence[Line], ylabel: str, key: str, xlabel: str = "time [s]") -> Picture:
    """Curves over time, with bands."""
    return stacked_picture([(ylabel, lines)], key, xlabel)


def stacked_picture(
    panels: Sequence[tuple[str, Sequence[Line]]], key: str, xlabel: str = "time [s]"
) -> Picture:
    """Curves over time, with bands, a panel below the other for each label of an axis; the first has the legend."""
    alone = len(panels) == 1

    def draw(axes: list[Any]) -> None:
        for ax, (ylabel, lines) in zip(axes, panels):
            _series_axes(ax, lines)
            ax.set(ylabel=ylabel)
            if not alone:
                ax.sharex(axes[0])
                ax.tick_params(labelbottom=ax is axes[-1])
        axes[-1].set(xlabel=xlabel)
        above = {} if alone else {"loc": "lower left", "bbox_to_anchor": (0.0, 1.0), "ncols": 4}
        axes[0].legend(frameon=False, fontsize=8.5, **above)

    return Picture(key, draw, (7.4, 3.0 if alone else 0.6 + 1.75 * len(panels)), (len(panels), 1))


def _series_axes(ax: Any, lines: Sequence[Line]) -> None:
    for line in lines:
        if line.lo is not None and line.hi is not None:
            is_band = not np.isfinite(line.y).any()
            said = {"label": line.label} if is_band else {}
            shade = 0.55 if line.color == BAND else 0.2
            ax.fill_between(line.x, line.lo, line.hi, color=line.color, alpha=shade, linewidth=0, **said)
            if is_band:
                continue
        style = "--" if line.dashed else "-"
        ax.plot(line.x, line.y, color=line.color, linewidth=1.1, label=line.label, linestyle=style)


def plan_picture(lines: Sequence[Line], xlabel: str, ylabel: str, key: str) -> Picture:
    """Curves in a plane whose axes have one scale."""

    def draw(axes: list[Any]) -> None:
        (ax,) = axes
        _series_axes(ax, lines)
        ax.set(xlabel=xlabel, ylabel=ylabel)
        ax.set_aspect("equal", adjustable="datalim")
        ax.legend(frameon=False, fontsize=8.5)

    return Picture(key, draw, (7.4, 5.0))


def curves_picture(panels: Sequence[tuple[str, Sequence[Line]]], key: str) -> Picture:
    """Curves over time on logarithmic scales, a panel for each label of an axis, two to a row."""
    columns = min(len(panels), 2)
    rows = -(-len(panels) // columns)

    def draw(axes: list[Any]) -> None:
        for ax, (ylabel, lines) in zip(axes, panels):
            for line in lines:
                style = "--" if line.dashed else "-"
                ax.plot(line.x, line.y, linewidth=1.3, linestyle=style, label=line.label)
            ax.set(xlabel="time [s]", ylabel=ylabel, yscale="log")
            ax.legend(frameon=False, fontsize=7, ncols=-(-len(lines) // 6))
        for ax in axes[len(panels) :]:
            ax.set_visible(False)

    return Picture(key, draw, (3.7 * columns, 2.5 * rows), (rows, columns))


def density_picture(lines: Sequence[Line], ylabel: str, key: str) -> Picture:
    """Amplitude densities over frequency, on logarithmic scales."""

    def draw(axes: list[Any]) -> None:
        (ax,) = axes
        for line in lines:
            ax.plot(line.x, line.y, color=line.color, linewidth=0.9, label=line.label)
        ax.set(xscale="log", yscale="log", xlabel="frequency [Hz]", ylabel=ylabel)
        ax.legend(frameon=False, fontsize=8.5)

    return Picture(key, draw, (7.4, 3.0))


def bound_picture(lines: Sequence[Line], key: str) -> Picture:
    """Relative bounds against hours of record."""

    def draw(axes: list[Any]) -> None:
        (ax,) = axes
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

    return Picture(key, draw, (7.4, 3.4))


def bars_picture(names: Sequence[str], values: Sequence[float], xlabel: str, key: str) -> Picture:
    """Horizontal bars, the first on top."""

    def draw(axes: list[Any]) -> None:
        (ax,) = axes
        ax.barh(range(len(names)), values, color=AFTER, height=0.62)
        ax.set_yticks(range(len(names)), names)
        ax.invert_yaxis()
        ax.set(xlabel=xlabel)

    return Picture(key, draw, (7.4, 0.6 + 0.3 * len(names)))


@dataclass(frozen=True)
class Map:
    """Levels over a plane of logarithms: `values` of shape (y, x)."""

    title: str
    x: Array
    y: Array
    values: Array


def maps_picture(maps: Sequence[Map], xlabel: str, ylabel: str, key: str) -> Picture:
    """Contour maps side by side."""

    def draw(axes: list[Any]) -> None:
        for ax, m in zip(axes, maps):
            drawn = ax.contourf(m.x, m.y, m.values, levels=12, cmap="Blues")
            lines = ax.contour(m.x, m.y, m.values, levels=drawn.levels[::2], colors=MEASURED, linewidths=0.6)
            ax.clabel(lines, fontsize=7)
            ax.set(xscale="log", yscale="log", xlabel=xlabel, ylabel=ylabel)
            ax.set_title(m.title, fontsize=9.5)

    return Picture(key, draw, (3.9 * len(maps), 3.5), (1, len(maps)))


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
) -> Picture:
    """Values with intervals below each other, over the band where the next one is expected."""

    def draw(axes: list[Any]) -> None:
        (ax,) = axes
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

    return Picture(key, draw, (7.4, 0.9 + 0.24 * len(dots)))
