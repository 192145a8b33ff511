"""Random processes drawn by numpy and scipy, and their spectra per ordinate of the cosine transform."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

Array = NDArray[np.float64]


def gauss_markov(rng: np.random.Generator, n: int, dt: float, sigma: float, tau: float) -> Array:
    """A first-order Gauss-Markov process in its steady state."""
    phi = np.exp(-dt / tau)
    w = rng.standard_normal(n) * sigma * np.sqrt(1.0 - phi * phi)
    w[0] = sigma * rng.standard_normal()
    return np.asarray(lfilter([1.0], [1.0, -phi], w))


def power(rng: np.random.Generator, n: int, exponent: float) -> Array:
    """Noise of spectrum ``f^-exponent`` (per sample, f in cycles per sample), cut from a record 4 n long."""
    m = 4 * n
    f = np.fft.rfftfreq(m)
    f[0] = np.inf
    w = np.fft.rfft(rng.standard_normal(m)) * f ** (-0.5 * exponent)
    return np.asarray(np.fft.irfft(w, m)[:n])


def middles(lo: float, hi: float, count: int) -> Array:
    """Middles of `count` equal parts in logarithm."""
    return np.asarray(lo * (hi / lo) ** ((np.arange(count) + 0.5) / count))


def telegraph(rng: np.random.Generator, n: int, dt: float, dwell: float) -> Array:
    """Zeros and ones with exponential times of stay of mean `dwell`."""
    return taking_turns(rng, n, dt, dwell, dwell)


def taking_turns(rng: np.random.Generator, n: int, dt: float, off: float, on: float) -> Array:
    """Zeros and ones with exponential times of stay of these means."""
    count = int(8 + 3 * n * dt / (off + on))
    ends = np.cumsum(rng.exponential([off, on], (count, 2)).ravel())
    start = int(rng.random() < on / (off + on))
    if start:
        ends = np.cumsum(rng.exponential([on, off], (count, 2)).ravel())
    return np.asarray((np.searchsorted(ends, np.arange(n) * dt) + start) % 2, float)


def smooth_wander(rng: np.random.Generator, n: int, dt: float, size: float, tau: float) -> Array:
    """A Gauss-Markov process smoothed by a pole at a fifth of its time constant."""
    phi = np.exp(-5.0 * dt / tau)
    x = gauss_markov(rng, n, dt, size, tau)
    return np.asarray(lfilter([1.0 - phi], [1.0, -phi], x, zi=[phi * x[0]])[0])


def angles(n: int) -> Array:
    """Angular frequency per sample of each ordinate."""
    return np.asarray(np.pi * np.arange(1, n) / n)


def gauss_markov_spectrum(n: int, dt: float, sigma: float, tau: float) -> Array:
    """Variance of each ordinate."""
    phi = np.exp(-dt / tau)
    return np.asarray(sigma**2 * (1.0 - phi * phi) / (1.0 - 2.0 * phi * np.cos(angles(n)) + phi * phi))


def walk_spectrum(n: int) -> Array:
    """Variance of each ordinate of a random walk of unit steps; exact."""
    return np.asarray(0.25 / np.sin(0.5 * angles(n)) ** 2)


def difference_spectrum(n: int) -> Array:
    """Variance of each ordinate of the difference of unit white noise."""
    return np.asarray(4.0 * np.sin(0.5 * angles(n)) ** 2)


def power_law_spectrum(n: int, dt: float, B: float, slope: float) -> Array:
    """Variance of each ordinate of noise of density ``B^2 w^-slope``, w in rad/s."""
    return np.asarray(B**2 / dt * (angles(n) / dt) ** -slope)


def flicker_spectrum(n: int) -> Array:
    """Variance of each ordinate of flicker noise with ``B = 1``: ``1 / (2 pi f)`` per sample."""
    return np.asarray(1.0 / angles(n))


def poles(frequency: float, damping: float) -> tuple[float, float, float]:
    """Denominator of an oscillator of given frequency [cycles per sample] and damping."""
    w = 2.0 * np.pi * frequency
    r = np.exp(-damping * w)
    return 1.0, float(-2.0 * r * np.cos(w * np.sqrt(1.0 - damping**2))), float(r * r)


def all_pole_spectrum(n: int, a: tuple[float, float, float]) -> Array:
    """Variance of each ordinate of unit white noise through ``1 / a(z)``."""
    z = np.exp(-1j * angles(n))
    return np.asarray(1.0 / np.abs(a[0] + a[1] * z + a[2] * z * z) ** 2)
