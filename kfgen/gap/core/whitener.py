"""White again: a channel over the square root of its noise's spectrum.

The cosine transform (type II) of evenly sampled noise has independent coefficients of variance
``S(omega_j)``, ``omega_j = pi j / n``; it is the sine transform of the differences, see
`kfgen.identify.evidence.whittle`, divided by ``-2 sin(omega_j / 2)``. Over ``sqrt(S)`` they are unit normal deviates, and
everything linear (a regressor, a sensitivity) is treated alike. Transformed back they are a series in
time, in which an event stays where it was: the whitening has no phase.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kfgen.effects import Effect, sampled_spectrum
from kfgen.effects.samples.filtered_spectrum import is_passed
from kfgen.identify.evidence.record import Record

Array = NDArray[np.float64]

DENSITY_GRID_POINTS = 512
"""Frequencies at which a density is computed; between them it is interpolated."""
SAMPLES_ABOUT_AN_END = 1024
"""Of a record that stands for the ends of longer ones."""
MAX_RISE_OF_VARIANCE = 0.1
"""By which the variance of a whitened sample may exceed one."""


@dataclass(frozen=True)
class Whitener:
    """Divides by the square root of a noise's density.

    Parameters
    ----------
    weight : ndarray, shape (n,)
        ``1 / sqrt(S)`` by ordinate [1/SI]; the first belongs to the constant.
    """

    weight: Array

    @staticmethod
    def on(record: Record, effects: Sequence[Effect]) -> Whitener:
        """For the random ones among effects of a record; see `of`."""
        return Whitener.of(effects, record.n, record.dt / record.averaged, averaged=record.averaged)

    @staticmethod
    def of(
        effects: Sequence[Effect], n: int, dt: float, *, constant: bool = False, averaged: int = 1
    ) -> Whitener:
        """For the random ones among effects of a channel of n samples, or of n means of samples.

        Parameters
        ----------
        effects : sequence of Effect
        n : int
            Samples, or means.
        dt : float
            Sampling period [s].
        constant : bool
            Whether the constant counts; else its weight is zero.
        averaged : int
            Samples in each mean.
        """
        omega: Array = np.array(np.arange(1, n) * (np.pi / n), dtype=np.float64)
        grid = omega
        if n > 2 * DENSITY_GRID_POINTS:
            grid = np.array(np.geomspace(omega[0], omega[-1], DENSITY_GRID_POINTS), dtype=np.float64)
        S = np.maximum(sampled_spectrum(effects, grid, dt, averaged, n), np.finfo(float).tiny)
        if grid.size < omega.size:
            S = np.exp(np.interp(np.log(omega), np.log(grid), np.log(S)))
        passed = is_passed(effects, omega, dt, averaged, n)
        return Whitener(np.concatenate([[1.0 / np.sqrt(S[0]) if constant else 0.0], passed / np.sqrt(S)]))

    def ends(self, effects: Sequence[Effect], dt: float) -> int:
        """Samples at either end that are not white again, because a record does not go on beyond them.

        A cosine transform mirrors the record at its ends, where its slope jumps; what a filter holds back is then
        above the little that it lets pass.

        Parameters
        ----------
        effects : sequence of Effect
            Of which the weight was made.
        dt : float
            Sampling period [s].

        Returns
        -------
        int
            Zero without an effect that filters.
        """
        from scipy.fft import dctn, idctn, irfft
        from scipy.linalg import toeplitz

        fast = [e for e in effects if not e.form().order or e.is_filter]
        if not any(e.is_filter for e in fast):
            return 0
        m, n = min(SAMPLES_ABOUT_AN_END, self.weight.size), self.weight.size
        omega = np.maximum(np.linspace(0.0, np.pi, 2 * m + 1), 1e-6 / m)
        gamma = irfft(sampled_spectrum(fast, omega, dt))[:m]
        w = np.interp(np.arange(m) / m, np.arange(n) / n, self.weight)
        variance = np.diag(idctn(np.outer(w, w) * dctn(toeplitz(gamma), norm="ortho"), norm="ortho"))
        # Where a filter stops, unit deviates are drawn, which are white up to the ends.
        drawn = float(np.mean(self.weight[1:] <= 0.0))
        high = np.flatnonzero(variance[: m // 4] + drawn > 1.0 + MAX_RISE_OF_VARIANCE)
        return int(high[-1]) + 1 if high.size else 0

    def ordinates(self, x: Array) -> Array:
        """Whitened cosine coefficients, shape (n, ...), of samples along the first axis."""
        from scipy.fft import dct

        X = dct(np.asarray(x, dtype=np.float64), type=2, axis=0, norm="ortho")
        return np.asarray(X * self.weight.reshape(-1, *(1,) * (X.ndim - 1)))

    def series(self, x: Array) -> Array:
        """The whitened series in time, shape (n, ...)."""
        return self.back(self.ordinates(x))

    @staticmethod
    def back(ordinates: Array) -> Array:
        """From coefficients to time."""
        from scipy.fft import idct

        return np.asarray(idct(ordinates, type=2, axis=0, norm="ortho"))
