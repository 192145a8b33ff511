"""What a course shows beyond its spectrum: what is made by a rule, and not by chance, has another law than normal noise."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kfgen.gap.core.course_figure import CourseFigure, largest, strangest

Array = NDArray[np.float64]

LAGS = (1, 2, 4, 8, 16)
"""Points over which changes and squares are looked at."""
HARMONICS = (2, 3)
"""Of the strongest line of a course, one after the other."""
MIN_CYCLES = 8
"""In a course whose cycles are looked at."""
CYCLE_WIDTH = 0.3
"""Standard deviation of a cycle's frequency, over the frequency: a thermostat does not keep time."""
HARMONIC_WIDTH = 0.6
"""Half the band of a harmonic, over the frequency of the cycles."""
PEAK_BINS = 5.0
"""Bins of a spectrum over which its peak is looked for (standard deviation)."""
STRENGTH_BINS = 3.0
"""Bins over which a line of the strength is looked for."""
SLIGHTLY_EVEN = 0.25
"""Power of its own spectrum by which a course is divided where its strength is looked at: cycles under what is slower count,
and noise that is faster does not. Of six records of chaos that 0.5 left unseen five show at 0.15 to 0.25."""
MIN_STRENGTH_BIN = 4
"""Slower changes of a course's strength are what chance gives."""
SWING_WIDTH = 0.1
"""Half the band of swings that keep no time, over their frequency."""
SHARE_OF_SPECTRUM = 1.0 / 3.0
"""Of the spectrum of the strength: what is faster is that of the noise beside the course."""


def figures_of_law(t: Array) -> list[CourseFigure]:
    """Every figure of courses at these times [s], shape (points,)."""
    span = float(t[-1] - t[0])
    bins = range(MIN_STRENGTH_BIN, max(int(SHARE_OF_SPECTRUM * t.size / 2.0), MIN_STRENGTH_BIN + 1))
    return [
        CourseFigure(strangest(_moments), lambda k: "its values and their changes have another law"),
        *_cycles(t.size),
        *_swings(t.size, span),
        CourseFigure(
            largest(lambda w: _strengths(w, bins), smoothed_over=STRENGTH_BINS),
            lambda k: f"its strength comes and goes at {bins[k] / span:.2g} Hz",
        ),
    ]


def _moments(w: Array) -> Array:
    """Skewness and kurtosis of courses and of their changes, and how squares go with what comes before and after, (figures, m).

    What is made by a rule and not by chance (a map, a switch, a limit) shows in the third moments of two times.
    """
    x = w - w.mean(axis=0)
    x = x / np.maximum(np.sqrt(_mean(x, x)), 1e-300)
    x2 = x * x  # powers of arrays are ten times as slow as products
    out = [_mean(x2, x), _mean(x2, x2)]
    for lag in (k for k in LAGS if k < len(x)):
        change = x[lag:] - x[:-lag]
        change2 = change * change
        size = np.maximum(change2.mean(axis=0), 1e-300)
        out += [_mean(change2, change) / size**1.5, _mean(change2, change2) / size**2]
        out += [_mean(x2[:-lag], x[lag:]), _mean(x[:-lag], x2[lag:])]
    return np.array(out)


def _mean(a: Array, b: Array) -> Array:
    """Of products, in each column."""
    return np.asarray(np.einsum("ij,ij->j", a, b) / len(a))


def _swings(points: int, span: float) -> list[CourseFigure]:
    """Bands of a tenth of their frequency to either side, of which one may hold swings that keep no time: a thermostat's."""
    last = (points - 1) // 2
    if last <= MIN_CYCLES:
        return []
    count = int(np.log(last / MIN_CYCLES) / np.log1p(0.4 * SWING_WIDTH))
    at = np.geomspace(MIN_CYCLES, last, max(count, 2))
    lo = np.floor((1.0 - SWING_WIDTH) * at).astype(np.int64)
    hi = np.minimum(np.ceil((1.0 + SWING_WIDTH) * at).astype(np.int64), last)

    def bands(every: Array) -> Array:
        power = np.abs(np.fft.rfft(np.diff(every, axis=0), axis=0)[1 : last + 1]) ** 2
        power /= np.maximum(power[:, 1:].mean(axis=1), 1e-300)[:, None]
        total = np.vstack([np.zeros(power.shape[1]), np.cumsum(power / power.sum(axis=0), axis=0)])
        return np.asarray(total[hi] - total[lo])

    return [
        CourseFigure(strangest(bands, larger=True), lambda k: f"it swings at about {at[k] / span:.2g} Hz")
    ]


def _strengths(w: Array, bins: range) -> Array:
    """Spectra of what courses are without their signs: chaos that changes sides has a line there."""
    size = np.abs(_evened(w, SLIGHTLY_EVEN))
    return np.asarray(np.abs(np.fft.rfft(size - size.mean(axis=0), axis=0)[bins.start : bins.stop]) ** 2)


def _evened(every: Array, power: float) -> Array:
    """Courses whose spectrum is divided by this power of the mean one of those that the model gives (the first is none).

    In ordinates of the cosine transform, in which the model's are independent: what is strong does not leak from the ends.
    """
    from scipy.fft import dct, idct

    D = dct(every, axis=0, norm="ortho")
    D[0] = 0.0
    D[1:] /= np.maximum(np.mean(D[1:, 1:] ** 2, axis=1), 1e-300)[:, None] ** (0.5 * power)
    return np.asarray(idct(D, axis=0, norm="ortho"))


def _cycles(points: int) -> list[CourseFigure]:
    """How well harmonics keep step with the strongest line of a course.

    The phase of the line is that of its analytic signal, however its frequency drifts; a harmonic that is part of a shape
    has a multiple of that phase, and noise of the same spectrum has any. The spectrum is made even first.
    """
    bins = np.arange(points // 2 + 1)[:, None]
    last = bins.size // HARMONICS[0]
    if last <= MIN_CYCLES:
        return []

    def line_of(X: Array) -> NDArray[np.intp]:
        from scipy.ndimage import gaussian_filter1d

        peaks = gaussian_filter1d(np.abs(X[:last]) ** 2, PEAK_BINS, axis=0)
        return np.asarray(MIN_CYCLES + peaks[MIN_CYCLES:].argmax(axis=0))

    def signal(X: Array, line: NDArray[np.intp]) -> Array:
        near = np.exp(-0.5 * ((bins - line) / (CYCLE_WIDTH * line)) ** 2) * (np.abs(bins - line) < 0.5 * line)
        return np.asarray(np.fft.ifft(X * near, points, axis=0))

    def in_step(every: Array) -> Array:
        X = _transform(every)
        even, line = _transform(_evened(every, 1.0)), line_of(X)
        cycle = signal(X, line)
        step = cycle / np.maximum(np.abs(cycle), 1e-300)
        out, turned = [], step
        for q in HARMONICS:
            turned = turned * step
            shape = np.fft.fft(turned, axis=0)[: bins.size] * (
                np.abs(bins - q * line) < HARMONIC_WIDTH * line
            )
            size = np.maximum(np.linalg.norm(shape, axis=0), 1e-300)
            out.append(np.abs(np.sum(even * shape.conj(), axis=0)) / size)
        return np.array(out)

    return [
        CourseFigure(
            largest(in_step, share=False),
            lambda k: f"its cycles have a shape: harmonic {HARMONICS[k]} keeps step with them",
        )
    ]


def _transform(every: Array) -> Array:
    return np.asarray(np.fft.rfft(every - every.mean(axis=0), axis=0))
