"""The samples that a series lacks, by what its noise makes most probable between those that are known."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kfgen.gap.core.whitener import Whitener

Array = NDArray[np.float64]

MAX_SAMPLES_IN_CLOSED_FORM = 2500
"""Unknown samples up to which one factorisation serves all series."""
RELATIVE_RIDGE = 1e-12
"""Of the mean information, for samples of which the noise's band says nothing."""
MAX_GRADIENT_STEPS = 12
"""Conjugate gradients that complete a series at most."""
SLOPE_TOLERANCE = 1e-6
"""Of the squared slope, at which a series is complete."""


@dataclass(frozen=True)
class Completion:
    """Completes series whose unknown samples stand at the same places.

    Parameters
    ----------
    white : Whitener
        Of the noise.
    known : ndarray of bool, shape (n,)
    factor : tuple, optional
        Cholesky factor of the information of the unknown samples; none where there are too many of them.
    """

    white: Whitener
    known: NDArray[np.bool_]
    factor: Any = None

    @staticmethod
    def of(white: Whitener, known: NDArray[np.bool_]) -> Completion:
        """For a noise and places.

        Parameters
        ----------
        white : Whitener
        known : ndarray of bool, shape (n,)
        """
        from scipy.linalg import cho_factor

        at = np.flatnonzero(~known)
        if not 0 < at.size <= MAX_SAMPLES_IN_CLOSED_FORM:
            return Completion(white, known)
        lags = _correlation(white.weight)
        H = lags[np.abs(at[:, None] - at)] + lags[at[:, None] + at + 1]
        H[np.diag_indices_from(H)] += RELATIVE_RIDGE * float(np.mean(np.diag(H)))
        return Completion(white, known, cho_factor(H))

    def completed(self, x: Array) -> Array:
        """The most probable series that has the known samples of `x`, shape (n,).

        Parameters
        ----------
        x : ndarray, shape (n,)
            Where it is not known, with a first guess.
        """
        if self.factor is None:
            return self._by_gradients(x)
        from scipy.linalg import cho_solve

        z = np.array(x, dtype=np.float64)
        z[~self.known] -= cho_solve(self.factor, self._slope(z)[~self.known])
        return z

    def _slope(self, z: Array) -> Array:
        """Half the derivative of the squared white series in the unknown samples, zero in the others."""
        return np.where(self.known, 0.0, self.white.back(self.white.ordinates(z) * self.white.weight))

    def _by_gradients(self, x: Array) -> Array:
        """The same by conjugate gradients; white noise takes one step."""
        z, left = x.copy(), -self._slope(x)
        way, size = left, float(left @ left)
        enough = SLOPE_TOLERANCE * size
        for _ in range(MAX_GRADIENT_STEPS):
            if size <= enough:
                break
            uphill = self._slope(way)
            pace = size / float(way @ uphill)
            z, left = z + pace * way, left - pace * uphill
            size, before = float(left @ left), size
            way = left + size / before * way
        return z


def _correlation(weight: Array) -> Array:
    """Half the sum of ``w_j^2 c_j^2 cos(omega_j d)`` over the ordinates, d from 0 to 2 n, shape (2 n + 1,).

    The product of two rows of the cosine transform, of samples i and k, is such a sum at ``i - k`` and at ``i + k + 1``.
    """
    n = weight.size
    power = weight**2 / n  # c_j^2 = 2 / n, half of it
    power[0] *= 0.5
    whole = np.zeros(2 * n)
    whole[:n] = power
    found = np.fft.rfft(whole).real
    return np.concatenate([found, found[-2::-1]])
