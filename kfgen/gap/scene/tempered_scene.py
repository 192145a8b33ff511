"""A scene whose noise has the spectrum that the best explanation leaves: evidence while something else is still there.

Where tests say that the updated model leaves something, its likelihood is not the truth: what nobody named is louder than
noise in some band, and an effect that moves the residuals in this band is credited with it. So what is left enters the noise,
band by band, and all effects are looked for again; evidence, intervals and proofs are then as wide as the misfit makes them.
A band that is quieter than assumed stays as it is: misfit takes certainty away and gives none.

References
----------
.. [1] R. H. Shumway and D. S. Stoffer, Time Series Analysis and Its Applications, 4th ed., 2017, section 4.3 (smoothed
   periodograms).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from kfgen.gap.scene.newton import SceneFit
from kfgen.gap.scene.posterior import level_sd_of_log
from kfgen.gap.scene.scene import (
    Integrating,
    Linearised,
    Placed,
    Reaching,
    Scene,
    ScenePoint,
    Unknown,
    has_several_maxima,
)
from kfgen.gap.scene.screen import basis

Array = NDArray[np.float64]

MISFIT_BANDS_PER_DECADE = 5
"""Of the spectrum that is left."""
MIN_BAND_ORDINATES = 6
"""Of a band whose misfit is estimated; the lowest bands are wide enough to have them."""
PRIOR_FREEDOM = 2.0
"""Degrees of freedom with which a band's noise is as assumed, before the log."""


@dataclass(frozen=True)
class TemperedScene:
    """A scene over the spectrum of what its best explanation leaves.

    Parameters
    ----------
    scene : Scene
    misfit : ndarray, shape (N,)
        Standard deviation of each ordinate over the assumed one.
    """

    scene: Scene
    misfit: Array

    channels = property(lambda self: self.scene.channels)
    lengths = property(lambda self: self.scene.lengths)
    dt = property(lambda self: self.scene.dt)
    span = property(lambda self: self.scene.span)

    @property
    def unknowns(self) -> tuple[Unknown, ...]:
        """As of the scene."""
        return self.scene.unknowns

    @property
    def noise_level_sd_of_log(self) -> float:
        """As of the scene."""
        return level_sd_of_log(self.scene)

    @property
    def has_several_maxima(self) -> bool:
        """As of the scene."""
        return has_several_maxima(self.scene)

    def residuals(self, points: Sequence[ScenePoint]) -> Array:
        """Of the scene, over the misfit."""
        return np.asarray(self.scene.residuals(points) / self.misfit[:, None])

    def candidates(self, placed: Sequence[Placed]) -> list[list[Placed]]:
        """As of the scene."""
        return self.scene.candidates(placed)

    def spread(self, point: ScenePoint) -> float:
        """As of the scene; of one that integrates nothing, none."""
        return self.scene.spread(point) if isinstance(self.scene, Integrating) else 0.0

    def unreached(self, placed: Placed) -> str:
        """As of the scene; empty where it does not know."""
        return self.scene.unreached(placed) if isinstance(self.scene, Reaching) else ""

    def untempered(self, fit: SceneFit) -> SceneFit:
        """A fit as the scene itself sees it: residuals and derivatives in assumed standard deviations.

        Parameters
        ----------
        fit : SceneFit
            Of this scene.
        """
        return replace(fit, residual=fit.residual * self.misfit, jacobian=fit.jacobian * self.misfit[:, None])


@dataclass(frozen=True)
class TemperedLinearScene(TemperedScene):
    """The same of a scene that is linear about a point."""

    def about(self, point: ScenePoint) -> TemperedScene:
        """The same misfit about another point."""
        scene = self.scene
        return replace(self, scene=scene.about(point)) if isinstance(scene, Linearised) else self


def tempered(scene: Scene, fit: SceneFit) -> TemperedScene:
    """A scene over the spectrum of what a fit leaves.

    Parameters
    ----------
    scene : Scene
        Whose residuals are cosine transforms, channel by channel.
    fit : SceneFit
        Of that scene, with everything that has evidence.
    """
    cuts = np.cumsum(scene.lengths)[:-1]
    freedom = 1.0 - np.sum(basis(fit.jacobian) ** 2, axis=1)
    parts = zip(np.split(fit.residual, cuts), np.split(np.clip(freedom, 0.0, 1.0), cuts))
    misfit = np.concatenate([_misfit(X, m) for X, m in parts])
    made = TemperedLinearScene if isinstance(scene, Linearised) else TemperedScene
    return made(scene, misfit)


def _misfit(X: Array, freedom: Array) -> Array:
    """Standard deviation of each ordinate of a channel over the assumed one, at least one, shape (n,)."""
    starts = _band_starts(X.size)
    power, count = (np.add.reduceat(x, starts) for x in (X**2, freedom))
    ratio = (PRIOR_FREEDOM + power) / (PRIOR_FREEDOM + count)
    widths = np.diff([*starts.tolist(), X.size])
    return np.asarray(np.repeat(np.sqrt(np.maximum(ratio, 1.0)), widths))


def _band_starts(n: int) -> NDArray[np.int64]:
    """First ordinates of bands, evenly in the logarithm of frequency, none of them narrow."""
    count = max(2, int(np.log10(max(n, 2)) * MISFIT_BANDS_PER_DECADE))
    edges = np.unique(np.geomspace(MIN_BAND_ORDINATES, max(n, MIN_BAND_ORDINATES + 1), count).round())
    starts = [0]
    for edge in edges.astype(np.int64).tolist():
        if edge - starts[-1] >= MIN_BAND_ORDINATES and n - edge >= MIN_BAND_ORDINATES:
            starts.append(edge)
    return np.array(starts, dtype=np.int64)
