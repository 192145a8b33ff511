"""Noise of another size than assumed, as the residuals of a scene show it: in which channel, how many times as much.

Of ``m`` degrees of freedom the power is ``s^2`` times a chi-square; so is the interval of ``s``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from kfgen.effects import Effect
from kfgen.gap.core.battery import FALSE_ALARM_RATE, chance_of
from kfgen.gap.core.result import NoiseScale
from kfgen.gap.scene.newton import SceneFit
from kfgen.gap.scene.scene import Scene
from kfgen.gap.scene.screen import basis

Array = NDArray[np.float64]


def noise_scales_in(scene: Scene, fit: SceneFit) -> tuple[NoiseScale, ...]:
    """The channels whose power cannot be that of the noise that is assumed, at the battery's family-wise rate.

    Parameters
    ----------
    scene : Scene
    fit : SceneFit
    """
    from scipy.stats import chi2

    cuts, found = np.cumsum(scene.lengths)[:-1], []
    left = 1.0 - np.sum(basis(fit.jacobian) ** 2, axis=1)
    for channel, z, free in zip(scene.channels, np.split(fit.residual, cuts), np.split(left, cuts)):
        power, m = float(z @ z), max(float(free.sum()), 1.0)
        if len(scene.channels) * chance_of(power, m) < FALSE_ALARM_RATE:
            lo, hi = (float(np.sqrt(power / chi2.isf(p, m))) for p in (0.025, 0.975))
            found.append(NoiseScale(channel, float(np.sqrt(power / m)), (lo, hi)))
    return tuple(found)


def levels_in(scene: Scene, scales: Sequence[NoiseScale]) -> Array:
    """The size of every channel's noise over what is assumed, shape (channels,).

    Parameters
    ----------
    scene : Scene
    scales : sequence of NoiseScale
    """
    known = {c.channel: c.times for c in scales}
    return np.array([known.get(c, 1.0) for c in scene.channels])


def scaled(effect: Effect, times: float) -> Effect:
    """A random effect of another size; a deterministic one as it is.

    Parameters
    ----------
    effect : Effect
    times : float
        By which its sizes are multiplied.
    """
    if effect.coefficients():
        return effect
    return replace(effect, **{n: times * float(getattr(effect, n)) for n in effect.sizes()})
