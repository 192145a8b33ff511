"""How much wider intervals are where the spectrum does not fit: the sandwich.

A likelihood takes its model for true. Where the periodogram of what is left scatters more about the model's density than a
chi-square does, the estimate scatters more than the information says [1]_: by ``J^-1 K J^-1`` in place of ``J^-1``, K
being the scatter of the slope of the likelihood from band to band.

References
----------
.. [1] H. White, Maximum likelihood estimation of misspecified models, Econometrica 50(1), 1982.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from kfgen.effects.process.stochastic import WhiteNoise
from kfgen.identify.evidence.joint import JointRecord
from kfgen.identify.evidence.record import Evidence, Record
from kfgen.identify.evidence.whittle import Ordinates, residual_ratio
from kfgen.identify.fit.fit import Fit, Key, inverse

Array = NDArray[np.float64]

RATIO_OF_BANDS = 1.15
"""Of the frequencies of neighbouring bands."""
MAX_CHANCE_OF_FIT = 0.01
"""Chance of such a scatter below which it counts."""


def widening(record: Evidence, fit: Fit) -> Mapping[Key, float]:
    """Factors on the logarithmic widths of intervals, at least one, of the parameters that were fitted in their logarithm.

    Parameters
    ----------
    record : Evidence
        What was fitted; without a spectrum nothing is widened.
    fit : Fit
    """
    found = {(i, "N"): f for i in _white(fit) if (f := _of_outliers(record)) > 1.0}
    data = record.likelihood(fit.effects) if fit.free and isinstance(record, (Record, JointRecord)) else None
    return _by_misfit(data, fit, found) if isinstance(data, Ordinates) else found


def _white(fit: Fit) -> list[int]:
    """Where the white noise is among the effects."""
    return [i for i, e in enumerate(fit.effects) if isinstance(e, WhiteNoise)]


def _of_outliers(record: Evidence) -> float:
    """By how much outliers make the noise less well known."""
    parts = record.records if isinstance(record, JointRecord) else (record,)
    return max((p.left_out.widening for p in parts if isinstance(p, Record)), default=1.0)


def _by_misfit(data: Ordinates, fit: Fit, known: Mapping[Key, float]) -> dict[Key, float]:
    """The factors with those of parameters whose bands scatter more than chance."""
    from scipy.stats import chi2

    slopes = data.relative_slopes(fit.effects, fit.free)
    C = inverse(0.5 * (slopes * data.count) @ slopes.T)
    weight = C @ slopes  # of each bin in each parameter
    left = residual_ratio(data, fit.effects, fit.likelihood.coefficients) - 1.0
    band = np.floor(np.log(data.omega / data.omega.min()) / np.log(RATIO_OF_BANDS)).astype(int)
    found = dict(known)
    for k, key in enumerate(fit.free):
        moved = np.bincount(band, 0.5 * weight[k] * left * data.count)
        expected = np.bincount(band, 0.5 * weight[k] ** 2 * data.count)
        total = float(expected.sum())
        bands = total**2 / max(float(np.sum(expected**2)), 1e-300)
        if bands < 2.0:
            continue
        scatter = float(np.sum(moved**2)) / total / (1.0 - 1.0 / bands)
        if chi2.sf(scatter * (bands - 1.0), bands - 1.0) < MAX_CHANCE_OF_FIT:
            found[key] = max(float(np.sqrt(scatter)), found.get(key, 1.0))
    return found
