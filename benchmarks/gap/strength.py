"""How many nats a hidden effect is worth: the mean gain of log-likelihood over the assumed model.

A record of n samples is seen through its cosine transform (DCT-II, orthonormal): ordinate k = 1 … n-1
at the frequency k/(2 n dt) is real, nearly independent, and of variance P_k under the assumed model.
The constant, k = 0, is left out: an offset is no gap. Unlike the Fourier transform it does not see a
jump between the ends of the record. The assumed model may retune its level: a common factor c of P.

* known signal s(t):        ``1/2 sum S_k^2 / P_k``
* random, variance ratio r: ``1/2 sum (r_k/c - 1 - ln(r_k/c))`` at the best ``c = mean r``, which is
  ``n/2 ln(mean r) - 1/2 sum ln r``; with r = 1 + x small it is ``1/2 sum (x - ln(1 + x))``
* white noise whose variance v(t) changes: the same in time, r = v
* outliers: n times the Kullback-Leibler divergence of the mixture from the normal law of equal variance
* telegraph, bursts: mean over drawn records of the log-likelihood of the two-level hidden Markov model
  less that of the white noise

The strength X is this gain less a penalty, see `penalty`.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.fft import dct
from scipy.optimize import brentq

Array = NDArray[np.float64]


def penalty(n: int, ordinary: int = 0, located: int = 0, lines: int = 0) -> float:
    """Nats that the parameters of an effect cost, with ``L = ln n``.

    ``L/2`` per ordinary parameter (half of what Schwarz's criterion takes from -2 ln likelihood), and ``L``
    per place in time that has to be searched. A line of unknown frequency costs ``5L/2`` in all: two
    amplitudes, and a frequency whose information grows as n^3 [1]_.

    References
    ----------
    .. [1] P. M. Djuric, A model selection rule for sinusoids in white Gaussian noise, IEEE Trans. Signal
       Processing 44, 1996.
    """
    return (0.5 * ordinary + located + 2.5 * lines) * float(np.log(n))


def ordinates(n: int, dt: float) -> Array:
    """Frequencies [Hz] of the cosine transform, without the constant."""
    return np.arange(1, n) / (2.0 * n * dt)


def known_gain(signal: Array, P: Array) -> float:
    """Nats of a known signal over an assumed spectrum."""
    S = dct(signal, norm="ortho")[1:]
    return float(0.5 * (S * S / P).sum())


def random_gain(ratio: Array) -> float:
    """Nats of a variance that is `ratio` times the assumed one, up to a common factor."""
    return float(0.5 * (ratio.size * np.log(ratio.mean()) - np.log(ratio).sum()))


def mixture_gain(
    n: int, share: float, size: float, true: tuple[float, float] | None = None, white: float = 1.0
) -> float:
    """Nats of outliers over the normal law of equal variance: a share of samples has noise of `size` added.

    Parameters
    ----------
    true : (float, float), optional
        Share and size of the outliers that there are; those of the model by default.
    white : float
        Standard deviation of the model's white noise, in units of the true one; sizes are in these units too.
    """
    true = (share, size) if true is None else true
    end = 8.0 * (1.0 + true[1])
    y = np.linspace(-end, end, 40_001)
    p = np.exp(_mixture(y, *true, 1.0))
    gained = _mixture(y, share, size, white) - _log_normal(y, white**2 + share * size**2)
    return float(n * (p * gained).sum() * (y[1] - y[0]))


def _mixture(y: Array, share: float, size: float, white: float) -> Array:
    """Logarithm of the density."""
    quiet, loud = _log_normal(y, white**2), _log_normal(y, white**2 + size**2)
    return np.asarray(np.logaddexp(np.log1p(-share) + quiet, np.log(max(share, 1e-300)) + loud))


def _log_normal(y: Array, variance: float) -> Array:
    return np.asarray(-0.5 * y * y / variance - 0.5 * np.log(2.0 * np.pi * variance))


def telegraph_gain(y: Array, size: float, stay: float) -> float:
    """Nats of two levels `size` apart over one level, in white noise of standard deviation 1, for one record.

    Parameters
    ----------
    y : array, (n,)
        The record.
    stay : float
        Probability of keeping the level from one sample to the next.
    """
    y = y - y.mean()
    odds = np.exp(np.clip(size * y, -50.0, 50.0)).tolist()  # of high against low: levels at +- size/2
    p, total, leave = 0.5, 0.0, 1.0 - stay
    for o in odds:
        p = stay * p + leave * (1.0 - p)
        mixed = p * o + 1.0 - p
        total += np.log(mixed)
        p = p * o / mixed
    return float(total - 0.5 * (size * y).sum() - y.size * size * size / 8.0)


def burst_gain(y: Array, ratio: float, share: float, leave: float) -> float:
    """Nats of noise that is `ratio` times as loud for a while over that of one level, for one record of it.

    Parameters
    ----------
    y : array, (n,)
        The record; quiet samples are of standard deviation 1.
    leave : float
        Probability that a loud sample is followed by a quiet one.
    """
    enter = leave * share / (1.0 - share)
    odds = np.exp(np.minimum(0.5 * y * y * (1.0 - ratio**-2), 500.0)) / ratio
    p, total = share, 0.0
    for o in odds.tolist():
        mixed = p * o + 1.0 - p
        total += np.log(mixed)
        p = p * o / mixed
        p = p * (1.0 - leave) + (1.0 - p) * enter
    power = float(np.mean(y * y))
    return float(total - 0.5 * y.size * (power - 1.0 - np.log(power)))


def expected(true: Array, left: Array, assumed: Array) -> float:
    """Mean log-likelihood [nats] of records under an assumed spectrum at its best level, up to a constant.

    Parameters
    ----------
    true, assumed : array, (n - 1,)
        Variance of each ordinate.
    left : array, (n,)
        The known signals that there are less those that are assumed.
    """
    D = dct(left, norm="ortho")[1:]
    level = ((true + D * D) / assumed).mean()
    return float(-0.5 * (np.log(assumed).sum() + assumed.size * np.log(level)))


def scaled(gain: Callable[[float], float], wanted: float, lo: float, hi: float) -> float:
    """The size in (lo, hi) whose gain is `wanted`; the nearer end where neither reaches it."""
    if gain(hi) < wanted:
        return hi
    if gain(lo) > wanted:
        return lo
    found = brentq(lambda a: gain(float(np.exp(a))) - wanted, np.log(lo), np.log(hi), xtol=2e-3)
    return float(np.exp(found))


def approached(gain: Callable[[float], float], wanted: float, start: float) -> float:
    """As `scaled`, with few evaluations of a dear gain that grows about as the square of the size."""
    size, slope = start, 2.0
    got = gain(size)
    for _ in range(10):
        if abs(np.log(got / wanted)) < 0.05:
            break
        step = float(np.clip(np.log(wanted / got) / slope, -8.0, 3.0))
        new = gain(size * float(np.exp(step)))
        slope = float(np.clip(np.log(new / got) / step, 0.7, 6.0))
        size, got = size * float(np.exp(step)), new
    return size
