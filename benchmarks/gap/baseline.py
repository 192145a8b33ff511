"""Baselines: which effect the Allan variance alone would name, by lowest AIC and by lowest BIC.

The overlapping Allan variance at octaves of the sample time is fitted, in logarithms and with weights
of half its degrees of freedom, by the assumed terms (held) plus up to two of Q, B, GM, K, R and by a
white noise whose size is free. The name given is that of the added term that improves the fit most.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import combinations

import numpy as np
from case import Array
from scipy.optimize import least_squares

NAMES = {
    "Q": "quantisation",
    "B": "bias_instability",
    "GM": "gauss_markov",
    "K": "rate_random_walk",
    "R": "rate_ramp",
}
MOST = 2
"""Terms that are added at once."""


def allan_variance(y: Array, dt: float) -> tuple[Array, ...]:
    """Averaging times, overlapping Allan variances, and equivalent degrees of freedom of white noise."""
    x = np.concatenate([[0.0], np.cumsum(y - y.mean())]) * dt
    m = 2 ** np.arange(int(np.log2(y.size / 8)))
    tau = m * dt
    avar = [
        float(np.square(x[2 * k :] - 2 * x[k:-k] + x[: -2 * k]).mean()) / (2.0 * t * t)
        for k, t in zip(m, tau)
    ]
    n, k = y.size + 1, m.astype(float)
    edf = (3.0 * (n - 1) / (2.0 * k) - 2.0 * (n - 2) / n) * 4.0 * k * k / (4.0 * k * k + 5.0)
    return tuple(np.asarray(a, float) for a in (tau, avar, np.maximum(edf, 1.0)))


def gauss_markov_variance(tau: Array, sigma: float, corner: float) -> Array:
    """Allan variance of a Gauss-Markov process."""
    u = np.clip(tau / corner, 1e-4, 1e9)  # beyond, the differences of exponentials lose their digits
    return np.asarray(2.0 * sigma**2 / u * (1.0 - (3.0 - 4.0 * np.exp(-u) + np.exp(-2.0 * u)) / (2.0 * u)))


def said(y: Array, dt: float, base: Mapping[str, float]) -> tuple[str, str]:
    """The names by lowest AIC and by lowest BIC; ``none`` where the assumed terms suffice."""
    tau, avar, edf = allan_variance(y, dt)
    fits: dict[tuple[str, ...], float] = {(): _misfit((), tau, avar, edf, base)}
    for size in range(1, MOST + 1):
        for terms in combinations(NAMES, size):
            fits[terms] = _misfit(terms, tau, avar, edf, base)

    def best(price: float) -> str:
        terms = min(fits, key=lambda t: fits[t] + price * (1 + len(t) + t.count("GM")))
        return NAMES[min(terms, key=lambda t: fits[(t,)])] if terms else "none"

    return best(2.0), best(float(np.log(tau.size)))


def _misfit(terms: tuple[str, ...], tau: Array, avar: Array, edf: Array, base: Mapping[str, float]) -> float:
    """Least weighted square of the logarithms."""
    held = gauss_markov_variance(tau, base["sigma"], base["tau"]) if base.get("sigma") else np.zeros(tau.size)
    shapes = {
        "Q": 3.0 / tau**2,
        "B": np.full(tau.size, 2.0 * np.log(2.0) / np.pi),
        "K": tau / 3.0,
        "R": 0.5 * tau**2,
    }

    def residual(theta: Array) -> Array:
        model = held + np.exp(theta[0]) / tau
        k = 1
        for term in terms:
            if term == "GM":
                model = model + gauss_markov_variance(
                    tau, float(np.exp(0.5 * theta[k])), float(np.exp(theta[k + 1]))
                )
                k += 2
            else:
                model = model + np.exp(theta[k]) * shapes[term]
                k += 1
        return np.asarray(np.sqrt(0.5 * edf) * np.log(avar / np.maximum(model, 1e-300)))

    white = np.log(base["N"] ** 2)
    starts = [0.1 * float(avar.min()), 0.01 * float(avar.min())]
    found = []
    for level in starts:
        theta = [white]
        for term in terms:
            if term == "GM":
                theta += [np.log(4.0 * level), np.log(float(np.sqrt(tau[0] * tau[-1])))]
            else:
                theta.append(
                    np.log(level / float(shapes[term][tau.size // 2 if term == "B" else _end(term)]))
                )
        lo, hi = np.asarray(theta) - 40.0, np.asarray(theta) + 40.0
        found.append(2.0 * least_squares(residual, theta, bounds=(lo, hi), max_nfev=60).cost)
    return float(min(found))


def _end(term: str) -> int:
    return 0 if term == "Q" else -1
