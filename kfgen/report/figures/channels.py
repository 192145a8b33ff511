"""The pictures of what is inside a log: each sensor over time, and its spectrum."""

from __future__ import annotations

import re
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from kfgen.core.units import display_unit, from_si
from kfgen.log.log import Channel, Log
from kfgen.report.page import PagePart, figure, heading
from kfgen.report.plots import AFTER, BEFORE, MEASURED, Line, density_picture, series_picture, thin

Array = NDArray[np.float64]

COLORS = (AFTER, BEFORE, MEASURED)
"""Of the axes of a sensor."""
MOST_SENSORS = 8
"""Sensors that are drawn; inertial ones first."""
SEGMENTS = 8
"""Parts of a record whose spectra are averaged."""
LEAST_SAMPLES = 64
"""Samples below which there is no spectrum."""
_AXIS = re.compile(r"_([xyzNED])$")


def channel_parts(log: Log) -> list[PagePart]:
    """The sensors of a log over time, each with its spectrum where it is sampled evenly.

    Parameters
    ----------
    log : Log

    Returns
    -------
    list of PagePart
    """
    parts: list[PagePart] = []
    sensors = _sensors(log.channels)
    order = sorted(sensors, key=lambda name: not name.startswith(("gyro", "accel")))
    for name in order[:MOST_SENSORS]:
        unit = display_unit(next(iter(sensors[name].values())).unit)
        series = [_series(log, label, c, k, unit) for k, (label, c) in enumerate(sensors[name].items())]
        label = f"{name} [{unit}]" if unit else name
        parts += [
            heading(name),
            figure(series_picture(list(map(thinned, series)), label, f"series-{name}"), f"{name} over time."),
        ]
        spectra = [s for s in map(_spectrum, series) if s is not None]
        if spectra:
            drawn = density_picture(spectra, f"{name} [{unit or 1}/√Hz]", f"density-{name}")
            parts.append(figure(drawn, f"Amplitude density of {name}, two-sided; white noise is level at N."))
    return parts


def _sensors(channels: Mapping[str, Channel]) -> dict[str, dict[str, Channel]]:
    """Channels by sensor and axis; those without a number are left out."""
    found: dict[str, dict[str, Channel]] = {}
    for name, channel in channels.items():
        if np.isfinite(channel.values).any():
            found.setdefault(_AXIS.sub("", name), {})[name] = channel
    return found


def _series(log: Log, name: str, channel: Channel, k: int, unit: str) -> Line:
    good = np.isfinite(channel.values)
    values = np.asarray(from_si(channel.values[good], unit), float)
    return Line(name, log.t[good] - log.t[0], values, COLORS[k % len(COLORS)])


def _spectrum(line: Line) -> Line | None:
    """The amplitude density by Welch's method; None of few samples or of a clock that is not even."""
    from scipy.signal import welch

    n, steps = line.x.size, np.diff(line.x)
    dt = float(np.median(steps)) if n > 1 else 0.0
    if n < LEAST_SAMPLES or not dt > 0.0 or np.mean(np.abs(steps / dt - 1.0) > 0.5) > 0.01:
        return None
    f, power = welch(line.y, 1.0 / dt, nperseg=max(n // SEGMENTS, LEAST_SAMPLES), return_onesided=True)
    keep = (f > 0.0) & (power > 0.0)
    return Line(line.label, f[keep], np.sqrt(0.5 * power[keep]), line.color) if keep.sum() > 2 else None


def thinned(line: Line) -> Line:
    """A line with so few points that a picture is small: the least and the largest of each stretch stay."""
    stride = thin(line.x).step or 1
    whole = line.x.size // stride * stride
    if stride < 3:
        return line
    rows = line.y[:whole].reshape(-1, stride)
    places = np.sort(np.column_stack([rows.argmin(axis=1), rows.argmax(axis=1)]), axis=1)
    kept = (places + stride * np.arange(rows.shape[0])[:, None]).ravel()
    return Line(line.label, line.x[kept], line.y[kept], line.color)
