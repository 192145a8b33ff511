"""How much wider an estimate scatters over the parts of a log than its likelihood says: the block jackknife.

Without block b of B, of score ``s_b`` and information ``A_b`` at the best point of information H, the estimate moves by

    d_b = -(H - A_b)^-1 s_b,     and its variance is     C = (B - 1) / B sum (d_b - mean d) (d_b - mean d)'

whatever the noise is, as long as blocks are independent ([1]_, [2]_). Where the noise is as the likelihood has it, C is
about ``H^-1``; where it is not, evidence is in proportion to their ratio ([3]_).

References
----------
.. [1] M. H. Quenouille, Notes on bias in estimation, Biometrika 43, 1956.
.. [2] H. R. Kuensch, The jackknife and the bootstrap for general stationary observations, Annals of Statistics 17(3), 1989.
.. [3] F. Pauli, W. Racugno, L. Ventura, Bayesian composite marginal likelihoods, Statistica Sinica 21(1), 2011.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kfgen.gap.scene.newton import SceneFit, over_levels
from kfgen.gap.scene.proof import series
from kfgen.gap.scene.scene import Scene

Array = NDArray[np.float64]

BLOCKS = 16
"""Of equal time, each of which is left out once."""
MIN_LEFT_SHARE = 1e-3
"""Share of the information on a number that is taken to be left where a block has all of it."""


def unevenness(scene: Scene, fit: SceneFit) -> Array:
    """Variance of each coordinate by the scatter of blocks over that by the likelihood, at least one, shape (p,).

    Parameters
    ----------
    scene : Scene
    fit : SceneFit
        Of that scene.
    """
    return _scatter(scene, fit, series(scene, fit.jacobian), fit.information, fit.covariance)


def unevenness_of_effect(scene: Scene, fit: SceneFit, without: SceneFit, index: int) -> float:
    """The same for an effect as a whole: for the factor between 0 (the fit without it) and 1 (the fit with it).

    Two coefficients of one effect that nearly exchange (a square and a cube of an input) are each known badly, while
    the effect itself is certain.

    Parameters
    ----------
    scene : Scene
    fit, without : SceneFit
        Of that scene, with the effect and without it.
    index : int
        Of the effect in the fit.
    """
    rest = [k for k in range(fit.jacobian.shape[1]) if k >= len(fit.keys) or fit.keys[k][0] != index]
    chord = over_levels(scene, fit.residual - without.residual, fit.levels)
    J = np.column_stack([chord, fit.jacobian[:, rest]])
    H = J.T @ J
    H[1:, 1:] = fit.information[np.ix_(rest, rest)]
    scale = np.sqrt(np.maximum(np.diag(H), 1e-300))
    C = np.linalg.pinv(H / np.outer(scale, scale), rcond=1e-12, hermitian=True) / np.outer(scale, scale)
    return float(_scatter(scene, fit, series(scene, J), H, C)[0])


def _scatter(scene: Scene, fit: SceneFit, J: Array, H: Array, C: Array) -> Array:
    """Of columns of derivatives in time, shape (N, p), with an information H and a covariance C."""
    if min(scene.lengths) < BLOCKS or not J.shape[1]:
        return np.ones(J.shape[1])
    residual = series(scene, over_levels(scene, fit.residual, fit.levels))
    block = np.concatenate([np.arange(n) * BLOCKS // n for n in scene.lengths])
    moved = np.array([_moved(H, J[block == b], residual[block == b]) for b in range(BLOCKS)])
    scattered = (BLOCKS - 1) * moved.var(axis=0)
    return np.asarray(np.maximum(scattered / np.maximum(np.diag(C), 1e-300), 1.0))


def scattered_deviations(scene: Scene, fit: SceneFit) -> Array:
    """Standard deviations of what was fitted, by the scatter of blocks where that is larger, shape (p,).

    Parameters
    ----------
    scene : Scene
    fit : SceneFit
        Of that scene.
    """
    return np.asarray(np.sqrt(np.maximum(np.diag(fit.covariance), 0.0) * unevenness(scene, fit)))


def _moved(H: Array, J: Array, residual: Array) -> Array:
    """By how much an estimate moves without some readings, shape (p,)."""
    scale = np.sqrt(np.maximum(np.diag(H), 1e-300))
    left = (H - J.T @ J) / np.outer(scale, scale) + MIN_LEFT_SHARE * np.eye(scale.size)
    return np.asarray(np.linalg.lstsq(left, (J.T @ residual) / scale, rcond=1e-9)[0] / scale)
