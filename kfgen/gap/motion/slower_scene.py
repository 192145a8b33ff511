"""A scene of motion at a lower rate: long logs at high rates are compared in the band of motion.

What is compared are cosine transforms of residuals. Those of a log at a lower rate are the lowest of them, if every
series is brought to that rate by its transform: nothing of the band is lost, and nothing from above it gets in.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from kfgen.gap.motion.compared_channel import Compared
from kfgen.gap.motion.scene import MotionScene
from kfgen.gap.motion.truth import Truth

Array = NDArray[np.float64]
Name = TypeVar("Name", bound=str)

MAX_SAMPLES = 8_000
"""Up to which a log is compared at its own rate."""
MIN_RATE_HZ = 60.0
"""Motion of hands, vehicles and machines ends below half of it."""


def slower_scene(scene: MotionScene) -> MotionScene:
    """The scene at a rate that its band needs; as it is where it is short or slow, or where a sensor is slower than the log.

    Parameters
    ----------
    scene : MotionScene
    """
    n = scene.truth.t.size
    least = int(np.ceil(MIN_RATE_HZ * n * scene.dt))
    m = _quick_size(max(MAX_SAMPLES, least))
    if m >= n or any(c.rows is not None for c in scene.compared):
        return scene
    return replace(
        scene,
        truth=_truth(scene.truth, m),
        compared=tuple(_compared(c, m) for c in scene.compared),
        good=_all_of(scene.good, m),
        drive=_each(scene.drive, m),
    )


def _quick_size(n: int) -> int:
    from scipy.fft import next_fast_len

    return int(next_fast_len(n, real=True))


def _truth(truth: Truth, m: int) -> Truth:
    """What the references say, at `m` times; white noise of their samples is quieter."""
    n = truth.t.size
    step = truth.dt * n / m
    return replace(
        truth,
        t=truth.t[0] - 0.5 * truth.dt + step * (0.5 + np.arange(m)),
        read=_each(truth.read, m),
        good=_all_of(truth.good, m),
        omega_b=_of(truth.omega_b, m),
        f_b=_of(truth.f_b, m),
        power=_of(truth.power, m),
        warmth=_of(truth.warmth, m),
        R_bn=_of(truth.R_bn, m),
        speed_squared=_of(truth.speed_squared, m),
        antennas={s: (order, band_limited(R, m)) for s, (order, R) in truth.antennas.items()},
        angle=truth.angle * np.sqrt(m / n),
        floor=replace(truth.floor, level=truth.floor.level * m / n),
    )


def _compared(c: Compared, m: int) -> Compared:
    """A channel; samples that are not there are bridged first, lest the others ring."""
    at = np.arange(c.y.size)
    y = c.y if c.there.all() or not c.there.any() else np.interp(at, at[c.there], c.y[c.there])
    return replace(c, y=band_limited(y, m), keep=min(c.keep, m), there=_all_of(c.there, m))


def _each(series: Mapping[Name, Array], m: int) -> dict[Name, Array]:
    return {name: band_limited(x, m) for name, x in series.items()}


def _of(x: Array | None, m: int) -> Array | None:
    return None if x is None else band_limited(x, m)


def band_limited(x: Array, m: int) -> Array:
    """The band of a series below half of a lower rate, at that rate.

    Parameters
    ----------
    x : ndarray, shape (n, ...)
        At the middles of n equal intervals.
    m : int
        At those of m intervals over the same time, at most n.

    Returns
    -------
    ndarray, shape (m, ...)
    """
    from scipy.fft import dct, idct

    X = dct(x, type=2, axis=0, norm="ortho")[:m]
    return np.asarray(idct(X, type=2, axis=0, norm="ortho") * np.sqrt(m / x.shape[0]))


def _all_of(there: NDArray[np.bool_], m: int) -> NDArray[np.bool_]:
    """Whether all samples are there that meet an interval, shape (m,)."""
    n = there.size
    missing = np.concatenate([[0], np.cumsum(~there)])
    edges = np.arange(m + 1) * n / m
    first, last = np.floor(edges[:-1]).astype(int), np.minimum(np.ceil(edges[1:]).astype(int), n)
    return np.asarray(missing[last] == missing[first])
