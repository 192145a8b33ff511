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

from kfgen.effects.process.population_monte_carlo import integral

Array = NDArray[np.float64]

BAND = "it is noise of a band with edges (a machine hall)"
START_COUNT = 64
"""First points of an integral."""
SPREAD_OF_A_RESONANCE = (0.5, 0.4, 0.15)
"""Standard deviations of the first points: of the frequency in dampings, of the logarithms of damping and size."""
TRIAL_WIDTHS = (1.0, 2.0, 4.0, 8.0)
"""Of bands, in dampings of the resonance, and as many places about its frequency: where the integral starts."""
TRIAL_PLACES = 33
SPREAD_OF_A_BAND = (0.3, 0.3, 0.15)
"""Standard deviations of the first points: of the middle in dampings, of the logarithms of width and size."""


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
    w = np.arange(1, z.size) * (np.pi / z.size)
    below = np.concatenate([[0.0], np.cumsum(power)])
    fade = damping * omega

    def resonance(x: Array) -> Array:
        at = omega + fade * x[:, :1]
        width = 2.0 * np.exp(x[:, 1:2]) * w
        S = 1.0 / ((at**2 - w**2) ** 2 + width**2)
        S *= np.exp(2.0 * x[:, 2:]) / S.mean(axis=1)[:, None]
        return np.asarray(-0.5 * np.sum(np.log1p(S) - power * S / (1.0 + S), axis=1))

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
    return _log_integral(band, _best_band(band, own), SPREAD_OF_A_BAND) - _log_integral(
        resonance, own, SPREAD_OF_A_RESONANCE
    )


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


def _log_integral(law: Callable[[Array], Array], at: Array, spread: tuple[float, ...]) -> float:
    starts = at + spread * np.random.default_rng(0).standard_normal((START_COUNT, at.size))
    found = integral(law, starts)
    assert found is not None
    return found.log
