"""How far a record rules out a rival of an effect, where neither of them leaves noise alone: Vuong's test.

Under a misfit the likelihoods of two effects differ by more than either explains: each takes up a part of what the catalogue
does not know. Their difference is a sum over stretches of the log, and these scatter; a difference within that scatter
distinguishes the two no better than a coin ([1]_, theorem 5.1).

References
----------
.. [1] Q. H. Vuong, Likelihood ratio tests for model selection and non-nested hypotheses, Econometrica 57(2), 1989.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm

from kfgen.gap.scene.newton import SceneFit
from kfgen.gap.scene.posterior import over_levels
from kfgen.gap.scene.proof import series
from kfgen.gap.scene.scene import Scene
from kfgen.gap.scene.unevenness import BLOCKS, stretches

Array = NDArray[np.float64]


def log_odds(scene: Scene, best: SceneFit, rival: SceneFit, lost: float) -> float:
    """Logarithm of the odds of an effect over its rival, at most as much as the rival loses [nats].

    Parameters
    ----------
    scene : Scene
    best, rival : SceneFit
        Of that scene, with either.
    lost : float
        Evidence that the rival has less.
    """
    if min(scene.lengths) < BLOCKS or not lost > 0.0:
        return lost
    gained = _by_stretch(scene, best) - _by_stretch(scene, rival)
    sd = float(np.sqrt(BLOCKS) * np.std(gained, ddof=1))
    z = lost / sd if sd > 0.0 else np.inf
    return float(min(lost, norm.logcdf(z) - norm.logsf(z)))


def _by_stretch(scene: Scene, fit: SceneFit) -> Array:
    """Log-likelihood of a fit in each stretch, shape (stretches,)."""
    left = series(scene, over_levels(scene, fit.residual, fit.levels))
    each = -0.5 * left**2 - np.log(np.repeat(fit.levels, scene.lengths))
    return np.asarray(np.bincount(stretches(scene.lengths), each, BLOCKS), dtype=np.float64)
