"""`knocked`: likelihood of something that is knocked now and then and rings down in between, of the spectrum of a resonance.

A knock puts the two components of the swing anew, each with a normal law, and they fade; what an earlier knock left is
forgotten. The record is then a hidden semi-Markov chain [1]_ whose state is the time since the last knock: in each block
it goes on, or a knock begins it again.

References
----------
.. [1] S.-Z. Yu, Hidden semi-Markov models, Artificial Intelligence 174(2), 2010.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kfgen.gap.core.swing import Swing

Array = NDArray[np.float64]

FADES_FOLLOWED = 2.0
"""Time constants for which a knock is followed: then a fiftieth of its power is left."""
MIN_FOLLOWED_BLOCKS, MAX_FOLLOWED_BLOCKS = 4, 64
"""In which a knock is followed."""
MAX_BLOCK_NATS = 60.0
"""By which one block may change a likelihood, that no number overflows."""


def knocked(swing: Swing, walk: Array, damping: Array, rms: Array, rate: float) -> Array:
    """Log-likelihood [nats] over that of no swing, of p such things side by side.

    Parameters
    ----------
    swing : Swing
    walk : ndarray, shape (p,)
        Frequency less that of the blocks [rad per sample].
    damping : ndarray, shape (p,)
        Rate at which they fade [1 per sample].
    rms : ndarray, shape (p,)
        Standard deviation, quiet times among the others.
    rate : float
        Mean number of knocks in the time constant of the fading.

    Returns
    -------
    ndarray, shape (p,)
    """
    fade = damping * swing.size
    followed = int(np.clip(FADES_FOLLOWED / fade.min(), MIN_FOLLOWED_BLOCKS, MAX_FOLLOWED_BLOCKS))
    since = np.arange(followed)
    # A swing x began as x0: x = r x0, both as complex numbers.
    r = np.exp((1j * walk * swing.size - fade)[:, None] * since)
    power = 0.5 * rate / (rms**2)[:, None]  # the inverse of a knock's variance
    hit = -np.expm1(-rate * fade)[:, None]
    share = hit * (1.0 - hit) ** since
    quiet = 1.0 - share.sum(axis=1)
    turned, squared = r.conj(), np.abs(r) ** 2
    turned2 = turned**2
    g = np.zeros(r.shape, complex)
    even, uneven, before = np.zeros(r.shape), np.zeros(r.shape, complex), np.zeros(r.shape)
    value = np.zeros(rms.size)
    G = swing.g[:, 0] + 1j * swing.g[:, 1]
    M = 0.5 * (swing.M[:, 0] + swing.M[:, 2])
    N = 0.5 * (swing.M[:, 0] - swing.M[:, 2]) + 1j * swing.M[:, 1]
    for k in range(G.size):
        if k:
            quiet = (quiet + share[:, -1]) * (1.0 - hit[:, 0])
            share = np.concatenate([hit, share[:, :-1] * (1.0 - hit)], axis=1)
            for x in (g, even, uneven, before):
                x[:, 1:] = x[:, :-1]
                x[:, 0] = 0.0
        g += turned * G[k]
        even += squared * M[k]
        uneven += turned2 * N[k]
        tight = even + power
        det = tight**2 - np.abs(uneven) ** 2
        log_e = 0.5 * (tight * np.abs(g) ** 2 - (uneven.conj() * g**2).real) / det - 0.5 * np.log(
            det / power**2
        )
        seen = share * np.exp(np.minimum(log_e - before, MAX_BLOCK_NATS))
        before = log_e
        total = quiet + seen.sum(axis=1)
        value += np.log(total)
        share, quiet = seen / total[:, None], quiet / total
    return value
