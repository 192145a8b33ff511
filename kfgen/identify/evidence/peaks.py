"""Narrow peaks of a spectrum: where they are, and bins fine enough for them.

A random effect whose states oscillate has a peak at the imaginary part of an eigenvalue of its ``A``, of a half width
given by the real part. A bin that is wider than the peak would take the density at its own middle for that of all
its ordinates: the effect's size would be wrong by any factor. So bins about a peak are split, down to single ordinates.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from kfgen.effects import Effect

Array = NDArray[np.float64]
Edges = NDArray[np.int64]

MAX_HALF_WIDTH_OVER_FREQUENCY = 0.5
"""A wider peak needs no bins of its own."""
MIN_HALF_WIDTH_OVER_FREQUENCY = 1e-6
"""A peak that is not damped is taken to be as wide as this."""
BINS_PER_HALF_WIDTH = 8
"""Bins in the half width of a peak, and in the distance to it farther away."""
MAX_KEPT_EFFECTS = 1024
"""Effects whose oscillations are kept: a fit asks for them again and again."""
GRID_IN_HALF_WIDTHS = np.concatenate([[0.0], np.geomspace(0.05, 1e3, 60)])
"""Where a density that is interpolated is computed, on both sides of a peak."""


@dataclass(frozen=True)
class SpectralPeak:
    """A peak of a spectral density.

    Parameters
    ----------
    frequency : float
        Of its centre [Hz].
    half_width : float
        From there to half of its height [Hz].
    """

    frequency: float
    half_width: float

    def rounded(self) -> SpectralPeak:
        """A peak nearby, the same for all within a quarter of a half width: bins stay where they are during a fit."""
        width = 2.0 ** round(np.log2(self.half_width))
        return SpectralPeak(round(self.frequency / (0.5 * width)) * 0.5 * width, width)

    def folded(self, dt: float) -> SpectralPeak:
        """Where it shows in samples every `dt` [s]: below half the sampling rate."""
        turns = self.frequency * dt
        return SpectralPeak(abs(turns - round(turns)) / dt, self.half_width)


def spectral_peaks(effects: Sequence[Effect]) -> tuple[SpectralPeak, ...]:
    """The narrow peaks that the random ones among effects have."""
    return tuple(peak for e in effects if not e.coefficients() for peak in oscillations(e))


@lru_cache(MAX_KEPT_EFFECTS)
def oscillations(effect: Effect) -> tuple[SpectralPeak, ...]:
    """The frequencies at which an effect, random or not, oscillates, with their half widths."""
    form = effect.form()
    if form.order < 2 or not any(_is_coupled(form.A, i, k) for i in range(form.order) for k in range(i)):
        return ()
    found = []
    for value in np.linalg.eigvals(np.array(form.A, dtype=np.float64)):
        f, half = value.imag / (2.0 * np.pi), abs(value.real) / (2.0 * np.pi)
        if f > 0.0 and half < MAX_HALF_WIDTH_OVER_FREQUENCY * f:
            found.append(SpectralPeak(float(f), float(max(half, MIN_HALF_WIDTH_OVER_FREQUENCY * f))))
    return tuple(found)


def _is_coupled(A: tuple[tuple[object, ...], ...], i: int, k: int) -> bool:
    """Whether two states drive each other: without that nothing oscillates."""
    return A[i][k] != 0 and A[k][i] != 0


def split_edges(edges: Edges, peaks: Sequence[SpectralPeak], dt: float, ordinates: int) -> Edges:
    """Edges of bins with more of them about peaks.

    Parameters
    ----------
    edges : ndarray of int, shape (m + 1,)
        As numbers of ordinates.
    peaks : sequence of SpectralPeak
    dt : float
        Time between the samples (or blocks) that were transformed [s].
    ordinates : int
        Of the whole record, up to half the sampling rate.

    Returns
    -------
    ndarray of int, shape (k + 1,)
        Those of `edges` among them.
    """
    if not peaks:
        return edges
    per_hz = 2.0 * dt * (ordinates + 1)
    lo, hi = edges[:-1], edges[1:]
    wanted = (hi - lo).astype(np.float64)
    for peak in (p.folded(dt) for p in peaks):
        centre = peak.frequency * per_hz - 1.0
        away = np.maximum(np.maximum(lo - centre, centre - hi), 0.0)
        wanted = np.minimum(wanted, np.hypot(away, peak.half_width * per_hz) / BINS_PER_HALF_WIDTH)
    pieces = np.ceil((hi - lo) / np.maximum(wanted, 1.0)).astype(np.int64)
    fine = [
        np.linspace(a, b, k, endpoint=False)
        for a, b, k in zip(lo[pieces > 1], hi[pieces > 1], pieces[pieces > 1])
    ]
    return np.unique(np.concatenate([edges, *(np.round(f) for f in fine)])).astype(np.int64)


def grid_with_peaks(omega: Array, effects: Sequence[Effect], dt: float) -> Array:
    """Angular frequencies at which the density of effects is computed to be interpolated.

    Parameters
    ----------
    omega : ndarray, shape (m,)
        Grid that is fine enough without peaks [rad per sample].
    effects : sequence of Effect
    dt : float
        Sampling period [s].

    Returns
    -------
    ndarray, shape (k,)
        Increasing, in the same range.
    """
    peaks = [p.folded(dt) for p in spectral_peaks(effects)]
    if not peaks:
        return omega
    sides = np.concatenate([-GRID_IN_HALF_WIDTHS, GRID_IN_HALF_WIDTHS])
    near = np.concatenate([2.0 * np.pi * dt * (p.frequency + p.half_width * sides) for p in peaks])
    return np.unique(np.concatenate([omega, near[(near > omega[0]) & (near < omega[-1])]]))
