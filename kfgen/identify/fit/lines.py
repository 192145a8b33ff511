"""Periodic lines: narrow bands of the spectrum that stand above the floor about them.

They are found before any term is fitted (`kfgen.identify.evidence.spectral_floor`): a slow term that is fitted first
takes the power of a line for its own. Neighbours that stand out together are one line; lines whose frequencies are
multiples of one of them are its harmonics.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from kfgen.effects import Effect
from kfgen.identify.evidence.peaks import oscillations
from kfgen.identify.evidence.record import Record
from kfgen.identify.evidence.spectral_floor import SpectralFloor

Array = NDArray[np.float64]

MAX_ORDINATES_WITHIN_LINE = 40
"""Ordinates within which outstanding ones are one line."""
MAX_DISTANCE_WITHIN_LINE = 0.004
"""Of its frequency: the same of a line that wanders."""
MARGIN_ORDINATES = 6
"""Ordinates beside a line that are left out with it."""
MAX_LINE_WIDTH_OVER_FREQUENCY = 0.2
"""Beyond which it is a resonance and no line."""
LINE_REACH_HALF_WIDTHS = 8.0
"""From an effect's frequency to a line that is still of it."""
KNOWN_SHARE_OF_BAND = 0.1
"""Of its band: how well the frequency of a line is known."""
MAX_HARMONIC = 40
"""Harmonic that is looked at."""
STRETCHES = 64
"""Of a record, whose phases tell the frequency of a line."""
MAX_ACCIDENT_PROBABILITY = 0.05
"""That a line would be near a multiple of another by accident, above which it is not called its harmonic."""


@dataclass(frozen=True)
class PeriodicLine:
    """A spectral line.

    Parameters
    ----------
    frequency : float
        [Hz].
    amplitude : float
        Of a sinusoid of its power [SI].
    band : tuple of float
        What is left out of the fit for it [Hz].
    harmonic : int
        Which multiple it is of the frequency `fundamental`; one where it is of none.
    fundamental : float
        [Hz]; zero where it is no harmonic.
    """

    frequency: float
    amplitude: float
    band: tuple[float, float]
    harmonic: int = 1
    fundamental: float = 0.0


def find_lines(record: Record) -> list[PeriodicLine]:
    """The lines of a record.

    Parameters
    ----------
    record : Record
        Evenly sampled; bands that it leaves out already have no lines, but what is above a low-pass narrow ones.
    """
    seen = SpectralFloor.of(record)
    if seen is None:
        return []
    n = seen.omega.size
    to_hz = 1.0 / (2.0 * np.pi * record.dt * record.block)
    f = seen.omega * to_hz
    rolled_off = f > min((lo for lo, hi in record.skip if hi == np.inf), default=np.inf)
    marks, floor = seen.above(), seen.floor
    if rolled_off.any():
        marks, floor = np.where(rolled_off, seen.narrow(), marks), np.where(rolled_off, seen.beside, floor)
    for lo, hi in (band for band in record.skip if band[1] < np.inf):
        marks &= (f < lo) | (f > hi)
    out = np.flatnonzero(marks)
    if not out.size:
        return []
    distance = np.maximum(MAX_ORDINATES_WITHIN_LINE, MAX_DISTANCE_WITHIN_LINE * out[1:])
    lines = []
    for group in np.split(out, np.flatnonzero(np.diff(out) > distance) + 1):
        lo, hi = max(group[0] - MARGIN_ORDINATES, 0), min(group[-1] + MARGIN_ORDINATES, n - 1)
        wide = group[-1] - group[0] > MAX_LINE_WIDTH_OVER_FREQUENCY * group[0]
        if wide or not seen.stands_out(int(group[0]), int(group[-1])):
            continue
        around = slice(lo, hi + 1)
        excess = float(np.sum(seen.power[around] - floor[around]))
        above = np.maximum(seen.power[group] - floor[group], 0.0)
        centre = float(np.average(seen.omega[group], weights=above + 1e-3 * floor[group]))
        amplitude = float(np.sqrt(2.0 * max(excess, 0.0) / n))
        band = (float(f[lo]), float(f[hi]))
        lines.append(PeriodicLine(centre * to_hz, amplitude, band))
    return lines


def with_harmonics(lines: Sequence[PeriodicLine]) -> list[PeriodicLine]:
    """The same lines, those that are multiples of a lower one marked as its harmonics.

    A frequency is known to `KNOWN_SHARE_OF_BAND` of its band; that a multiple is met so well by accident is the chance that
    a line anywhere would be, for all the lower lines that were tried.

    Parameters
    ----------
    lines : sequence of PeriodicLine
    """
    found: list[PeriodicLine] = []
    for line in sorted(lines, key=lambda x: x.frequency):
        bases = [b for b in found if not b.fundamental]
        marked = line
        for base in bases:
            order = round(line.frequency / base.frequency)
            known = KNOWN_SHARE_OF_BAND * float(np.ptp(line.band) + order * np.ptp(base.band))
            chance = len(bases) * 2.0 * known / base.frequency
            off = abs(line.frequency - order * base.frequency)
            if 2 <= order <= MAX_HARMONIC and off < known and chance < MAX_ACCIDENT_PROBABILITY:
                marked = replace(line, harmonic=order, fundamental=base.frequency)
                break
        found.append(marked)
    return found


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


def without_lines(record: Record, lines: Sequence[PeriodicLine]) -> Record:
    """A record less its lines, the largest first, their bands left out of the likelihood.

    What is narrow reaches beyond its band: a line of a hundred times the floor leaves skirts that look like a slow term.

    Parameters
    ----------
    record : Record
        Evenly sampled.
    lines : sequence of PeriodicLine
        Of it.
    """
    t, y = record.elapsed, record.y
    for line in sorted(lines, key=lambda x: -x.amplitude):
        y = without_line(t, y, replace(line, frequency=_frequency(t, y, line)))
    return record.leaving_out(*(line.band for line in lines), y=y)


def _frequency(t: Array, y: Array, line: PeriodicLine) -> float:
    """Where the power near a line is highest [Hz], by its phase in stretches of the record."""
    size = y.size // STRETCHES
    turned = y * np.exp(-2j * np.pi * line.frequency * t)
    sums = turned[: size * STRETCHES].reshape(STRETCHES, size).sum(axis=1)
    step = size * float(t[-1] - t[0]) / (t.size - 1)
    padded = 64 * STRETCHES
    power = np.abs(np.fft.fft(sums, padded))
    return line.frequency + float(np.fft.fftfreq(padded, step)[int(np.argmax(power))])
