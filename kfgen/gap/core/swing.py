"""`Swing`: what a record tells of something that swings at about one frequency, and its likelihood under three laws.

All three have one spectrum, to the first order in the damping, and only the likelihood distinguishes them:

- a *resonance*: noise drives a damped oscillator; its two components are normal (Kalman's filter);
- a *limit cycle*, which swings by itself: one amplitude and a phase that walks with a variance of ``2 damping`` a second
  (forward recursion of a hidden Markov chain over the phase [1]_);
- a *modulated line*: one phase and an amplitude that comes and goes (Kalman's filter of the amplitude).

The record is gathered into blocks in which neither phase nor amplitude changes much.

References
----------
.. [1] L. R. Rabiner, A tutorial on hidden Markov models, Proc. IEEE 77(2), 1989, eqs (19)-(21).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

PHASES = 24
"""Of the chain."""
MAX_BLOCKS = 2048
"""That are looked at, from the beginning on."""
AMPLITUDE_SCATTER = 0.25
"""Standard deviation of a limit cycle's amplitude from block to block, over its mean: no breath is like another."""


@dataclass(frozen=True)
class Swing:
    """Blocks of a white series: ``exp(g'x - x'Mx / 2)`` is the likelihood of the two components x of a swing in one.

    Parameters
    ----------
    g : ndarray, shape (m, 2)
    M : ndarray, shape (m, 3)
        Elements 11, 12 and 22.
    size : int
        Samples of a block.
    """

    g: Array
    M: Array
    size: int

    @staticmethod
    def of(z: Array, omega: float, size: int) -> Swing:
        """About a frequency.

        Parameters
        ----------
        z : ndarray, shape (n,)
            Samples of unit variance.
        omega : float
            Frequency [rad per sample].
        size : int
            Samples of a block.
        """
        m = min(z.size // size, MAX_BLOCKS)
        phase = omega * np.arange(m * size)
        c, s = np.cos(phase), -np.sin(phase)
        every = np.column_stack([z[: m * size] * c, z[: m * size] * s, c * c, c * s, s * s])
        total = every.reshape(m, size, 5).sum(axis=1)
        return Swing(total[:, :2], total[:, 2:], size)

    @property
    def samples(self) -> int:
        """In all blocks."""
        return len(self.g) * self.size

    def resonance(self, walk: Array, damping: Array, rms: Array) -> Array:
        """Log-likelihood [nats] over that of no swing, of p resonances side by side.

        Parameters
        ----------
        walk : ndarray, shape (p,)
            Frequency less that of the blocks [rad per sample].
        damping : ndarray, shape (p,)
            Rate at which they fade [1 per sample].
        rms : ndarray, shape (p,)
        """
        fade = np.exp(-damping * self.size)
        c, s = fade * np.cos(walk * self.size), fade * np.sin(walk * self.size)
        whole = rms**2
        fresh = whole * (1.0 - fade**2)
        x, y, p, q, r = 0.0 * rms, 0.0 * rms, whole, 0.0 * rms, whole
        value = np.zeros(rms.size)
        for k, ((g1, g2), (a, b, d)) in enumerate(zip(self.g.tolist(), self.M.tolist())):
            if k:
                x, y = c * x - s * y, s * x + c * y
                p, q, r = (
                    c * c * p - 2.0 * c * s * q + s * s * r + fresh,
                    c * s * (p - r) + (c * c - s * s) * q,
                    s * s * p + 2.0 * c * s * q + c * c * r + fresh,
                )
            e1, e2 = g1 - a * x - b * y, g2 - b * x - d * y
            n11, n12, n21, n22 = 1.0 + p * a + q * b, p * b + q * d, q * a + r * b, 1.0 + q * b + r * d
            det = n11 * n22 - n12 * n21  # of 1 + P M
            value += x * (g1 - 0.5 * (a * x + b * y)) + y * (g2 - 0.5 * (b * x + d * y)) - 0.5 * np.log(det)
            p, q, r = (n22 * p - n12 * q) / det, (n22 * q - n12 * r) / det, (n11 * r - n21 * q) / det
            value += 0.5 * (p * e1 * e1 + 2.0 * q * e1 * e2 + r * e2 * e2)
            x, y = x + p * e1 + q * e2, y + q * e1 + r * e2
        return value

    def limit_cycle(self, walk: Array, damping: Array, rms: Array) -> Array:
        """As `resonance`, of limit cycles of the same spectra."""
        phase = 2.0 * np.pi * np.arange(PHASES) / PHASES
        u, harmonic = np.array([np.cos(phase), np.sin(phase)]), np.arange(PHASES // 2 + 1)
        A = np.sqrt(2.0) * rms[:, None]
        precision = 1.0 / (AMPLITUDE_SCATTER * A) ** 2
        # A walk multiplies the transform of a law.
        step = np.exp(-self.size * (damping[:, None] * harmonic**2 + 1j * walk[:, None] * harmonic))
        seen = self.g @ u
        weight = self.M @ np.array([u[0] ** 2, 2.0 * u[0] * u[1], u[1] ** 2])
        p, value = np.full((rms.size, PHASES), 1.0 / PHASES), np.zeros(rms.size)
        for k in range(len(self.g)):
            if k:
                p = np.maximum(np.fft.irfft(np.fft.rfft(p, axis=1) * step, PHASES, axis=1), 1e-12)
            tight = precision + weight[k]
            log_e = 0.5 * ((seen[k] + A * precision) ** 2 / tight - A**2 * precision)
            log_e -= 0.5 * np.log(tight / precision)
            top = log_e.max(axis=1)
            p = p * np.exp(log_e - top[:, None])
            total = p.sum(axis=1)
            value += top + np.log(total)
            p /= total[:, None]
        return value

    def modulated_line(self, walk: Array, damping: Array, rms: Array, phase: Array, steady: float) -> Array:
        """As `resonance`, of lines of one phase.

        Parameters
        ----------
        walk, damping, rms : ndarray, shape (p,)
            As for `resonance`.
        phase : ndarray, shape (p,)
            At the beginning [rad].
        steady : float
            Share of the power that does not come and go.
        """
        fade, power = np.exp(-damping * self.size), 2.0 * rms**2
        mean, whole = np.sqrt(power * steady), power * (1.0 - steady)
        x, P, value = mean, whole, np.zeros(rms.size)
        for k, ((g1, g2), (a, b, d)) in enumerate(zip(self.g.tolist(), self.M.tolist())):
            if k:
                x, P = mean + fade * (x - mean), fade**2 * P + whole * (1.0 - fade**2)
            c, s = np.cos(phase + k * self.size * walk), np.sin(phase + k * self.size * walk)
            G, M = g1 * c + g2 * s, a * c * c + 2.0 * b * c * s + d * s * s
            e, det = G - M * x, 1.0 + P * M
            value += x * (G - 0.5 * M * x) - 0.5 * np.log(det)
            P = P / det
            value += 0.5 * P * e * e
            x = x + P * e
        return value
