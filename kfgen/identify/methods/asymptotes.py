"""N, B and K read off the asymptotes of the Allan plot, by rule instead of by eye.

N where the curve falls with slope -1/2, K where it rises with +1/2 behind its minimum, B from its minimum.
Each asymptote is the weighted mean of the points whose local slope is near enough.

The minimum is no reading of B where N and K alone make one as low: two lines that cross do have a lowest point
(at the values of [1]_, sec. 2.2, it lies at its "estimate" of B).

References
----------
.. [1] E. M. Hemerly, MEMS IMU stochastic error modelling, Systems Science & Control Engineering 5(1), 2017,
   secs 2.2, 3 (remark 3.4), 4.
.. [2] IEEE Std 952-1997, annex C.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kfgen.core.errors import InputError
from kfgen.effects import Effect, make
from kfgen.effects.process.stochastic import FLICKER_FLOOR_OVER_B
from kfgen.identify.evidence.allan import AllanCurve
from kfgen.identify.evidence.record import Evidence
from kfgen.identify.fit.estimate import Estimate
from kfgen.identify.methods.series import stated

Array = NDArray[np.float64]

NEAR = 0.25
"""How far a local slope may be from its asymptote's."""
LEAST = 2
"""Points that make a slope."""
LEVEL, FLAT = 0.15, 6
"""Slope of a floor, and points (half a decade) that it spans where the curve does not rise behind it."""
SHORTEST = 4
"""Points that a curve has."""
SEEN = 2.0
"""Degrees of freedom that a point of a slope has."""
KNOWN = 8.0
"""Degrees of freedom below which a point is too uncertain to be the lowest: of many, one is low by chance."""
BY_CHANCE = 2.0
"""Standard deviations by which a floor must lie above that of N and K to be one of its own."""
SHORT = 6000
"""Samples of which a variance is white noise, remark 3.4 of [1]_."""


@dataclass(frozen=True)
class Asymptote:
    """A size read off a curve [SI], its relative standard deviation, and the averaging times [s] that it was read from."""

    size: float
    deviation: float
    tau: tuple[float, float]


@dataclass(frozen=True)
class AsymptoteReading:
    """What the asymptotes show; None where a curve has no such slope.

    Parameters
    ----------
    N, K : Asymptote, optional
    B : Asymptote
        The floor by 0.664.
    crossing : float
        The lowest point [SI] that N and K alone give on the same averaging times; where the curve does not
        rise, with the walk through its last point; zero without N.
    flat : int
        Well known points at which the curve is level.
    """

    N: Asymptote | None
    B: Asymptote
    K: Asymptote | None
    crossing: float
    flat: int

    @property
    def B_is_own(self) -> bool:
        """Whether the floor lies above what N and K alone give; without a rise it must be level for long."""
        if self.K is None and self.flat < FLAT:
            return False
        return self.B.size * FLICKER_FLOOR_OVER_B > self.crossing * (1.0 + BY_CHANCE * self.B.deviation)


def read_asymptotes(curve: AllanCurve) -> AsymptoteReading:
    """Read N, B and K off an Allan curve, where it is known well enough; raises `InputError` for too few points."""
    seen = curve.edf >= min(SEEN, float(curve.edf.max()))
    parts = (curve.tau, curve.deviation, curve.lo, curve.hi, curve.edf)
    curve = AllanCurve(*(v[seen] for v in parts))
    if curve.tau.size < SHORTEST:
        raise InputError("the Allan curve has too few points to read", remedy="Give a longer log")
    slope = np.gradient(np.log(curve.deviation), np.log(curve.tau))
    known = curve.edf >= min(KNOWN, float(curve.edf.max()))
    lowest = int(np.argmin(np.where(known, curve.deviation, np.inf)))
    at = np.arange(curve.tau.size)
    N = _asymptote(curve, make("white_noise", N=1.0), (np.abs(slope + 0.5) < NEAR) & (at <= lowest))
    K = _asymptote(curve, make("rate_random_walk", K=1.0), (np.abs(slope - 0.5) < NEAR) & (at > lowest))
    tau = float(curve.tau[lowest])
    B = Asymptote(
        float(curve.deviation[lowest]) / FLICKER_FLOOR_OVER_B,
        float(np.sqrt(0.5 / curve.edf[lowest])),
        (tau, tau),
    )
    flat = int(np.sum(known & (np.abs(slope) < LEVEL)))
    return AsymptoteReading(N, B, K, _crossing(curve, N, K), flat)


