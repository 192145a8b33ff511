"""Hidden Markov chain of two levels: its likelihood, and histories drawn from it; the likelihood of one of many levels.

Used by effects that switch on and off: random telegraph noise, bursts of noise.

References
----------
.. [1] L. R. Rabiner, A tutorial on hidden Markov models, Proc. IEEE 77(2), 1989, sec. III.
.. [2] S. L. Scott, Bayesian methods for hidden Markov models, J. Am. Stat. Assoc. 97, 2002, sec. 2.1.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

LONG_RUN_STEPS = 4096
"""After which a chain has forgotten where it was."""


def transitions(share: Array, lasting: Array, dt: float) -> Array:
    """Probabilities of going from each level to each over one step.

    Parameters
    ----------
    share : ndarray, shape (p,)
        Share of the time on the second level.
    lasting : ndarray, shape (p,)
        Mean time on it at a stretch [s]; such times are exponential.
    dt : float
        Step [s].

    Returns
    -------
    ndarray, shape (p, 2, 2)
        Rows: level before; columns: level after.
    """
    stay = np.exp(-dt / (lasting * (1.0 - share)))  # the rates of leaving either level together
    return redrawn(stay, np.stack([1.0 - share, share], axis=-1))


def redrawn(stay: Array, law: Array) -> Array:
    """The same of a chain that stays on its level or is drawn anew, on the same one perhaps.

    Parameters
    ----------
    stay : ndarray, shape (p,)
        Probability that it is not drawn anew in a step.
    law : ndarray, shape (p, L)
        Probability of each level.

    Returns
    -------
    ndarray, shape (p, L, L)
        Rows: level before; columns: level after.
    """
    again = (1.0 - stay)[:, None, None] * law[:, None, :]
    return np.asarray(stay[:, None, None] * np.eye(law.shape[1]) + again)


def log_likelihood(log_e: Array, T: Array, share: Array) -> Array:
    """Log-likelihood of p chains side by side over m steps, by the forward recursion [1]_, eqs (19)-(21).

    Parameters
    ----------
    log_e : ndarray, shape (m, p, 2)
        Log-likelihood of what was seen at each step on each level.
    T : ndarray, shape (p, 2, 2)
        Probabilities of going from each level to each.
    share : ndarray, shape (p,)
        Probability to begin on the second level.

    Returns
    -------
    ndarray, shape (p,)
        [nats].
    """
    top = log_e.max(axis=2)
    low, high = np.moveaxis(np.exp(log_e - top[:, :, None]), 2, 0)
    a, b = (1.0 - share) * low[0], share * high[0]
    seen = np.empty_like(top)
    (stay, up), (down, keep) = T[:, 0].T, T[:, 1].T
    for k in range(top.shape[0]):
        if k:
            a, b = (a * stay + b * down) * low[k], (a * up + b * keep) * high[k]
        total = np.maximum(a + b, 1e-300)
        seen[k] = total
        a, b = a / total, b / total
    return np.asarray((np.log(seen) + top).sum(axis=0))


def log_likelihood_of_levels(log_e: Array, T: Array) -> Array:
    """The same of chains of many levels that see the same, each from where it is in the long run.

    Parameters
    ----------
    log_e : ndarray, shape (m, L)
        Log-likelihood of what was seen at each step on each level.
    T : ndarray, shape (p, L, L)
        Probabilities of going from each level to each.

    Returns
    -------
    ndarray, shape (p,)
        [nats].
    """
    top = log_e.max(axis=1)
    p = np.linalg.matrix_power(T, LONG_RUN_STEPS)[:, :1]
    total = np.full(len(T), float(top.sum()))
    for k, e in enumerate(np.exp(log_e - top[:, None])):
        p = (p @ T if k else p) * e
        whole = np.maximum(p.sum(axis=2), 1e-300)
        total += np.log(whole[:, 0])
        p = p / whole[:, :, None]
    return np.asarray(total)


def history(log_odds: Array, T: Array, share: float, rng: np.random.Generator) -> NDArray[np.bool_]:
    """One history of the level, drawn from all in proportion to their probability [2]_.

    Parameters
    ----------
    log_odds : ndarray, shape (m,)
        Log-likelihood of what was seen on the second level over that on the first.
    T : ndarray, shape (2, 2)
        Probabilities of going from each level to each.
    share : float
        Probability to begin on the second level.
    rng : numpy Generator

    Returns
    -------
    ndarray of bool, shape (m,)
        True on the second level.
    """
    (_, up), (_, keep) = T.tolist()
    odds = np.exp(np.clip(log_odds, -300.0, 300.0)).tolist()
    filtered, p = [], share
    for k, o in enumerate(odds):
        ahead = p * keep + (1.0 - p) * up if k else p
        p = ahead * o / (ahead * o + 1.0 - ahead)
        filtered.append(p)
    out, u = np.empty(len(odds), dtype=np.bool_), rng.random(len(odds)).tolist()
    later: bool | None = None
    for k in range(len(odds) - 1, -1, -1):
        p = filtered[k]
        if later is not None:
            high, low = (p * keep, (1.0 - p) * up) if later else (p * (1.0 - keep), (1.0 - p) * (1.0 - up))
            p = high / max(high + low, 1e-300)
        out[k] = later = u[k] < p
    return out


def drawn(n: int, T: Array, share: float, rng: np.random.Generator) -> NDArray[np.bool_]:
    """A history of the level of which nothing is seen: a simulation of the chain.

    Parameters
    ----------
    n : int
        Steps.
    T : ndarray, shape (2, 2)
        Probabilities of going from each level to each.
    share : float
        Probability to begin on the second level.
    rng : numpy Generator

    Returns
    -------
    ndarray of bool, shape (n,)
        True on the second level.
    """
    return history(np.zeros(n), T, share, rng)
