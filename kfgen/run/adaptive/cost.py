"""What a filter takes away, and what it costs under motion.

A static log cannot tell a good filter from one that scales everything by a thousandth: noise and rotation shrink
alike. Beside the Allan deviation before and after stands therefore what a step of the rate becomes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kfgen.effects.process.stochastic import FLICKER_FLOOR_OVER_B
from kfgen.identify.evidence.allan import AllanCurve, allan_curve
from kfgen.identify.methods.asymptotes import KNOWN
from kfgen.run import words
from kfgen.run.adaptive.loop import Filtered, ScalarModel, run_filter
from kfgen.run.adaptive.rules import Rule

Array = NDArray[np.float64]

STEP = 20.0
"""Standard deviations of the channel: the step of the rate that is put on it."""
HIDDEN = 0.5
"""The same for a rate that noise hides: an adaptive filter may keep the one and lose the other."""
FULL = 0.9
"""Share of a constant rate below which a filter takes the signal away."""
SAME = 0.25
"""Relative difference below which two reductions are the same."""
GRID = 4000
"""Frequencies at which a filter's response is looked at."""


@dataclass(frozen=True)
class Noise:
    """Noise of a channel read off its Allan deviation [U, s].

    Parameters
    ----------
    N : float
        Allan deviation at one second (or the nearest time) times the root of it [U/sqrt(Hz)].
    B : float
        Lowest point by 0.664 [U].
    drift : float
        Standard deviation of the means of ten seconds (or of a tenth of the record) [U].
    curve : AllanCurve
    """

    N: float
    B: float
    drift: float
    curve: AllanCurve


@dataclass(frozen=True)
class FilterCost:
    """What happens to a true rate.

    Parameters
    ----------
    dc : float
        What a constant rate of `STEP` standard deviations of the channel becomes, as a share of it.
    hidden : float
        The same of one of `HIDDEN` standard deviations.
    delay : float
        Time [s] from a step to half of its final response.
    bandwidth : float
        Where the response at the mean gain falls to ``1 / sqrt 2`` of its value at zero [Hz]; half the rate where it
        never does.
    attenuation : float
        Allan deviation after by before, at the longest times that are well known.
    """

    dc: float
    hidden: float
    delay: float
    bandwidth: float
    attenuation: float

    @property
    def words(self) -> str:
        """What kind of filter it is."""
        if self.dc < FULL:
            alike = abs(self.attenuation / max(self.dc, 1e-300) - 1.0) < SAME
            return words.suppresses_motion(self.dc, alike)
        if self.hidden < FULL:
            return words.scales_small_rates(self.hidden)
        if self.attenuation > 1.0 - SAME:
            return words.only_low_passes(self.delay)
        return words.lowers_slow_noise(self.attenuation)


def noise_of(y: Array, dt: float) -> Noise:
    """The noise of samples [U], shape (n,), `dt` [s] apart."""
    curve = allan_curve(y, dt)
    known = curve.edf >= min(KNOWN, float(curve.edf.max()))
    at = int(np.argmin(np.abs(np.log(curve.tau))))
    block = max(1, min(round(10.0 / dt), y.size // 10))
    means = y[: y.size // block * block].reshape(-1, block).mean(axis=1)
    return Noise(
        float(curve.deviation[at] * np.sqrt(curve.tau[at])),
        float(curve.deviation[known].min()) / FLICKER_FLOOR_OVER_B,
        float(means.std()),
        curve,
    )


def response(model: ScalarModel, gain: Array, omega: Array) -> NDArray[np.complex128]:
    """What the filter at a constant gain makes of ``exp(i omega k)``, shape (m,), ``omega`` in rad/sample."""
    kept = (np.eye(gain.size) - np.outer(gain, model.H)) @ model.A
    z = np.exp(1j * np.asarray(omega))[:, None, None]
    return np.asarray(np.linalg.solve(np.eye(gain.size) - kept / z, gain[None, :, None])[:, :, 0] @ model.H)


def bandwidth(model: ScalarModel, gain: Array, dt: float) -> float:
    """Where the response falls to ``1 / sqrt 2`` of its value at zero [Hz]."""
    omega = np.concatenate([[0.0], np.geomspace(1e-6, np.pi, GRID)])
    size = np.abs(response(model, gain, omega))
    below = np.flatnonzero(size < size[0] / np.sqrt(2.0))
    return float((omega[below[0]] if below.size else np.pi) / (2.0 * np.pi * dt))


def cost_of(
    z: Array, dt: float, model: ScalarModel, rule: type[Rule], window: int, found: Filtered
) -> FilterCost:
    """The cost of a filter on a channel: the same record once more with a step of the rate in its middle.

    Parameters
    ----------
    z : ndarray, shape (n,)
        Samples about zero [U], finite.
    found : Filtered
        The filter on them.
    """
    half, deviation = z.size // 2, float(np.std(z))

    def change(size: float) -> Array:
        stepped = z + size * (np.arange(z.size) >= half)
        return (run_filter(stepped, model, rule, window).estimate - found.estimate)[half:] / size

    step, small = change(STEP * deviation), change(HIDDEN * deviation)
    last = slice(-max(1, step.size // 4), None)
    dc = float(step[last].mean())
    late = np.flatnonzero(np.abs(step) >= 0.5 * abs(dc))
    before, after = noise_of(z, dt), noise_of(found.estimate, dt)
    known = before.curve.edf >= min(KNOWN, float(before.curve.edf.max()))
    longest = np.flatnonzero(known)[-3:]
    ratio = np.exp(np.mean(np.log(after.curve.deviation[longest] / before.curve.deviation[longest])))
    delay = float(late[0]) * dt if late.size else float(step.size) * dt
    return FilterCost(dc, float(small[last].mean()), delay, bandwidth(model, found.gain, dt), float(ratio))
