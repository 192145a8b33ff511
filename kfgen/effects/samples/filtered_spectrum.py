"""The spectrum of several effects together: the sum of those that add noise, through those that filter."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d

from kfgen.effects.effect import Effect

Array = NDArray[np.float64]

MIN_PASSED_POWER_SHARE = 1e-3
"""Share of the power that a filter passes below which a frequency is left out: rounding and the ends of the
record show there, and not the noise. A filter whose gain is measured has them in it."""
MAX_LEAK_SHARE = 0.1
"""Of the power that a filter of measured gain passes at a frequency, above which nothing is looked at: the ends of the
record carry so much there."""
LEAK_ENVELOPE_LAGS = 65
"""Over which the largest leak counts: it changes its sign from frequency to frequency."""
MAX_LEAK_LAGS = 2048
"""Lags [samples] over which the output of a filter is correlated at most."""


def sampled_spectrum(effects: Sequence[Effect], omega: Array, dt: float, block: int = 1, n: int = 0) -> Array:
    """Spectral density of the samples of all random effects together, filtered by those that filter.

    Parameters
    ----------
    effects : sequence of Effect
        Those with coefficients (deterministic ones) add nothing.
    omega : ndarray, shape (m,)
        Frequencies [rad per block].
    dt : float
        Sampling period [s].
    block : int
        Samples averaged to one.
    n : int
        Blocks of the record, of which so many cosine ordinates are made; zero for the density itself.

    Returns
    -------
    ndarray, shape (m,)
        [U^2].
    """
    random = [e for e in effects if not e.coefficients()]
    total = sum((e.sampled_density(omega, dt, block) for e in random), np.zeros(omega.size))
    return filtered(effects, omega, dt, block, n) * total


def filtered(effects: Sequence[Effect], omega: Array, dt: float, block: int = 1, n: int = 0) -> Array:
    """Factor by which the effects that filter change the spectrum.

    Parameters
    ----------
    effects : sequence of Effect
    omega : ndarray, shape (m,)
        Frequencies [rad per block].
    dt : float
        Sampling period [s].
    block : int
        Samples averaged to one.
    n : int
        Blocks of the record whose cosine ordinates are looked at; zero for a record without end.

    Returns
    -------
    ndarray, shape (m,)
    """
    out = np.ones(omega.size)
    for e in effects:
        factor = e.response(omega / block, dt)
        out = out if factor is None else out * factor
    if n and block == 1 and any(e.is_filter for e in effects) and not any(e.is_measured for e in effects):
        out += np.interp(omega, *_leak(effects, dt)) * np.cos(0.5 * omega) ** 2 / n
    return out


def is_passed(
    effects: Sequence[Effect], omega: Array, dt: float, block: int = 1, n: int = 0
) -> NDArray[np.bool_]:
    """Where the filters among effects let so much pass that a record shows it, and not what its ends leak.

    Parameters
    ----------
    effects : sequence of Effect
    omega : ndarray, shape (m,)
        Frequencies [rad per block].
    dt : float
        Sampling period [s].
    block : int
        Samples averaged to one.
    n : int
        Blocks of the record; zero for a record without end.

    Returns
    -------
    ndarray, shape (m,)
    """
    measured = [e for e in effects if e.is_measured]
    out = filtered(filters_that_stop(effects), omega, dt, block) >= MIN_PASSED_POWER_SHARE
    if n and block == 1 and measured:
        grid, leak = _leak(measured, dt)
        largest = np.interp(omega, grid, maximum_filter1d(np.abs(leak), LEAK_ENVELOPE_LAGS)) / n
        out &= largest * np.cos(0.5 * omega) ** 2 <= MAX_LEAK_SHARE * filtered(measured, omega, dt)
    return out


def filters_that_stop(effects: Sequence[Effect]) -> list[Effect]:
    """Of effects the filters that may pass less than a record shows."""
    return [e for e in effects if e.is_filter and not e.is_measured]


def _leak(effects: Sequence[Effect], dt: float) -> tuple[Array, Array]:
    """What a record without end does not show: power that the ends of one carry to other ordinates, times its length.

    A cosine ordinate at ``omega = pi k / n`` of a stationary series of autocovariance ``gamma`` has the variance
    ``S(omega) - (2 / n) sum_h gamma(h) (h cos(omega h) + sin(omega h) / sin(omega))``: the sum over all pairs of
    samples, of which the second part is that of the cosines of the sums of their times. It is little but where a
    filter lets nothing pass.

    Parameters
    ----------
    effects : sequence of Effect
        Those that filter.
    dt : float
        Sampling period [s].

    Returns
    -------
    omega : ndarray, shape (MAX_LEAK_LAGS - 1,)
    leak : ndarray, shape (MAX_LEAK_LAGS - 1,)
        Over ``cos(omega / 2)^2``.
    """
    from scipy.fft import dct, dst, irfft

    h = np.arange(1, MAX_LEAK_LAGS)
    passed = filtered(effects, np.pi * np.arange(MAX_LEAK_LAGS + 1) / MAX_LEAK_LAGS, dt)
    gamma = irfft(passed)[1:MAX_LEAK_LAGS]
    grid = np.pi * h / MAX_LEAK_LAGS
    cosines = 0.5 * dct(np.concatenate([[0.0], h * gamma, [0.0]]), type=1)[1:MAX_LEAK_LAGS]
    sines = 0.5 * dst(gamma, type=1) / np.sin(grid)
    # Both parts cancel at the Nyquist frequency, to second order.
    return grid, -2.0 * (cosines + sines) / np.cos(0.5 * grid) ** 2
