"""How much wider an estimate scatters over the parts of a log than its likelihood says.

Of scores ``s_b`` of B blocks of time at the best point, with information H, the variance is

    C = H^-1 (sum s_b s_b') H^-1 B / (B - 1)

whatever the noise is, as long as blocks are independent ([1]_, [2]_). Where the noise is as the likelihood has it, C is ``H^-1``.

References
----------
.. [1] P. J. Huber, The behavior of maximum likelihood estimates under nonstandard conditions, 5th Berkeley Symp., 1967.
.. [2] F. Pauli, W. Racugno, L. Ventura, Bayesian composite marginal likelihoods, Statistica Sinica 21(1), 2011.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kfgen.gap.core.newton import SceneFit, over_levels
from kfgen.gap.core.scene import Scene
from kfgen.gap.core.scene_proof import series

Array = NDArray[np.float64]

BLOCKS = 16
"""Of equal time, over which scores are summed."""


def unevenness(scene: Scene, fit: SceneFit) -> Array:
    """Variance of each coordinate by the scatter of blocks over that by the likelihood, at least one, shape (p,).

    Parameters
    ----------
    scene : Scene
    fit : SceneFit
        Of that scene.
    """
    if min(scene.lengths) < BLOCKS or not fit.jacobian.shape[1]:
        return np.ones(fit.jacobian.shape[1])
    residual = over_levels(scene, fit.residual, fit.levels)
    each = series(scene, fit.jacobian) * series(scene, residual)[:, None]
    block = np.concatenate([np.arange(n) * BLOCKS // n for n in scene.lengths])
    scores = np.zeros((BLOCKS, each.shape[1]))
    np.add.at(scores, block, each)
    scores -= scores.mean(axis=0)
    C = fit.covariance
    scattered = np.sum((scores @ C) ** 2, axis=0) * BLOCKS / (BLOCKS - 1)
    return np.asarray(np.maximum(scattered / np.maximum(np.diag(C), 1e-300), 1.0))
