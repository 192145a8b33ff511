"""Periodic lines: single ordinates of the transform that no noise explains.

Under the fitted model every ordinate over its expectation is a chi-square of one degree of freedom,
so the largest of n exceeds its ``1 - alpha / n`` quantile with probability alpha: Fisher's test with a
coloured floor [1]_. Neighbours that stand out together are one line.

References
----------
.. [1] R. A. Fisher, Tests of significance in harmonic analysis, Proc. R. Soc. A 125, 1929.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kfgen.effects import Effect
from kfgen.identify.evidence.peaks import grid_with_peaks, oscillations
from kfgen.identify.evidence.record import Record
from kfgen.identify.evidence.whittle import density_of_differences, frequencies

Array = NDArray[np.float64]

FALSE_ALARM_PER_RECORD = 1e-3
"""Of one record."""
MIN_ORDINATE_OF_LINE = 30
"""Ordinates at the bottom in which a drift is no line."""
MAX_ORDINATES_WITHIN_LINE = 40
"""Ordinates within which outstanding ones are one line."""
MARGIN_ORDINATES = 6
"""Ordinates beside a line that are left out with it."""
MAX_ORDINATES_OF_LINE = 400
"""Ordinates beyond which it is a resonance and no line."""


LINE_REACH_HALF_WIDTHS = 8.0
"""From an effect's frequency to a line that is still of it."""


@dataclass(frozen=True)
class PeriodicLine:
    """A line: frequency [Hz], amplitude [SI], and the band [Hz] that is left out of the fit for it."""

    frequency: float
    amplitude: float
    band: tuple[float, float]


def find_lines(record: Record, effects: Sequence[Effect]) -> list[PeriodicLine]:
    """The lines of a record above the noise that `effects` expect.

    Parameters
    ----------
    record : Record
        Evenly sampled.
    effects : sequence of Effect
        With their values [SI].
    """
    from scipy.stats import chi2

    X = record.sines
    n = X.size
    omega = frequencies(n)
    grid = grid_with_peaks(np.geomspace(omega[0], omega[-1], 512), effects, record.dt * record.block)
    S = np.exp(
        np.interp(
            np.log(omega),
            np.log(grid),
            np.log(density_of_differences(effects, grid, record.dt, record.block)),
        )
    )
    out = np.flatnonzero(chi2.isf(FALSE_ALARM_PER_RECORD / n, 1) < X**2 / S)
    out = out[out >= MIN_ORDINATE_OF_LINE]
    if not out.size:
        return []
    to_hz = 1.0 / (2.0 * np.pi * record.dt * record.block)
    lines = []
    for group in np.split(out, np.flatnonzero(np.diff(out) > MAX_ORDINATES_WITHIN_LINE) + 1):
        lo, hi = max(group[0] - MARGIN_ORDINATES, 0), min(group[-1] + MARGIN_ORDINATES, n - 1)
        if hi - lo > MAX_ORDINATES_OF_LINE:
            continue
        around = slice(lo, hi + 1)
        excess = float(np.sum(X[around] ** 2 - S[around]))
        centre = float(np.average(omega[group], weights=X[group] ** 2))
        amplitude = np.sqrt(2.0 * max(excess, 0.0) / n) / (2.0 * np.sin(0.5 * centre))
        lines.append(
            PeriodicLine(
                centre * to_hz, float(amplitude), (float(omega[lo]) * to_hz, float(omega[hi]) * to_hz)
            )
        )
    return lines


def is_of(line: PeriodicLine, effects: Sequence[Effect]) -> bool:
    """Whether a line belongs to one of the effects that are fitted: then it is not removed.

    Parameters
    ----------
    line : PeriodicLine
        As it was found beside the fit.
    effects : sequence of Effect
        Those that oscillate, random or not, have their frequency and its half width.
    """
    lo, hi = line.band
    peaks = [p for e in effects for p in oscillations(e)]
    return any(
        lo - LINE_REACH_HALF_WIDTHS * p.half_width
        <= p.frequency
        <= hi + LINE_REACH_HALF_WIDTHS * p.half_width
        for p in peaks
    )


def without_line(t: Array, y: Array, line: PeriodicLine) -> Array:
    """Samples less the sinusoid at a line's frequency, by least squares at any times [s], shape (n,).

    Parameters
    ----------
    t, y : ndarray, shape (n,)
        Times [s] and samples [SI].
    line : PeriodicLine
        Whose frequency is removed.
    """
    phase = 2.0 * np.pi * line.frequency * t
    X = np.column_stack([np.cos(phase), np.sin(phase), np.ones(t.size)])
    theta = np.linalg.lstsq(X, y, rcond=None)[0]
    return np.asarray(y - X[:, :2] @ theta[:2])