def _asymptote(curve: AllanCurve, unit: Effect, near: NDArray[np.bool_]) -> Asymptote | None:
    """The size of an effect that goes through the points of its slope, weighted by their degrees of freedom."""
    if near.sum() < LEAST:
        return None
    tau, edf = curve.tau[near], curve.edf[near]
    logs = np.log(curve.deviation[near]) - 0.5 * np.log(unit.allan_variance(tau))
    size = float(np.exp(np.average(logs, weights=edf)))
    # Neighbouring points are hardly independent: the best of them says what is known.
    return Asymptote(size, float(np.sqrt(0.5 / edf.max())), (float(tau[0]), float(tau[-1])))


def walk_through_end(curve: AllanCurve) -> float:
    """K [U/sqrt(s)] of the random walk that reaches the last point of a curve: no more of it can act."""
    unit = make("rate_random_walk", K=1.0).allan_variance(curve.tau[-1:])
    return float(curve.deviation[-1] / np.sqrt(unit[0]))


def _crossing(curve: AllanCurve, N: Asymptote | None, K: Asymptote | None) -> float:
    if N is None:
        return 0.0
    walk = K.size if K else walk_through_end(curve)
    both = make("white_noise", N=N.size), make("rate_random_walk", K=walk)
    return float(np.sqrt(np.min(sum(e.allan_variance(curve.tau) for e in both))))


def short_white(y: Array, dt: float, count: int = SHORT) -> float:
    """N [U/sqrt(Hz)] from the variance of the first samples, remark 3.4 of [1]_.

    Parameters
    ----------
    y : ndarray, shape (n,)
    dt : float
        Sampling period [s].
    count : int
        So few that slow noises hardly move.
    """
    return float(np.std(y[:count]) * np.sqrt(dt))


def by_asymptotes(record: Evidence, wanted: Sequence[str] | None) -> Estimate:
    """The asymptotes of the Allan plot as effects; what the plot does not show is said.

    Parameters
    ----------
    record : Evidence
        What is identified.
    wanted : sequence of str or None
        Exactly these effects; chosen by the data when None.
    """
    seen = read_asymptotes(record.curve)
    parts: dict[str, tuple[Effect, Asymptote]] = {}
    said = []
    if seen.N:
        parts["white_noise"] = make("white_noise", N=seen.N.size), seen.N
    if seen.K:
        parts["rate_random_walk"] = make("rate_random_walk", K=seen.K.size), seen.K
    if seen.B_is_own:
        band = (10.0 * record.step, record.longest)
        flicker = make("bias_instability", B=seen.B.size, shortest=band[0], longest=band[1])
        parts["bias_instability"] = flicker, seen.B
    elif not wanted or "bias_instability" in wanted:
        said.append(
            "the lowest point of the curve is where N and K cross: it is no reading of a bias instability, left out"
        )
    for name, asymptote in (("white_noise", seen.N), ("rate_random_walk", seen.K)):
        if asymptote is None and (not wanted or name in wanted):
            said.append(f"no part of the curve has the slope of {name}, left out")
    chosen = [parts[n] for n in (wanted or parts) if n in parts]
    if not chosen:
        raise InputError(
            "the Allan curve shows no asymptote of the wanted effects", remedy="Use --method allan or ml"
        )
    return stated(record, [e for e, _ in chosen], said, np.diag([a.deviation**2 for _, a in chosen]))
