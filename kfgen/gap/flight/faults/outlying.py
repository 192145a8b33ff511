"""Single readings of a flight far from what the filter expects, while those before and after them are not."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from kfgen.effects.samples.event import Outliers
from kfgen.gap.flight.faults.misread import sensor_of
from kfgen.gap.flight.flight_log import AidingSamples
from kfgen.gap.flight.path import FlownPath
from kfgen.gap.flight.rows import rows_of
from kfgen.gap.scene.scene import Placed

Array = NDArray[np.float64]

MIN_FIRST_SIGMAS = 5.0
"""Innovation of an outlier, in standard deviations of its channel's bulk or of its filter, whichever are larger."""
MIN_OTHER_SIGMAS = 3.0
"""The same beside others of the sensor, of which it is likelier to be one than noise."""
MAX_NEIGHBOUR_SHARE = 0.5
"""Of it, that the median of the two before and the two after has at most: a delay in a manoeuvre lasts longer."""
BESIDE = (0, 1, 3, 4)
"""Of five samples, those about the one in the middle."""
BULK_SAMPLES = 101
"""About a sample, whose median innovation is the bulk's: noise may become louder."""
MIN_OUTLIERS = 3
MIN_OUTLIER_SHARE = 0.003
"""Of a sensor's samples, below which nothing is left out."""
MAX_LATE_S = 0.4
"""By which a reading may belong to another time: what the filter expects within it is no error of one reading [s]."""
MIN_SHARE_OF_LARGEST = 0.3
"""Of the largest outlier, that others have to be left out with it: it bends the path, which makes some and hides others."""
MAX_ROUNDS = 16
"""Of leaving out."""


@dataclass(frozen=True)
class SensorOutliers:
    """The outliers of a sensor.

    Parameters
    ----------
    samples : int
        Of the sensor, with them.
    errors : ndarray, shape (m, channels)
        Of its outliers [SI], zero in channels that have none.
    size : float
        Their root mean square in standard deviations of the innovations.
    """

    samples: int
    errors: Array
    size: float = 0.0

    @property
    def effect(self) -> Outliers:
        """Their share of the readings, and their standard deviation."""
        far = self.errors[self.errors != 0.0]
        return Outliers(share=far.size / (self.samples * self.errors.shape[1]), sigma=_rms(far))

    @property
    def limit(self) -> float:
        """Standard deviations of an innovation beyond which it is likelier one of these than noise."""
        if not self.errors.size:
            return MIN_FIRST_SIGMAS
        share = float(self.effect.share)
        odds = max((1.0 - share) / share * self.size, 1.0)
        return float(np.clip(np.sqrt(2.0 * np.log(odds)), MIN_OTHER_SIGMAS, MIN_FIRST_SIGMAS))


def without_outliers(path: FlownPath) -> tuple[FlownPath, tuple[Placed, ...]]:
    """The path by the other samples, and what was left out, sensor by sensor.

    Parameters
    ----------
    path : FlownPath
        Smoothed.
    """
    found = [SensorOutliers(a.t.size, np.zeros((0, a.z.shape[1]))) for a in path.log.aiding]
    for _ in range(MAX_ROUNDS):
        seen = [_outlying(path, a, o) for a, o in zip(path.log.aiding, found)]
        more = [_with(o, *s) for o, s in zip(found, seen)]
        if all(m is o for m, o in zip(more, found)):
            break
        kept = [a if m is o else a.kept(~s[0]) for a, s, m, o in zip(path.log.aiding, seen, more, found)]
        log, found = replace(path.log, aiding=tuple(kept)), more
        path = replace(path, log=log, dz=np.zeros(rows_of(log).t.size)).smoothed()
    named = [(o, sensor_of(a.sensor.channels)) for o, a in zip(found, path.log.aiding) if o.errors.size]
    return path, tuple(Placed(o.effect, name) for o, name in named)


def _with(found: SensorOutliers, far: NDArray[np.bool_], errors: Array, sizes: Array) -> SensorOutliers:
    """With more of them."""
    if not far.any():
        return found
    n, m = found.errors.shape[0], errors.shape[0]
    size = np.sqrt((n * found.size**2 + m * _rms(sizes) ** 2) / (n + m))
    return replace(found, errors=np.concatenate([found.errors, errors]), size=float(size))


def _outlying(
    path: FlownPath, samples: AidingSamples, found: SensorOutliers
) -> tuple[NDArray[np.bool_], Array, Array]:
    """Which samples of a sensor are its largest outliers; their errors, zero in other channels, and their sizes.

    None where all together are too few to be any.
    """
    from scipy.ndimage import median_filter

    far = np.zeros(samples.z.shape, dtype=bool)
    errors, sizes = np.zeros(samples.z.shape), np.zeros(samples.z.shape)
    courses = path.equations.reading(samples.sensor).table(path.given).T
    for k, (c, course) in enumerate(zip(samples.sensor.channels, courses)):
        rows = path.rows.of(c)
        size, z = np.abs(path.linear.normalised[rows]), path.rows.z[rows]
        bulk = np.maximum(1.0, 1.4826 * median_filter(size, min(BULK_SAMPLES, size.size), mode="reflect"))
        around = np.median(sliding_window_view(np.pad(size, 2, mode="reflect"), 5)[:, BESIDE], axis=1)
        errors[:, k], sizes[:, k] = z - path.at_rows(course, c), size / bulk
        beyond = _beyond(path, course, c) / np.maximum(np.abs(errors[:, k]), 1e-300)
        far[:, k] = (size * beyond > found.limit * bulk) & (around < MAX_NEIGHBOUR_SHARE * size)
    count = found.errors.shape[0] + int(far.any(axis=1).sum())
    if count < max(MIN_OUTLIERS, MIN_OUTLIER_SHARE * found.samples):
        far[:] = False
    far &= sizes >= MIN_SHARE_OF_LARGEST * sizes[far].max(initial=0.0)
    any_far: NDArray[np.bool_] = np.logical_or.reduce(far, axis=1)
    return any_far, np.where(far, errors, 0.0)[any_far], sizes[far]


def _beyond(path: FlownPath, course: Array, channel: str) -> Array:
    """How far each reading is beyond all that is expected a little earlier or later [SI]."""
    from scipy.ndimage import maximum_filter1d, minimum_filter1d

    rows = path.rows.of(channel)
    t, z, at = path.log.t, path.rows.z[rows], path.rows.at[rows]
    wide = 2 * round(MAX_LATE_S / (t[1] - t[0])) + 1
    low, high = minimum_filter1d(course, wide)[at], maximum_filter1d(course, wide)[at]
    return np.asarray(np.maximum(np.maximum(z - high, low - z), 0.0))


def _rms(x: Array) -> float:
    return float(np.sqrt(np.mean(x**2)))
