"""The pictures of a run: track, attitude, errors against a reference, innovations with their band."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from kfgen.core.units import display_unit, from_si
from kfgen.report.figures.band import band_of, band_picture
from kfgen.report.figures.channels import thinned
from kfgen.report.page import PagePart, figure, heading
from kfgen.report.plots import (
    AFTER,
    BAND,
    BEFORE,
    MEASURED,
    Line,
    Picture,
    plan_picture,
    series_picture,
    stacked_picture,
    thin,
)
from kfgen.run.against_reference import BAND_SIGMAS, CHANCE_OUTSIDE_PERCENT, StateErrors
from kfgen.run.band import outside_words
from kfgen.run.run import FilterRun
from kfgen.run.track import Track

Array = NDArray[np.float64]

TRACK_COLORS = {"filter": AFTER, "smoothed": BEFORE, "reference": MEASURED, "GNSS": "#7a8794"}
ANGLES = ("roll", "pitch", "heading")
SHOWN_UNITS = {"rad": "deg"}
"""Of errors and innovations, where people read another one than SI."""
MAX_STEP_DEG = 180.0
"""Of an angle between two samples, above which it went round."""


def run_parts(result: FilterRun) -> list[PagePart]:
    """The pictures of a run with their headings and captions, in the order in which they are looked at.

    Parameters
    ----------
    result : FilterRun
    """
    parts: list[PagePart] = []
    if any(k.position is not None for k in result.tracks):
        said = f"Axes are level at the start: {_labels(result.tracks, 'position')}."
        parts += [
            heading("Track"),
            figure(track_picture(result), f"The track from above. {said}"),
            figure(height_picture(result), "Height over time."),
        ]
    if any(k.attitude is not None for k in result.tracks):
        said = f"Roll, pitch and heading over time: {_labels(result.tracks, 'attitude')}."
        parts += [heading("Attitude"), figure(attitude_picture(result), said)]
    if result.errors:
        parts.append(heading("Errors against the reference"))
        parts += [figure(error_picture(result, k), error_words(e)) for k, e in enumerate(result.errors)]
    parts.append(heading("Innovations"))
    parts += [figure(innovation_picture(result, n), innovation_words(result, n)) for n in result.updated]
    return parts


def run_pictures(result: FilterRun) -> list[tuple[str, Picture]]:
    """The pictures of a run, each with what it shows."""
    return [(p.caption, p.picture) for p in run_parts(result) if p.kind == "figure"]


def _shown(unit: str) -> str:
    return SHOWN_UNITS.get(unit, display_unit(unit))


def _labels(tracks: Sequence[Track], what: str) -> str:
    names = [k.label for k in tracks if getattr(k, what) is not None]
    return f"{', '.join(names[:-1])} and {names[-1]}" if len(names) > 1 else names[0]


def track_picture(result: FilterRun) -> Picture:
    """North over east."""
    lines = []
    for k in _drawn(result, "position"):
        assert k.position is not None
        keep = thin(k.t)
        lines.append(_line(k, k.position[keep, 1], k.position[keep, 0]))
    return plan_picture(lines, "east [m]", "north [m]", "track")


def height_picture(result: FilterRun) -> Picture:
    """Height over time."""
    lines = [
        thinned(_line(k, k.t, k.position[:, 2])) for k in _drawn(result, "position") if k.position is not None
    ]
    return series_picture(lines, "height [m]", "height")


def attitude_picture(result: FilterRun) -> Picture:
    """Roll, pitch and heading over time."""
    panels = []
    for i, name in enumerate(ANGLES):
        lines = []
        for k in _drawn(result, "attitude"):
            assert k.attitude is not None
            keep = thin(k.t)
            lines.append(_line(k, k.t[keep], _broken(np.degrees(k.attitude[keep, i]))))
        panels.append((f"{name} [deg]", lines))
    return stacked_picture(panels, "attitude")


def _drawn(result: FilterRun, what: str) -> list[Track]:
    """Those that say something of it, what was measured first: estimates are drawn over it."""
    order = ("GNSS", "reference", "filter", "smoothed")
    return sorted(
        (k for k in result.tracks if getattr(k, what) is not None), key=lambda k: order.index(k.label)
    )


def _line(k: Track, x: Array, y: Array) -> Line:
    return Line(k.label, x, y, TRACK_COLORS[k.label], dashed=k.label == "reference")


def _broken(angle: Array) -> Array:
    """Angles [deg] without the lines that would cross the picture where they go round."""
    out = np.array(angle)
    out[1:][np.abs(np.diff(angle)) > MAX_STEP_DEG] = np.nan
    return out


def error_picture(result: FilterRun, k: int) -> Picture:
    """The errors of a block of states over their band; of a smoothed run those of the filter beside.

    Parameters
    ----------
    result : FilterRun
    k : int
        Of the block, in `errors`.
    """
    e = result.errors[k]
    unit = _shown(e.unit)
    before = result.forward.errors[k] if result.forward is not None else None
    panels = []
    for i, name in enumerate(e.names):
        shown = [(e, "smoothed", BEFORE), (before, "filter", AFTER)] if before else [(e, "error", AFTER)]
        lines = [_error_line(x, i, unit, label, color) for x, label, color in reversed(shown)]
        bands = [_three_sigma(x, i, unit, label if before else "", lines, color) for x, label, color in shown]
        panels.append((f"{name} [{unit}]" if unit else name, [*reversed(bands), *lines]))
    return stacked_picture(panels, f"errors-{e.names[0]}")


def _three_sigma(e: StateErrors, i: int, unit: str, of: str, lines: Sequence[Line], color: str) -> Line:
    keep = thin(e.t)
    half = np.asarray(from_si(BAND_SIGMAS * e.deviation[keep, i], unit), float)
    label = f"{BAND_SIGMAS:g} standard deviations{f', {of}' if of else ''}"
    return band_of(label, e.t[keep], half, lines, color if of else BAND)


def _error_line(e: StateErrors, i: int, unit: str, label: str, color: str) -> Line:
    return thinned(Line(label, e.t, np.asarray(from_si(e.error[:, i], unit), float), color))


def error_words(e: StateErrors) -> str:
    """The errors of a block in words: how large, and how many leave their band."""
    unit = _shown(e.unit)
    sizes = ", ".join(
        f"{name} {float(np.asarray(from_si(rms, unit))):.3g} {unit} RMS, {100.0 * share:.1f} % outside".replace(
            "  ", " "
        )
        for name, rms, share in zip(e.names, e.rms, e.outside)
    )
    said = f"Reference less estimate, {e.title}, with the band of {BAND_SIGMAS:g} standard deviations "
    said += f"({CHANCE_OUTSIDE_PERCENT:g} % outside by chance): {sizes}."
    if e.north:
        said += f" The reference has a north of its own: the constant {np.degrees(e.north):.3g} deg between are removed."
    return said


def innovation_picture(result: FilterRun, name: str) -> Picture:
    """The innovations of a sensor over time, each row with its band.

    Parameters
    ----------
    result : FilterRun
    name : str
        Of the sensor.
    """
    s, panels = result.sensors[name], []
    keep = thin(s.t)
    for i, channel in enumerate(s.channels):
        unit = _shown(result.unit_of(channel))
        y = np.asarray(from_si(s.innovation[:, i], unit), float)
        line = thinned(Line("innovation", s.t, y, AFTER))
        sd = s.deviation[keep, i] if s.deviation is not None else np.full(s.t[keep].size, np.nan)
        label = f"{channel} [{unit}]" if unit else channel
        panels.append((label, s.t[keep], np.asarray(from_si(sd, unit), float), [line]))
    return band_picture(panels, f"innovation-{name}")


def innovation_words(result: FilterRun, name: str) -> str:
    """What the picture of a sensor's innovations shows, and when they leave their band.

    Parameters
    ----------
    result : FilterRun
    name : str
        Of the sensor.
    """
    s = result.sensors[name]
    said = f"Innovations of {name}."
    if s.normalised is None:
        return f"{said} The filter adapts its covariances: there is no band."
    return " ".join([said, *(outside_words(c, x, s.t) for c, x in zip(s.channels, s.normalised.T))])
