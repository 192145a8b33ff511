"""A published or foreign Allan curve as evidence: no samples, weaker intervals."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from kfgen.core.errors import InputError
from kfgen.effects import Effect, Look
from kfgen.identify import words
from kfgen.identify.evidence.allan import AllanCurve, degrees_of_freedom
from kfgen.identify.evidence.record import Evidence, Peaks
from kfgen.identify.evidence.whittle import Ordinates

Array = NDArray[np.float64]

MIN_CURVE_POINTS = 8
"""Points that a published curve needs."""
MAX_DEGREES_OF_FREEDOM = 1000.0
"""Degrees of freedom that a point of a published curve is given at most: nobody says how it was made."""


@dataclass(frozen=True)
class Published(Evidence):
    """An Allan curve without its samples.

    Parameters
    ----------
    given : AllanCurve
    first : int
        Index of the first point that is fitted.
    """

    given: AllanCurve
    first: int = 0

    @property
    def dt(self) -> float:
        """The shortest averaging time [s]."""
        return float(self.given.tau[self.first])

    @property
    def lengths(self) -> tuple[int, ...]:
        """Samples that the longest averaging time needs at least: two of it."""
        return (int(np.ceil(2.0 * self.given.tau[-1] / self.dt)),)

    @property
    def step(self) -> float:
        """The shortest averaging time [s]."""
        return self.dt

    @property
    def scale(self) -> float:
        """The largest Allan deviation [SI]."""
        return float(self.given.deviation.max())

    @property
    def driven(self) -> Mapping[str, float]:
        """None."""
        return {}

    @property
    def curve(self) -> AllanCurve:
        """As it was given."""
        return self.given

    @property
    def octaves(self) -> AllanCurve:
        """Points about an octave apart."""
        g, at = self.given, self._octave_indices()
        return AllanCurve(g.tau[at], g.deviation[at], g.lo[at], g.hi[at], g.edf[at])

    @property
    def look(self) -> Look:
        """From the points that are fitted."""
        g = self.given
        return Look(g.tau[self.first :], g.deviation[self.first :], self.dt, self.longest, {})

    @property
    def words(self) -> str:
        """How much of what."""
        tau = self.given.tau
        return words.allan_curve(tau.size, float(tau[0]), float(tau[-1]))

    @staticmethod
    def of(tau: Array, deviation: Array, lo: Array | None = None, hi: Array | None = None) -> Published:
        """A curve from averaging times [s] and Allan deviations [SI], with its 95 % band where one is given.

        Parameters
        ----------
        tau : ndarray, shape (m,)
            Averaging times [s], increasing.
        deviation : ndarray, shape (m,)
            Allan deviation [SI].
        lo, hi : ndarray, shape (m,), optional
            Ends of its 95 % band [SI].

        Raises
        ------
        InputError
            Fewer than `MIN_CURVE_POINTS` points, or an Allan deviation that is not positive.
        """
        if tau.size < MIN_CURVE_POINTS:
            raise InputError(
                f"{tau.size} points are too few for a fit", remedy=f"Give at least {MIN_CURVE_POINTS}"
            )
        if not tau[0] > 0.0:
            raise InputError("an averaging time is not positive", remedy="Leave it out")
        if not ((deviation > 0.0) & np.isfinite(deviation)).all():
            raise InputError(
                "an Allan deviation is not positive", remedy="Give Allan deviations, not their logarithms"
            )
        if lo is not None and hi is not None and not ((lo > 0.0) & (lo < deviation) & (deviation < hi)).all():
            raise InputError(
                "the band does not enclose the Allan deviation",
                remedy="Name its lower end _lo and its upper end _hi",
            )
        if lo is not None and hi is not None:
            # The band of ln AVAR is 2 ln (hi / lo) wide, 3.92 standard deviations of sqrt(2 / edf).
            edf = 2.0 / np.maximum(2.0 * np.log(hi / lo) / 3.92, 1e-3) ** 2
            return Published(AllanCurve(tau, deviation, lo, hi, edf))
        m = tau / tau[0]
        slope = np.gradient(2.0 * np.log(deviation), np.log(tau))
        edf = np.minimum(degrees_of_freedom(int(np.ceil(2.0 * m[-1])), m, slope), MAX_DEGREES_OF_FREEDOM)
        spread = 1.96 * np.sqrt(0.5 / edf)
        return Published(
            AllanCurve(tau, deviation, deviation * np.exp(-spread), deviation * np.exp(spread), edf)
        )

    def falling(self) -> tuple[Published, float]:
        """From where on it falls as noise does, and the time [s] of that point, zero if it is the first.

        Noise falls steepest at the shortest times and is less steep with every octave. Where a curve
        begins flatter than it goes on, a low-pass or overlapped averages bend it; where its slope jumps
        more than quantisation on white noise does, it carries vibration.
        """
        at = self._octave_indices()
        slope = np.diff(np.log(self.given.deviation[at])) / np.diff(np.log(self.given.tau[at]))
        for i in range(max(slope.size - 2, 0)):
            steepest = slope[i + 1 : i + 8].min()
            if -1.1 < slope[i] <= steepest + 0.07 and slope[i + 1] <= _next_slope(float(slope[i])) + 0.1:
                return replace(self, first=int(at[i])), float(self.given.tau[at[i]]) if i else 0.0
        raise InputError(
            "the curve falls nowhere as white noise does",
            remedy="Give its shorter averaging times, or the log",
        )

    def _octave_indices(self) -> NDArray[np.int64]:
        """Points at least nearly an octave apart."""
        chosen = [self.first]
        for i, tau in enumerate(self.given.tau.tolist()):
            if i > self.first and tau >= 1.9 * self.given.tau[chosen[-1]]:
                chosen.append(i)
        return np.array(chosen)

    def ordinates(self, effects: Sequence[Effect], peaks: Peaks | None = None) -> Ordinates:
        """Raises `InputError`: a curve has no samples. See `Evidence.ordinates`."""
        raise InputError(
            "an Allan curve has no samples", remedy="Fit it with --method allan, or give the log"
        )


def _next_slope(slope: float) -> float:
    """The slope an octave on of quantisation on white noise: ``AVAR ~ (1 + r) / tau``, ``r ~ 1 / tau``."""
    slope = min(max(slope, -0.95), -0.5)
    r = 0.5 * (-2.0 * slope - 1.0) / (2.0 + 2.0 * slope)
    return -(1.0 + 2.0 * r) / (2.0 * (1.0 + r))
