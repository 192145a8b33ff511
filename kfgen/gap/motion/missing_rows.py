"""Rows that are missing on a clock that is even otherwise: samples without numbers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from kfgen.effects.driven.proportional import DRIVERS
from kfgen.gap.rest.even_record import MAX_MISSING_SHARE
from kfgen.log.log import Channel, Log

STEP_TOLERANCE_PERIODS = 0.1
"""Of a period: how far a step without its rows may be off a multiple of it."""


def with_missing(log: Log) -> tuple[Log, tuple[str, ...]]:
    """A log with the rows that it lacks, and what is to be said of them.

    They hold no number, but for the drivers, which change slowly and are interpolated. A log whose steps are no
    multiples of its period, or that lacks most of its rows, stays as it is.
    """
    steps = np.diff(log.t)
    if log.n < 3 or not steps.min() > 0.0:
        return log, ()
    usual = np.abs(steps - log.dt) <= 0.5 * log.dt
    dt = float(steps[usual].mean())
    whole = np.where(usual, 1.0, np.maximum(np.round(steps / dt), 1.0))
    off = np.abs(steps - whole * dt)[~usual] / dt
    place = np.concatenate([[0.0], np.cumsum(whole)])
    n = int(place[-1]) + 1
    if not off.size or off.max() > STEP_TOLERANCE_PERIODS or log.n < MAX_MISSING_SHARE * n:
        return log, ()
    even = np.arange(n)
    at = place.astype(np.intp)
    channels = {}
    for name, c in log.channels.items():
        values = np.full(n, np.nan)
        values[at] = c.values
        good = np.isfinite(c.values)
        if name in DRIVERS and good.any():
            values = np.where(np.isin(even, at), values, np.interp(even, place[good], c.values[good]))
        channels[name] = Channel(values, c.unit)
    gaps, first = int((~usual).sum()), float(log.t[int(np.argmin(usual))])
    words = (
        f"{n - log.n} rows of the log are missing, in {gaps} gap{'s' * (gaps > 1)} from t = {first:.6g} s on: nothing is "
        "compared there"
    )
    return replace(log, t=np.interp(even, place, log.t), channels=channels), (words,)
