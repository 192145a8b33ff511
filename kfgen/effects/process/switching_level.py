"""`Switching`: likelihood of a level that jumps between two values, beside the slow noise of a linear model.

Given the jumps the samples are those of a Kalman filter; the number of possible histories doubles with every
sample. Two filters, one for each level of the last cell, are run: each of their histories is followed through one
more jump, and those that end on one level are merged into one normal law of the same mean and covariance [1]_.
Without slow noise this is the exact recursion of a hidden Markov chain, `kfgen.effects.process.markov_chain`.

References
----------
.. [1] H. A. P. Blom and Y. Bar-Shalom, The interacting multiple model algorithm for systems with Markovian
   switching coefficients, IEEE Trans. Automatic Control 33(8), 1988; the pseudo-Bayesian form of second order,
   G. A. Ackerson and K. S. Fu, IEEE Trans. Automatic Control 15(1), 1970.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from kfgen.core import linear
from kfgen.effects.linear_system import LinearSystem, discretise, initial_covariance
from kfgen.effects.process import markov_chain as chain

Array = NDArray[np.float64]

LEVEL_OFFSETS = np.array([-0.5, 0.5])
"""Of the two levels from their middle, in units of their distance."""
SINGLE_LEVEL_OFFSET = np.zeros(1)
"""The only level where there are no jumps."""


@dataclass(frozen=True)
class Slow:
    """The slow noise of a model as one linear system between cells.

    Parameters
    ----------
    Phi, Q, P0 : ndarray, shape (k, k)
        Transition, process noise, covariance in the first cell.
    C : ndarray, shape (k,)
        Output row.
    """

    Phi: Array
    Q: Array
    P0: Array
    C: Array

    @staticmethod
    def of(forms: Sequence[LinearSystem], dt: float) -> Slow:
        """The slow noise of some random effects.

        Parameters
        ----------
        forms : sequence of LinearSystem
            Of the effects; those without states add nothing.
        dt : float
            Length of a cell [s].

        Returns
        -------
        Slow
        """
        steps = [discretise(f, dt) for f in forms]
        C = np.concatenate([np.zeros(0), *(np.array(f.C, dtype=np.float64) for f in forms)])
        starts = [initial_covariance(f) for f in forms]
        return Slow(
            linear.beside([Phi for Phi, _ in steps]),
            linear.beside([Q for _, Q in steps]),
            linear.beside(starts),
            C,
        )

    @property
    def order(self) -> int:
        """Number of states."""
        return int(self.C.size)


@dataclass(frozen=True)
class SwitchingParameters:
    """What the level and the noise are, shape (p,) each: p filters run side by side.

    Parameters
    ----------
    size, dwell, middle : ndarray
        Distance of the levels [SI]; mean time on one of them [s]; half-way between them [SI].
    loud, wander : ndarray
        Factors of the standard deviations of the white and of the slow noise.
    """

    size: Array
    dwell: Array
    middle: Array
    loud: Array
    wander: Array


@dataclass(frozen=True)
class Switching:
    """Cells of a record.

    Parameters
    ----------
    mean : ndarray, shape (m,)
        Their means [SI], about zero.
    dt, sd : float
        Length of a cell [s], standard deviation of its white noise [SI].
    slow : Slow
    levels : ndarray, shape (L,)
        From their middle, in units of the distance of two; a jump leads to each with the same probability.
    """

    mean: Array
    dt: float
    sd: float
    slow: Slow
    levels: Array = field(default_factory=LEVEL_OFFSETS.copy)

    def log_likelihood(self, at: SwitchingParameters) -> Array:
        """Log-likelihood [nats] of each point, shape (p,)."""
        if self.slow.order or self.levels.size != LEVEL_OFFSETS.size:
            return self._run(at)[0]
        levels = LEVEL_OFFSETS if np.any(at.size) else SINGLE_LEVEL_OFFSET
        sd = self.sd * at.loud[:, None]
        left = (self.mean[:, None, None] - at.middle[:, None] - at.size[:, None] * levels) / sd
        log_e = -0.5 * left**2 - np.log(sd) - 0.5 * float(np.log(2.0 * np.pi))
        if levels is SINGLE_LEVEL_OFFSET:
            return np.asarray(log_e[:, :, 0].sum(axis=0))
        half = np.full(at.size.size, 0.5)
        return chain.log_likelihood(log_e, chain.transitions(half, at.dwell, self.dt), half)

    def innovations(self, at: SwitchingParameters) -> Array:
        """Standardised innovation of each cell, shape (m,): unit normal if the model holds.

        The normal deviate of the probability that a cell is at most what it is, given those before it.
        """
        return self._run(at)[1]

    def quiet(self, at: SwitchingParameters, z: Array) -> Array:
        """The cells that the model without levels would give for the same innovations.

        Parameters
        ----------
        at : SwitchingParameters
            One point, whose noise is taken.
        z : ndarray, shape (m,)
            Standardised innovations.

        Returns
        -------
        ndarray, shape (m,)
            [SI].
        """
        slow, R = self.slow, float((self.sd * at.loud[0]) ** 2)
        x, P = np.zeros(slow.order), slow.P0 * float(at.wander[0]) ** 2
        Q, out = slow.Q * float(at.wander[0]) ** 2, np.empty_like(z)
        for k, deviate in enumerate(z.tolist()):
            if k:
                x, P = slow.Phi @ x, slow.Phi @ P @ slow.Phi.T + Q
            PC = P @ slow.C
            S = float(slow.C @ PC) + R
            new = deviate * np.sqrt(S)
            out[k] = float(slow.C @ x) + new
            x, P = x + PC * (new / S), P - np.outer(PC, PC) / S
        return out

    def _run(self, at: SwitchingParameters) -> tuple[Array, Array]:
        from scipy.special import ndtri

        H, Phi, levels = self.slow.C, self.slow.Phi, self.levels if np.any(at.size) else SINGLE_LEVEL_OFFSET
        Q, P = (at.wander[:, None, None] ** 2 * M for M in (self.slow.Q, self.slow.P0))
        count = at.size.size
        R = (self.sd * at.loud)[:, None] ** 2
        x, p = np.zeros((count, levels.size, H.size)), np.full((count, levels.size), 1.0 / levels.size)
        V = np.broadcast_to(P[:, None], (count, levels.size, *P.shape[1:]))
        T = chain.redrawn(np.exp(-2.0 * self.dt / at.dwell), np.full((count, levels.size), 1.0 / levels.size))
        shift = at.middle[:, None, None] + at.size[:, None, None] * levels * np.ones((levels.size, 1))
        total, z, slow = np.zeros(count), np.empty(self.mean.size), H.size > 0
        S, ahead = np.broadcast_to(R, p.shape), np.zeros_like(shift)
        for k, y in enumerate(self.mean.tolist()):
            if slow:
                if k:
                    x, V = x @ Phi.T, Phi @ V @ Phi.T + Q[:, None]
                VH = V @ H
                S, ahead = VH @ H + R, (x @ H)[:, :, None]
            left = y - ahead - shift
            prior = p[:, :, None] * T
            w = prior * np.exp(-0.5 * left**2 / S[:, :, None]) / np.sqrt(S)[:, :, None]
            z[k] = _below(prior[0], left[0], S[0]) if count == 1 else 0.0
            both = w.sum(axis=1)
            whole = both.sum(axis=1)
            seen = np.maximum(whole, 1e-300)
            total += np.log(seen)
            p = np.maximum(both / seen[:, None], 1e-12)
            if slow:
                share = w / np.maximum(both, 1e-300)[:, None, :]
                x, V = _merged(x, V, VH, VH / S[..., None], left, share)
        return total - 0.5 * self.mean.size * float(np.log(2.0 * np.pi)), ndtri(
            np.clip(z, 1e-15, 1.0 - 1e-15)
        )


def _merged(x: Array, V: Array, VH: Array, g: Array, left: Array, share: Array) -> tuple[Array, Array]:
    """Means and covariances after a cell, those that end on one level as one: `share` from each level to each."""
    each = x[:, :, None] + g[:, :, None] * left[..., None]
    mean = (share[..., None] * each).sum(axis=1)
    d = each - mean[:, None]
    kept = V - g[..., :, None] * VH[..., None, :]
    spread = kept[:, :, None] + d[..., :, None] * d[..., None, :]
    return np.asarray(mean), np.asarray((share[..., None, None] * spread).sum(axis=1))


def _below(prior: Array, left: Array, S: Array) -> float:
    """Probability of at most what was seen: `prior` (2, 2) of level before and after, `left` what it is off."""
    from scipy.special import ndtr

    return float(np.sum(prior * ndtr(left / np.sqrt(S)[:, None])))
