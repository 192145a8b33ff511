"""How much wider an estimate scatters over the parts of a log than its likelihood says: the block jackknife.

Parts are stretches of time. For intervals they are also instants at which the fitted numbers act alike (by their
derivatives), and the larger scatter holds: where a field differs from place to place, a misfit comes again with every
attitude, and all stretches of time show the same ([4]_).

Without block b of B, of score ``s_b`` and information ``A_b`` at the best point of information H, the estimate moves by

    d_b = -(H - A_b)^-1 s_b,     and its variance is     C = (B - 1) / B sum (d_b - mean d) (d_b - mean d)'

whatever the noise is, as long as blocks are independent ([1]_, [2]_). Where the noise is as the likelihood has it, C is
about ``H^-1``; where it is not, evidence is in proportion to their ratio ([3]_).

References
----------
.. [1] M. H. Quenouille, Notes on bias in estimation, Biometrika 43, 1956.
.. [2] H. R. Kuensch, The jackknife and the bootstrap for general stationary observations, Annals of Statistics 17(3), 1989.
.. [3] F. Pauli, W. Racugno, L. Ventura, Bayesian composite marginal likelihoods, Statistica Sinica 21(1), 2011.
.. [4] A. C. Cameron, J. B. Gelbach, D. L. Miller, Robust inference with multiway clustering, Journal of Business & Economic
   Statistics 29(2), 2011.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from kfgen.gap.scene.newton import SceneFit
from kfgen.gap.scene.posterior import over_levels
from kfgen.gap.scene.proof import series
from kfgen.gap.scene.scene import Scene

Array = NDArray[np.float64]
Blocks = NDArray[np.intp]
Parted = Callable[[Sequence[int], Array], Blocks]

BLOCKS = 16
"""Parts, each of which is left out once."""
MAX_ROWS_OF_DIRECTION = 2000
"""Instants from which the direction in which they differ most is computed, about."""
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
    J = series(scene, fit.jacobian)
    return _scatter(scene, fit, J, fit.information, fit.covariance, (_of_equal_time, _alike))


def unevenness_of_effect(scene: Scene, fit: SceneFit, without: SceneFit, index: int) -> float:
    """The same for an effect as a whole: for the factor between 0 (the fit without it) and 1 (the fit with it).

    Over stretches of time only: an error of a sensor that is small beside a field that differs from place to place would have
    a name in one part of a recording and none in another.

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
    return float(_scatter(scene, fit, series(scene, J), H, C, (_of_equal_time,))[0])


def _scatter(scene: Scene, fit: SceneFit, J: Array, H: Array, C: Array, parted: Sequence[Parted]) -> Array:
    """Of columns of derivatives in time, shape (N, p), with an information H and a covariance C: the largest of all ways."""
    wider = np.ones(J.shape[1])
    if min(scene.lengths) < BLOCKS or not J.shape[1]:
        return wider
    residual = series(scene, over_levels(scene, fit.residual, fit.levels))
    for block in (parts(scene.lengths, J) for parts in parted):
        moved = np.array([_moved(H, J[block == b], residual[block == b]) for b in np.unique(block)])
        scattered = (len(moved) - 1) * moved.var(axis=0)
        wider = np.maximum(wider, scattered / np.maximum(np.diag(C), 1e-300))
    return wider


def stretches(lengths: Sequence[int]) -> Blocks:
    """Block of each reading, shape (N,): stretches of the log of equal length.

    Parameters
    ----------
    lengths : sequence of int
        Readings of each channel.
    """
    return np.concatenate([np.arange(n) * BLOCKS // n for n in lengths])


def _of_equal_time(lengths: Sequence[int], J: Array) -> Blocks:
    return stretches(lengths)


def _alike(lengths: Sequence[int], J: Array) -> Blocks:
    """Block of each reading, shape (N,): instants at which the fitted numbers act alike [4]_.

    All instants are halved where they differ most, at their mean, and each half again: readings that are alike are in few
    blocks, however often they come. Where channels have their own instants, each is halved for itself.
    """
    scaled = J / np.sqrt(np.maximum(np.sum(J**2, axis=0), 1e-300))
    parts = np.split(scaled, np.cumsum(lengths)[:-1])
    if len(set(lengths)) == 1:
        return np.tile(_halved(np.hstack(parts), BLOCKS), len(parts))
    return np.concatenate([_halved(part, BLOCKS) for part in parts])


def _halved(rows: Array, count: int) -> Blocks:
    """Block of each row, shape (m,), of a power of two of them."""
    block = np.zeros(rows.shape[0], dtype=np.intp)
    if count == 1 or rows.shape[0] < 2:
        return block
    off = rows - rows.mean(axis=0)
    some = off[:: max(rows.shape[0] // MAX_ROWS_OF_DIRECTION, 1)]
    along = off @ np.linalg.eigh(some.T @ some)[1][:, -1]
    upper = along >= 0.0
    for half, first in ((~upper, 0), (upper, count // 2)):
        block[half] = first + _halved(rows[half], count // 2)
    return block


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
