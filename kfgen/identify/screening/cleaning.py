"""A record without its shocks and outliers, and what was left out.

A few samples that are far out are interpolated. Where the tails are heavier than that, outliers are the wide one of two
normal laws (`kfgen.effects.samples.mixture`): their share and size are estimated, and each sample that is drawn to be one,
with its own probability, is drawn anew from the narrow law. The record is then one of the noise alone, of which
the size has no bias from where a threshold is set; its interval is wider by what the mixture leaves open.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from kfgen.effects.samples.event import Outliers
from kfgen.effects.samples.mixture import Mixture
from kfgen.effects.series import Detection, adc_step
from kfgen.identify import words
from kfgen.identify.evidence.record import Record
from kfgen.identify.screening.left_out import LeftOut
from kfgen.identify.screening.record_faults import interpolated, is_outlier
from kfgen.identify.screening.shocks import (
    away_from_neighbours,
    bridged,
    on_grid,
    shocks,
    shocks_said,
)

Array = NDArray[np.float64]

LARGE_DEVIATIONS = 4.0
"""Robust standard deviations beyond which samples are counted."""
SHARE_BEYOND = 6.334e-5
"""Of normal samples."""
COUNT_DEVIATIONS = 6.0
"""Standard deviations by which the count is larger than chance."""
STRETCHES = 20
LEVEL_WINDOW_SAMPLES = 101
"""Samples whose running median is what is slow."""
MAX_SHARE_BESIDE_HEAVY_TAILS = 0.005
"""Of samples that are far out of noise whose tails are heavy: more of them are its tails."""
MIN_KAPPA = 2.5
"""Standard deviation of outliers over that of the noise: below, it is noise whose size changes."""
MIN_EVIDENCE_NATS = 10.0
MIN_OUTLIERS = 20
"""Of the wide law: fewer are interpolated."""
MAX_STEP_OF_NOISE = 1.5
"""Step of the ADC grid over the noise, beyond which the law of the samples is that of the grid."""


def cleaned(record: Record) -> tuple[Record, list[str]]:
    """A record without shocks and outliers, with `LeftOut`, and sentences on them.

    Parameters
    ----------
    record : Record
        As it was sampled.
    """
    spans = shocks(record.y)
    said = shocks_said(record.t, spans)
    times = tuple((float(record.t[a]), float(record.t[b - 1])) for a, b in spans)
    y = bridged(record.y, spans)
    heavy = heavy_tailed(y)
    found = contaminated(y) if heavy else None
    if found is not None:
        y, detected, widening = found
        assert isinstance(detected.effect, Outliers)
        left = LeftOut(times, detected.effect, detected.ci95, widening)
        return replace(record, y=y, left_out=left), [*said, _mixture_said(detected)]
    bad = is_outlier(y)
    if heavy and float(np.mean(bad)) > MAX_SHARE_BESIDE_HEAVY_TAILS:
        bad[:] = False
    said += outliers_said(record.t, bad) + ([words.HEAVY_TAILS] if heavy else [])
    return replace(record, y=interpolated(y, bad), left_out=LeftOut(times)), said


def heavy_tailed(y: Array) -> bool:
    """Whether more samples are far from their neighbours than normal noise has, whatever its level in each stretch.

    Parameters
    ----------
    y : ndarray, shape (n,)
        Samples [SI].
    """
    away, scale = away_from_neighbours(y)
    step = adc_step(y)
    if step > MAX_STEP_OF_NOISE * scale / np.sqrt(1.5):
        return False
    if step > 0.0:  # on a coarse grid few values are possible: spread over it, tails are those of the noise
        u = np.random.default_rng(y.size).uniform(-0.5, 0.5, y.size) * step
        away, _ = away_from_neighbours(y + u)
    parts = np.array_split(np.abs(away), STRETCHES)
    large = sum(int((p > LARGE_DEVIATIONS * 1.4826 * np.median(p)).sum()) for p in parts)
    expected = SHARE_BEYOND * y.size
    return bool(large > expected + COUNT_DEVIATIONS * np.sqrt(expected) + MIN_OUTLIERS)


def contaminated(y: Array) -> tuple[Array, Detection, float] | None:
    """Samples with their outliers drawn anew, the outliers, and by how much the noise is less well known.

    Parameters
    ----------
    y : ndarray, shape (n,)
        Samples [SI] whose tails are heavy.

    Returns
    -------
    tuple or None
        None where one normal law is as good, or the wide one is not much wider, or has too many samples for outliers.
    """
    from scipy.ndimage import median_filter

    slow = median_filter(y, LEVEL_WINDOW_SAMPLES, mode="mirror")
    noise = y - slow
    parts = np.array_split(noise, STRETCHES)
    levels = [1.4826 * float(np.median(np.abs(p))) for p in parts]
    typical = float(np.median(levels))
    if not min(levels) > 0.0:
        return None
    local = np.concatenate([np.full(p.size, level) for p, level in zip(parts, levels)])
    z = noise / local
    mixture = Mixture.fitted(z, (0.0, 1.0))
    if (
        mixture is None
        or mixture.evidence < MIN_EVIDENCE_NATS
        or mixture.kappa < MIN_KAPPA
        or mixture.is_the_noise
    ):
        return None
    rng, scaled = np.random.default_rng(y.size), Outliers.of(mixture, 1.0).effect
    assert isinstance(scaled, Outliers)
    hit = rng.random(y.size) < scaled.chance(z, mixture.level)
    if hit.sum() < MIN_OUTLIERS:
        return None
    drawn = slow + local * mixture.level * rng.standard_normal(y.size)
    clean = np.where(hit, on_grid(drawn, adc_step(y), float(y[0])), y)
    known = 2.0 * y.size * float(mixture.spread[0]) ** 2 + mixture.share
    return clean, Outliers.of(mixture, typical), float(np.sqrt(max(known, 1.0)))


def outliers_said(t: Array, bad: NDArray[np.bool_]) -> list[str]:
    """A sentence on single outliers.

    Parameters
    ----------
    t : ndarray, shape (n,)
        Times [s].
    bad : ndarray of bool, shape (n,)
        Which samples are outliers.
    """
    at = np.flatnonzero(bad)
    if not at.size:
        return []
    return [words.outliers(at.size / bad.size, t[at].tolist())]


def _mixture_said(found: Detection) -> str:
    """A sentence on outliers that have a law of their own."""
    lo, hi = found.ci95["share"]
    effect = found.effect
    assert isinstance(effect, Outliers)
    return words.outlier_law(effect.share, lo, hi)
