"""States that do not start where the model file says, by the first samples of a log alone.

A log that begins in the middle of a motion contradicts a start at rest in its first samples, before errors of the model can
add up; a fit of the whole log that trusts the file would look for effects that bring the states there.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from kfgen.effects.plant.terms import ParameterError
from kfgen.gap.plant.shooting import MIN_FIRST_WINDOW_SAMPLES, Shooting
from kfgen.gap.scene.scene import Placed

Array = NDArray[np.float64]

WINDOWS_SAMPLES = tuple(MIN_FIRST_WINDOW_SAMPLES * k for k in (4, 2, 1))
"""The first samples that are looked at: the most that the assumed model follows from a start of their own."""
MIN_CHANCE_OF_WINDOW = 1e-3
"""Chance of what is left in them below which the assumed model does not follow them."""
MIN_DISTANCE_SD = 4.0
"""Standard deviations between the start that the samples show and the one of the file, both of their errors counted."""
UNKNOWN_INFORMATION = 1e-9
"""On a state that no sample shows, in the inverse square of its size."""


def refuted_starts(shooting: Shooting) -> tuple[Placed, ...]:
    """By how much each of those states starts elsewhere.

    Parameters
    ----------
    shooting : Shooting
        Of the assumed model and the log.
    """
    states = shooting.plant.model.states
    if not any(np.isfinite(s.sd) for s in states.values()):
        return ()
    for window in (w for w in WINDOWS_SAMPLES if w <= shooting.t.size):
        first = np.concatenate([shooting.guess(0, window), shooting.trusted])
        x0 = shooting.fit(first, 0, window)
        r, J = shooting.slope(x0, 0, window)
        seen = np.isfinite(r) & (r != 0.0)
        freedom = int(seen.sum()) - len(states)
        if freedom > 0 and chi2.sf(float(np.sum(r[seen] ** 2)), freedom) > MIN_CHANCE_OF_WINDOW:
            return _far(shooting, x0, J)
    return ()


def _far(shooting: Shooting, x0: Array, J: Array) -> tuple[Placed, ...]:
    """Of states whose start in a fit, shape (fitted,), of derivatives of shape (channels, m, fitted), is far from the file's."""
    states = shooting.plant.model.states
    sizes = np.concatenate([shooting.scale, [sd for _, sd in shooting.free.values()]])
    scaled = J.reshape(-1, x0.size) * sizes
    prior = np.where(np.arange(x0.size) < len(states), UNKNOWN_INFORMATION, 1.0)
    variances = np.diag(np.linalg.inv(scaled.T @ scaled + np.diag(prior))) * sizes**2
    return tuple(
        Placed(ParameterError(x - s.initial), name)
        for (name, s), x, v in zip(states.items(), x0.tolist(), variances.tolist())
        if abs(x - s.initial) > MIN_DISTANCE_SD * np.sqrt(s.sd**2 + v)
    )
