"""Weighted least squares of a calibration, with intervals from what the fit leaves.

The noise of a sensor is seldom all that a fit leaves: a field is not the same everywhere, a pose is not quite at rest. So
the covariance is scaled by the residual where that is larger than the noise, and of samples in a row it is that of blocks
of them, whose errors are taken to be independent [1]_; the quantile is Student's.

References
----------
.. [1] K.-Y. Liang and S. L. Zeger, Longitudinal data analysis using generalized linear models, Biometrika 73(1), 1986.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

BLOCKS = 40
"""Blocks of samples in a row."""
ROBUST_DEVIATIONS = 3.0
"""Robust standard deviations beyond which a residual counts less."""
READINGS_OF_NOISE = 4
"""Readings as many of which the noise at rest is worth, where few are left to tell how large residuals are."""
STEP = 1e-6
"""Relative step of a derivative."""


@dataclass(frozen=True)
class Fitted:
    """Numbers, the ends of their 95 % intervals, and the residuals in standard deviations of the noise.

    Parameters
    ----------
    values, half_widths : ndarray, shape (k,)
    residual : ndarray, shape (n,)
    misfit : float
        Root mean square of the residuals over what the noise gives.
    condition : float
        Of the derivatives, each of length one: large where numbers cannot be distinguished.
    """

    values: Array
    half_widths: Array
    residual: Array
    misfit: float
    condition: float


def fitted(
    residual: Callable[[Array], Array],
    start: Array,
    scale: Array,
    *,
    in_blocks: bool,
) -> Fitted:
    """The numbers at which residuals are smallest.

    Parameters
    ----------
    residual : callable
        Residuals of numbers, in standard deviations of the noise, shape (n,).
    start, scale : ndarray, shape (k,)
        Where the search begins, and what is a usual size of each number.
    in_blocks : bool
        Whether residuals are of samples in a row, whose errors are alike; they are then also weighted down where
        they are far out.
    """
    from scipy.optimize import least_squares
    from scipy.stats import t as student

    found = least_squares(residual, start, x_scale=scale, method="trf", diff_step=STEP)
    r = residual(found.x)
    if in_blocks:
        spread = 1.4826 * float(np.median(np.abs(r - np.median(r))))
        far = ROBUST_DEVIATIONS * max(spread, 1.0)
        found = least_squares(residual, found.x, x_scale=scale, loss="soft_l1", f_scale=far, diff_step=STEP)
        r = residual(found.x)
    J = np.asarray(found.jac)
    length = np.maximum(np.linalg.norm(J, axis=0), 1e-300)
    information = np.linalg.pinv(J.T @ J / np.outer(length, length), hermitian=True) / np.outer(
        length, length
    )
    free = BLOCKS - start.size if in_blocks else r.size - start.size + READINGS_OF_NOISE
    misfit = float(np.sqrt((r @ r + READINGS_OF_NOISE) / (r.size - start.size + READINGS_OF_NOISE)))
    C = information * max(misfit, 1.0) ** 2
    if in_blocks:
        weight = 1.0 / np.sqrt(1.0 + (r / far) ** 2)
        moved = [j.T @ (w * e) for j, w, e in zip(*(np.array_split(a, BLOCKS) for a in (J, weight, r)))]
        K = np.array(moved).T @ np.array(moved) * BLOCKS / free
        # Few blocks may look better than they are by chance: not better than the residual says.
        C = np.maximum(np.diag(information @ K @ information), np.diag(C))
    else:
        C = np.diag(C)
    half = float(student.ppf(0.975, free)) * np.sqrt(np.maximum(C, 0.0))
    s = np.linalg.svd(J / length, compute_uv=False)
    return Fitted(found.x, half, r, misfit, float(s[0] / max(s[-1], 1e-300)))
