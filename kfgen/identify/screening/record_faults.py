"""What is wrong with the samples of a record, found before any fit.

Outliers, values at the ends of the range or on a coarse ADC grid, noise that changes its size, and an internal low-pass.

Outliers and the low-pass are found with medians, which what they look for cannot move.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from kfgen.effects.series import adc_step
from kfgen.identify import words
from kfgen.identify.evidence.record import Record
from kfgen.identify.evidence.whittle import frequencies
from kfgen.identify.screening.stuck import stuck_spans

Array = NDArray[np.float64]

OUTLIER_DEVIATIONS = 9.0
"""Robust standard deviations beyond which a sample is an outlier: white noise that doubles its size has none."""
JUMP_DEVIATIONS = 6.0
"""The same standard deviations between neighbours, beyond which a sample is looked at."""
MEDIAN_WINDOW_SAMPLES = 7
"""Samples of which the median is taken."""
STRETCHES_OF_RECORD = 20
SAMPLES_OF_EACH_STRETCH = 10_000
"""Samples of each stretch of a record from which the standard deviation is taken."""
COARSE_STEP_IN_DEVIATIONS = 1.5
"""Steps of the ADC grid in standard deviations beyond which a quantised sample is no sample of the noise."""
CLIPPED_SHARE = 0.02
"""Share of samples at the ends of the range that is no chance."""
NOISE_CHANGE_DEVIATIONS = 6.0
"""Standard deviations of a stretch's noise from that of the others that are no chance."""
MAX_OUTLIER_SHARE = 0.05
"""Share of outliers beyond which they are the noise."""
ROLLED_OFF_SHARE_OF_POWER = 0.7
"""Share of the plateau's power below which a band belongs to the low-pass."""
KEPT_SHARE_OF_ROLL_OFF_FREQUENCY = 0.35
"""Of the frequency where that begins: there a second-order low-pass has taken 1 %."""
KEPT_SHARE_OF_FIRST_ORDER = 0.15
"""The same of a first-order one."""
FAR_ROLLED_OFF_SHARE = 0.4
"""Share of the plateau's power at which the order of the low-pass shows."""
MAX_FALL_OF_SECOND_ORDER = 1.5
"""Of the two frequencies: 1.37 of a low-pass of second order, 1.87 of one of first order."""
LOOKED_AT_OVER_FALL = 3
"""Of the frequency where it falls: as far it is looked at again."""
MIN_SHRINKING = 0.9
"""Of the ordinates that are looked at, above which nothing new is seen."""
MIN_BANDS, MAX_BANDS, ORDINATES_OF_A_BAND = 15, 50, 21
"""Into which a spectrum is divided: a median of fewer ordinates says little."""
MIN_BANDS_ROLLED_OFF = 5
"""At the end of the spectrum."""


