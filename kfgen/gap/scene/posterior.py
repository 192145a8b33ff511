"""The likelihood of a scene: residuals, the levels of the noise of its channels, the priors of its unknowns.

Each channel's noise may be louder or quieter than assumed: its level has a log-normal prior of `NOISE_LEVEL_SD_OF_LOG`
and is profiled out, so that a noise of the wrong size is no evidence for anything else.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from kfgen.gap.scene.scene import HasOwnNoiseLevels, Scene

Array = NDArray[np.float64]

NOISE_LEVEL_SD_OF_LOG = 0.1
"""Standard deviation of the logarithm of a channel's noise level."""
MAX_LEVEL_STEPS = 30
LEVEL_TOLERANCE = 1e-14
"""Step of the logarithm of a noise level at which it is found."""


def level_sd_of_log(scene: Scene) -> float:
    """Standard deviation of the logarithm of a channel's noise level, before the log."""
    return scene.noise_level_sd_of_log if isinstance(scene, HasOwnNoiseLevels) else NOISE_LEVEL_SD_OF_LOG


def levels_of(scene: Scene, residual: Array) -> Array:
    """The most likely level of each channel's noise, shape (channels,).

    Parameters
    ----------
    scene : Scene
    residual : ndarray, shape (N,)
        In standard deviations of the assumed noise.
    """
    out, sd = [], level_sd_of_log(scene)
    for part, n in zip(np.split(residual, np.cumsum(scene.lengths)[:-1]), scene.lengths):
        power, s = float(part @ part), 1.0
        for _ in range(MAX_LEVEL_STEPS):  # Newton's in ln s of n ln s + power / 2 s^2 + (ln s)^2 / 2 sd^2
            slope = n - power / s**2 + math.log(s) / sd**2
            step = -slope / (2.0 * power / s**2 + 1.0 / sd**2)
            s *= math.exp(min(max(step, -1.0), 1.0))
            if abs(step) < LEVEL_TOLERANCE:
                break
        out.append(s)
    return np.array(out)


def log_posterior(scene: Scene, residual: Array, unknowns: Array) -> float:
    """Log-likelihood with the levels at their best, plus the log prior of the unknowns [nats].

    Parameters
    ----------
    scene : Scene
    residual : ndarray, shape (N,)
        In standard deviations of the assumed noise.
    unknowns : ndarray, shape (q,)
        [SI].
    """
    levels, sd = levels_of(scene, residual), level_sd_of_log(scene)
    value = 0.0
    parts = np.split(residual, np.cumsum(scene.lengths)[:-1])
    for part, n, s in zip(parts, scene.lengths, levels.tolist()):
        value -= n * float(np.log(s)) + 0.5 * float(part @ part) / s**2 + 0.5 * (np.log(s) / sd) ** 2
    return value - 0.5 * float(np.sum(pulls(scene, unknowns) ** 2))


def pulls(scene: Scene, unknowns: Array) -> Array:
    """How far unknowns are from what is assumed about them, in standard deviations, shape (q,).

    Parameters
    ----------
    scene : Scene
    unknowns : ndarray, shape (q,)
        [SI].
    """
    values = np.array([u.value for u in scene.unknowns])
    return np.asarray((unknowns - values) * weights(scene))


def weights(scene: Scene) -> Array:
    """Inverse standard deviations of the unknowns before the log, shape (q,) [1/SI]; zero where nothing is assumed."""
    return np.array([0.0 if not np.isfinite(u.sd) else 1.0 / u.sd for u in scene.unknowns])


def over_levels(scene: Scene, x: Array, levels: Array) -> Array:
    """Residuals, shape (N, ...), over the levels of their channels.

    Parameters
    ----------
    scene : Scene
    x : ndarray, shape (N, ...)
        Residuals or their derivatives.
    levels : ndarray, shape (channels,)
        Noise levels over the assumed ones.
    """
    each = np.repeat(levels, scene.lengths)
    return np.asarray(x / each.reshape(-1, *(1,) * (x.ndim - 1)))
