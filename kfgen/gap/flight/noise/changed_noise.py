"""Noise of an aiding sensor whose level changes during a flight: a receiver that sees fewer satellites from some time on.

Its innovations stay white and become larger. What makes them larger and correlated is something else, and is left to the
search.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from kfgen.effects.samples.event import NoiseChange
from kfgen.gap.flight.faults.misread import sensor_of
from kfgen.gap.flight.flight_log import AidingSamples
from kfgen.gap.flight.path import FlownPath
from kfgen.gap.scene.scene import Placed

Array = NDArray[np.float64]

MIN_SAMPLES = 40
"""Of a sensor, before and after a change."""
MIN_SHARE = 0.1
"""Of them, before and after it: in the beginning a filter settles."""
MIN_GAIN_NATS = 15.0
"""Of two levels over one, less what the choice of the time costs."""
MIN_RATIO = 1.3
"""Of the two levels, the larger over the smaller."""
LAGS = (1, 2, 3)
"""Samples over which innovations beside a change are uncorrelated."""
MAX_CORRELATION_SIGMAS = 4.0
"""Of chance, up to which they are."""
FIT_STEPS = 40
"""Evaluations of the likelihood of two levels."""


def with_noise_changes(path: FlownPath) -> tuple[FlownPath, tuple[Placed, ...]]:
    """The path by samples whose noise has the level of its time, and what changed, sensor by sensor.

    Parameters
    ----------
    path : FlownPath
        Smoothed.
    """
    found, aiding = [], []
    for a in path.log.aiding:
        onset = _onset(path, a) if np.ptp(a.noise) == 0.0 else None  # of one that changed already
        ratio = _ratio(path, a, onset) if onset is not None else 1.0
        if onset is None or max(ratio, 1.0 / ratio) < MIN_RATIO:
            aiding.append(a)
            continue
        aiding.append(replace(a, noise=np.where(a.t >= onset, ratio, 1.0) * a.noise))
        since = onset - float(path.log.t[0])
        found.append(Placed(NoiseChange(ratio, since), sensor_of(a.sensor.channels)))
    if not found:
        return path, ()
    return replace(path, log=replace(path.log, aiding=tuple(aiding))).smoothed(), tuple(found)


def _onset(path: FlownPath, samples: AidingSamples) -> float | None:
    """The time [s] from which on the innovations of a sensor are of another size, and white before and after; None without."""
    z = np.column_stack([path.linear.normalised[path.rows.of(c)] for c in samples.sensor.channels])
    n, channels = z.shape
    least = max(MIN_SAMPLES, int(MIN_SHARE * n))
    k = np.arange(least, n - least)
    if not k.size:
        return None
    power = np.cumsum(np.sum(z**2, axis=1))
    before, after = power[k - 1] / (channels * k), (power[-1] - power[k - 1]) / (channels * (n - k))
    whole = power[-1] / (channels * n)
    gain = 0.5 * channels * (n * np.log(whole) - k * np.log(before) - (n - k) * np.log(after))
    best = int(np.argmax(gain))
    if gain[best] - np.log(k.size) < MIN_GAIN_NATS:
        return None
    first = int(k[best])
    return float(samples.t[first]) if _is_white(z[:first]) and _is_white(z[first:]) else None


def _is_white(z: Array) -> bool:
    """Whether series, shape (n, channels), are uncorrelated over a few samples but for chance."""
    z = z - z.mean(axis=0)
    power = np.maximum(np.sum(z**2, axis=0), 1e-300)
    sigmas = [np.abs(np.sum(z[lag:] * z[:-lag], axis=0) / power) * np.sqrt(z.shape[0]) for lag in LAGS]
    return bool(np.max(sigmas) < MAX_CORRELATION_SIGMAS)


def _ratio(path: FlownPath, samples: AidingSamples, onset: float) -> float:
    """The level of a sensor's noise after a time over that before it, by the filter's own likelihood."""
    from scipy.optimize import minimize

    rows, linear = path.rows, path.linear
    own = np.isin(rows.index, [rows.channels.index(c) for c in samples.sensor.channels])
    late = rows.t >= onset

    def loss(x: Array) -> float:
        level = np.where(own, np.exp(np.where(late, x[1], x[0])), 1.0)
        value = replace(linear, R=linear.R * level**2).filtered().log_likelihood
        return -value if np.isfinite(value) else 1e300

    simplex = np.array([[0.0, 0.0], [0.5, 0.0], [0.0, 0.5]])
    limits = {"maxfev": FIT_STEPS, "initial_simplex": simplex, "xatol": 0.01, "fatol": 0.01}
    x = np.asarray(minimize(loss, np.zeros(2), method="Nelder-Mead", options=limits).x)
    return float(np.exp(x[1] - x[0]))