@dataclass(frozen=True)
class Spread:
    """How far samples are from the median of themselves and their neighbours, robustly [SI]."""

    scale: float

    @staticmethod
    def of(y: Array) -> Spread:
        """From stretches spread over a record, shape (n,)."""
        from scipy.ndimage import median_filter

        size = max(y.size // STRETCHES_OF_RECORD, MEDIAN_WINDOW_SAMPLES)
        parts = [
            y[a : a + min(size, SAMPLES_OF_EACH_STRETCH)]
            for a in range(0, max(y.size - MEDIAN_WINDOW_SAMPLES, 1), size)
        ]
        distance = np.concatenate(
            [p - median_filter(p, size=MEDIAN_WINDOW_SAMPLES, mode="mirror") for p in parts]
        )
        scale = 1.4826 * float(np.median(np.abs(distance - np.median(distance))))
        return Spread(max(scale, adc_step(y), float(np.finfo(float).tiny)))

    def is_outlier(self, y: Array) -> NDArray[np.bool_]:
        """Which samples are outliers or no numbers, shape (n,).

        A sample is an outlier when it is far from the median of itself and its neighbours; a step or a drift
        is none. More than `MAX_OUTLIER_SHARE` of them are the noise. An outlier makes a jump, so that only the
        neighbourhood of jumps is looked at.
        """
        bad = ~np.isfinite(y)
        jump = np.flatnonzero(np.abs(np.diff(y)) > JUMP_DEVIATIONS * self.scale)
        if jump.size:
            near = np.unique((jump[:, None] + np.arange(-2, 4)).clip(0, y.size - 1))
            around = np.abs(
                near[:, None] + np.arange(-(MEDIAN_WINDOW_SAMPLES // 2), MEDIAN_WINDOW_SAMPLES // 2 + 1)
            )
            around = np.minimum(around, 2 * (y.size - 1) - around)  # mirrored at both ends
            far = np.abs(y[near] - np.median(y[around], axis=1)) > OUTLIER_DEVIATIONS * self.scale
            if far.sum() <= MAX_OUTLIER_SHARE * y.size:
                bad[near[far]] = True
        return bad


def is_outlier(y: Array) -> NDArray[np.bool_]:
    """Which samples of a record are outliers, shape (n,)."""
    return Spread.of(y).is_outlier(y)


def interpolated(y: Array, bad: NDArray[np.bool_]) -> Array:
    """The samples with the bad ones interpolated.

    Parameters
    ----------
    y : ndarray, shape (n,)
        Samples [SI].
    bad : ndarray of bool, shape (n,)
        Which of them are replaced.
    """
    if not bad.any():
        return y
    at = np.arange(y.size, dtype=float)
    return np.asarray(np.interp(at, at[~bad], y[~bad]))


def amplitude_faults(y: Array) -> list[str]:
    """Sentences on samples that stand at the ends of the range, or on an ADC grid wider than the noise."""
    white = float(np.sqrt(0.5 * np.mean(np.diff(y) ** 2)))
    ends = float(np.mean(y == y.max()) + np.mean(y == y.min()))
    step, said = adc_step(y), list[str]()
    if step > COARSE_STEP_IN_DEVIATIONS * white:
        said.append(words.coarse_grid(step / white))
    elif ends > CLIPPED_SHARE and step < 0.1 * white:
        said.append(words.clipped(ends))
    return said


def stuck_in(record: Record) -> list[str]:
    """A sentence on samples that repeat one value for longer than noise lets them.

    Parameters
    ----------
    record : Record
    """
    steps = np.diff(record.y)
    moved = steps[steps != 0.0]
    if record.averaged > 1 or moved.size < MIN_BANDS:
        return []
    spans = stuck_spans(record.y, float(np.sqrt(0.5 * np.mean(moved**2))))
    if not spans:
        return []
    first, last = max(spans, key=lambda span: span[1] - span[0])
    return [words.stuck((last - first) * record.dt, float(record.t[first]), len(spans) - 1)]


def noise_change(y: Array) -> tuple[float, float] | None:
    """The smallest and the largest standard deviation of a sample [SI] over stretches, where they differ beyond chance.

    The mean square of the differences of a stretch has about a third of the degrees of freedom of its
    samples; `NOISE_CHANGE_DEVIATIONS` standard deviations of its logarithm are asked for, and a tenth of its size.
    """
    parts = np.array_split(np.diff(y), STRETCHES_OF_RECORD)
    level = np.array([float(np.mean(part**2)) for part in parts])
    if y.size < 100 * STRETCHES_OF_RECORD or not (level > 0.0).all():
        return None
    spread = float(np.sqrt(6.0 * STRETCHES_OF_RECORD / y.size))
    off = float(np.abs(np.log(level / np.median(level))).max())
    if off < max(NOISE_CHANGE_DEVIATIONS * spread, 2.0 * np.log(1.1)):
        return None
    return float(np.sqrt(0.5 * level.min())), float(np.sqrt(0.5 * level.max()))


def roll_off(record: Record) -> float | None:
    """The frequency [Hz] from which on an internal low-pass takes power away, None without one.

    A slow one has fallen over most of the band, plateau and all: it is looked at again about where it falls.
    """
    X = record.sines
    n = whole = X.size
    power = X**2 / (4.0 * np.sin(0.5 * frequencies(n)) ** 2)
    cut = 0.0
    while (fall := _Fall.of(power[:n])) is not None:
        cut, before, n = fall.kept, n, min(n, LOOKED_AT_OVER_FALL * fall.first)
        if n > MIN_SHRINKING * before:
            break
    return float(0.5 * cut / whole / (record.dt * record.block)) if cut else None


@dataclass(frozen=True)
class _Fall:
    """Ordinates from which on a spectrum has fallen a little, and far; zero where it has not."""

    first: int
    far: int

    @staticmethod
    def of(power: Array) -> _Fall | None:
        """None where it does not fall, or rises again."""
        n = power.size
        count = min(MAX_BANDS, n // ORDINATES_OF_A_BAND)
        if count < MIN_BANDS:
            return None
        edges = np.linspace(n // MAX_BANDS, n, count).astype(int)
        # The median of a chi-square of one degree of freedom is 0.4549.
        level = np.array([np.median(power[a:b]) for a, b in pairwise(edges)]) / 0.4549
        level /= np.median(level[: level.size // 3])
        first, far = (_last_above(level, s) + 1 for s in (ROLLED_OFF_SHARE_OF_POWER, FAR_ROLLED_OFF_SHARE))
        if first > level.size - MIN_BANDS_ROLLED_OFF:
            return None
        return _Fall(int(edges[max(first, 1)]), int(edges[far]) if far < level.size else 0)

    @property
    def kept(self) -> float:
        """The ordinate up to which hardly any power is lost."""
        is_steep = 0 < self.far < MAX_FALL_OF_SECOND_ORDER * self.first
        return self.first * (KEPT_SHARE_OF_ROLL_OFF_FREQUENCY if is_steep else KEPT_SHARE_OF_FIRST_ORDER)


def _last_above(level: Array, share: float) -> int:
    """The last band of that level or above, -1 without one."""
    above = np.flatnonzero(level >= share)
    return int(above[-1]) if above.size else -1
