"""What a log holds of the drivers of effects: their courses without their own noise, and which of them show nothing."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from kfgen.effects import catalogue
from kfgen.effects.driven.proportional import DRIVERS
from kfgen.identify.evidence.whittle import block_means
from kfgen.log.course import between_samples, is_silent, longest_silence_s
from kfgen.log.log import Log

Array = NDArray[np.float64]

MAX_PLAIN_WINDOW_SAMPLES = 51
"""Samples of a window that is smoothed as it is."""
NOT_LOOKED_FOR = "no effect of it is looked for"
"""Of a driver whose course nobody knows."""


def drivers_of(log: Log) -> tuple[dict[str, Array], list[str]]:
    """All channels but references as what may drive others, and what is to be said of drivers that show nothing."""
    known = {cls.driver for cls in catalogue().values()} | set(DRIVERS)
    drive, said = _courses(log, (n for n in log.channels if not n.startswith("ref_")))
    for name in [n for n, v in drive.items() if np.ptp(v) == 0.0]:
        del drive[name]
        said[name] = f"channel {name} never changes: no effect of it can be seen"
    return drive, [words for name, words in said.items() if name in known]


def recorded(log: Log) -> dict[str, Array]:
    """The courses of the known drivers that a log holds, those that never change among them."""
    return _courses(log, (n for n in log.channels if n in DRIVERS))[0]


def silent(log: Log) -> list[str]:
    """What is to be said of known drivers whose course a log does not hold."""
    return list(_courses(log, (n for n in log.channels if n in DRIVERS))[1].values())


def _courses(log: Log, names: Iterable[str]) -> tuple[dict[str, Array], dict[str, str]]:
    """Smoothed courses over all times, and of channels without one why, in words."""
    drive: dict[str, Array] = {}
    said: dict[str, str] = {}
    for name in names:
        values = log.channel(name).values
        values = values[np.isfinite(values)]
        if not values.size:
            said[name] = f"channel {name} holds no number: {NOT_LOOKED_FOR}"
        elif is_silent(log, name):
            silence = f"has no sample for {longest_silence_s(log, name):.4g} s"
            said[name] = f"channel {name} {silence}: {NOT_LOOKED_FOR}"
        else:
            drive[name] = between_samples(log, name, smoothed(values))
    return drive, said


def smoothed(values: Array) -> Array:
    """A driver without its own noise, as far as that leaves nothing of it behind: parabolas over windows.

    A noisy regressor explains less than the quantity that it stands for. In units of its size to a power of two, which
    changes no digit: squares of any number are numbers then.
    """
    _, size = np.frexp(np.abs(values).max(initial=0.0))
    return np.asarray(np.ldexp(_smoothed(np.ldexp(values, -size)), size))


def _smoothed(values: Array) -> Array:
    # The mean square of third differences of white noise is 20 times its variance.
    noise2 = float(np.mean(np.diff(values, 3) ** 2)) / 20.0 if values.size > 8 else 0.0
    best, window = values, 5
    while 8 * window < values.size:
        trial = _parabolas(values, window)
        # A parabola takes up about 2.25 / window of the noise.
        left = float(np.mean((values - trial) ** 2)) / max(1.0 - 2.25 / window, 0.1)
        if left > noise2 * (1.02 + 4.0 * float(np.sqrt(2.0 / values.size))):
            break
        best, window = trial, 2 * window + 1
    return np.asarray(best)


def _parabolas(values: Array, window: int) -> Array:
    """Local parabolas over windows, shape (n,); long ones on means of short blocks."""
    from scipy.signal import savgol_filter

    block = max(1, window // MAX_PLAIN_WINDOW_SAMPLES)
    if block == 1:
        return np.asarray(savgol_filter(values, window, 2, mode="interp"))
    smooth = savgol_filter(block_means(values, block), 2 * (window // block // 2) + 1, 2, mode="interp")
    middle = (np.arange(smooth.size) + 0.5) * block
    return np.asarray(np.interp(np.arange(values.size) + 0.5, middle, smooth))
