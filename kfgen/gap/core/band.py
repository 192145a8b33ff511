"""Whether what is taken for a resonance is noise of a band with edges: the likelihoods of both spectra are compared.

A machine hall, a floor or a filter passes what is between two frequencies. Spectra are those of ordinates of the cosine
transform, which are independent (Whittle's likelihood [1]_).

References
----------
.. [1] P. Whittle, Estimation and information in stationary time series, Arkiv för Matematik 2, 1953.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from kfgen.effects.process.periodic import Resonance
from kfgen.effects.process.population_monte_carlo import log_integral_about

Array = NDArray[np.float64]

BAND = "it is noise of a band with edges (a machine hall)"
TRIAL_WIDTHS = (1.0, 2.0, 4.0, 8.0)
"""Of bands, in dampings of the resonance, and as many places about its frequency: where the integral starts."""
TRIAL_PLACES = 33
SPREAD_OF_A_BAND = np.array([0.3, 0.3, 0.15])
"""Standard deviations of the first points: of the middle in dampings, of the logarithms of width and size."""
SPREAD_OF_A_RESONANCE = np.array([0.5, 0.4, 0.15])
"""The same of a resonance: of its frequency in dampings, of the logarithms of damping and size."""
IMPOSSIBLE_NATS = -1e9
"""Log-likelihood of a frequency that is none."""


def band_log_odds(z: Array, omega: float, damping: float, rms: float) -> float:
    """How likely noise of a band is over a resonance, both as likely before.

    Parameters
    ----------
    z : ndarray, shape (n,)
        The record without the resonance in its model, white and of unit variance but for that.
    omega : float
        Frequency of the resonance [rad per sample].
    damping : float
        Its damping ratio.
    rms : float
        Its standard deviation, over that of the white noise beside it.

    Returns
    -------
    float
        The logarithm of the odds [nats].
    """
    from scipy.fft import dct

    power = np.square(dct(z, norm="ortho")[1:])
    w: Array = np.asarray(np.arange(1, z.size) * (np.pi / z.size), dtype=np.float64)
    below = np.concatenate([[0.0], np.cumsum(power)])
    fade = damping * omega

    def log_of_one(offset: float, log_fade: float, log_rms: float) -> float:
        at = omega + fade * offset
        if at <= 0.0:
            return IMPOSSIBLE_NATS
        own = Resonance(at / (2.0 * np.pi), np.exp(log_fade) / at, np.exp(log_rms))
        S = own.sampled_density(w, 1.0)
        return float(-0.5 * np.sum(np.log1p(S) - power * S / (1.0 + S)))

    def resonance(x: Array) -> Array:
        return np.array([log_of_one(*row) for row in x.tolist()])

    def band(x: Array) -> Array:
        half = 0.5 * np.exp(x[:, 1])
        lo, hi = (
            np.clip(omega + fade * x[:, 0] + edge, 0.0, np.pi) * z.size / np.pi for edge in (-half, half)
        )
        count = np.maximum(hi - lo, 1.0)
        seen = np.interp(hi, np.arange(z.size), below) - np.interp(lo, np.arange(z.size), below)
        S = np.exp(2.0 * x[:, 2]) * z.size / count
        return np.asarray(-0.5 * (count * np.log1p(S) - seen * S / (1.0 + S)))

    own = np.array([0.0, np.log(fade), np.log(rms)])
    of_a_band = log_integral_about(band, _best_band(band, own), SPREAD_OF_A_BAND)
    return of_a_band - log_integral_about(resonance, own, SPREAD_OF_A_RESONANCE)


def _best_band(band: Callable[[Array], Array], own: Array) -> Array:
    """The likeliest of several bands about a resonance."""
    trials = np.array(
        [
            own + np.array([width * place, np.log(width), 0.0])
            for width in TRIAL_WIDTHS
            for place in np.linspace(-1.0, 1.0, TRIAL_PLACES)
        ]
    )
    return np.asarray(trials[int(np.argmax(band(trials)))])
