"""How much wider intervals are where the spectrum does not fit: the sandwich.

A likelihood takes its model for true. Where the periodogram of what is left scatters more about the model's density than a
chi-square does, the estimate scatters more than the information says [1]_: by ``J^-1 K J^-1`` in place of ``J^-1``, K
being the scatter of the slope of the likelihood from band to band.

A level of the noise that changes along the record is such a misfit too: stretches of it differ by more than chance.
Where they differ slowly, as a random walk does, the level drifts, and another record of the sensor
differs from this one by what the drift comes to.

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
from kfgen.identify.screening.shocks import away_from_neighbours

Array = NDArray[np.float64]

RATIO_OF_BANDS = 1.15
"""Of the frequencies of neighbouring bands."""
MAX_CHANCE_OF_FIT = 0.01
"""Chance of such a scatter below which it counts."""
MAX_CHANCE_OF_STEADY_LEVEL = 0.02
"""The same of a level that drifts, which shows in one record less than it matters between two."""
STRETCHES = 16
"""Of a record, whose levels are compared."""
SLOW_COEFFICIENTS = 3
"""Cosine coefficients of the levels of stretches in which a drift shows."""
MIN_BATCHES = 8
"""Of a stretch, from which its level is judged."""
BATCH_SAMPLES = 64
"""Samples over which the scatter of the power by chance is taken."""


def widening(record: Evidence, fit: Fit) -> Mapping[Key, float]:
    """Factors on the logarithmic widths of intervals, at least one, of the parameters that were fitted in their logarithm.

    Parameters
    ----------
    record : Evidence
        What was fitted; without a spectrum nothing is widened.
    fit : Fit
    """
    records = record.records if isinstance(record, JointRecord) else (record,)
    parts = [p for p in records if isinstance(p, Record)]
    data = record.likelihood(fit.effects) if fit.free and parts else None
    if not isinstance(data, Ordinates):
        return {}
    found = _by_misfit(data, fit)
    outliers = max(p.left_out.widening for p in parts)
    drift = float(sum(p.n**2 * level_variance(p.y) for p in parts)) / sum(p.n for p in parts) ** 2
    for key in ((i, "N") for i, e in enumerate(fit.effects) if isinstance(e, WhiteNoise)):
        by_drift = 1.0 + 2.0 * data.n * drift  # white noise of n ordinates is known to a variance of 1 / 2n
        found[key] = float(np.sqrt(outliers**2 * found.get(key, 1.0) ** 2 + by_drift - 1.0))
    return {key: factor for key, factor in found.items() if factor > 1.0}


def level_variance(y: Array) -> float:
    """Variance of the logarithm of the noise's size between records of this length, beyond chance.

    Parameters
    ----------
    y : ndarray, shape (n,)
        Samples [SI].

    Returns
    -------
    float
        Zero where the stretches of the record have one level.
    """
    from scipy.fft import dct
    from scipy.stats import chi2

    power = away_from_neighbours(y)[0][1:-1] ** 2
    size = power.size // (STRETCHES * BATCH_SAMPLES) * BATCH_SAMPLES
    if size < MIN_BATCHES * BATCH_SAMPLES:
        return 0.0
    batches = power[: size * STRETCHES].reshape(STRETCHES, -1, BATCH_SAMPLES).mean(axis=2)
    mean = batches.mean(axis=1)
    if not (mean > 0.0).all():
        return 0.0
    chance = float(np.mean(batches.var(axis=1, ddof=1) / mean**2) / batches.shape[1])
    coefficient = dct(np.log(mean), type=2, norm="ortho")[1:]
    slow, rest = coefficient[:SLOW_COEFFICIENTS], coefficient[SLOW_COEFFICIENTS:]
    drift = steady = 0.0
    if chi2.sf(float(slow @ slow) / chance, slow.size) < MAX_CHANCE_OF_STEADY_LEVEL:
        # A random walk of variance q a stretch has coefficients of variance q (M / pi k)^2.
        of_walk = (STRETCHES / (np.pi * np.arange(1, slow.size + 1))) ** 2
        drift = max(float(slow @ slow) - slow.size * chance, 0.0) / float(of_walk.sum())
    if chi2.sf(float(rest @ rest) / chance, rest.size) < MAX_CHANCE_OF_FIT:
        steady = max(float(np.mean(rest**2)) - chance, 0.0)
    return 0.25 * (steady / STRETCHES + drift * STRETCHES / 3.0)


def _by_misfit(data: Ordinates, fit: Fit) -> dict[Key, float]:
    """The factors of parameters whose bands scatter more than chance."""
    from scipy.stats import chi2

    slopes = data.relative_slopes(fit.effects, fit.free)
    C = inverse(0.5 * (slopes * data.count) @ slopes.T)
    weight = C @ slopes  # of each bin in each parameter
    left = residual_ratio(data, fit.effects, fit.likelihood.coefficients) - 1.0
    band = np.floor(np.log(data.omega / data.omega.min()) / np.log(RATIO_OF_BANDS)).astype(int)
    found = {}
    for k, key in enumerate(fit.free):
        moved = np.bincount(band, 0.5 * weight[k] * left * data.count)
        expected = np.bincount(band, 0.5 * weight[k] ** 2 * data.count)
        total = float(expected.sum())
        bands = total**2 / max(float(np.sum(expected**2)), 1e-300)
        if bands < 2.0:
            continue
        scatter = float(np.sum(moved**2)) / total / (1.0 - 1.0 / bands)
        if chi2.sf(scatter * (bands - 1.0), bands - 1.0) < MAX_CHANCE_OF_FIT:
            found[key] = max(float(np.sqrt(scatter)), 1.0)
    return found
