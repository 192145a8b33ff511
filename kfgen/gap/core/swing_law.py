"""By what law something swings: whether a resonance is noise through an oscillator, and whether a spectral line stays.

The likelihoods of the laws of `kfgen.gap.core.swing` are integrated over their numbers under one prior and compared; the
other laws share one probability, so that each more of them is not a further chance to be wrong. How often their odds are
large by chance is measured where they are asked for, in `kfgen.gap.rest.course`.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import NDArray

from kfgen.effects.process.population_monte_carlo import log_integral_about
from kfgen.effects.series import log_mean
from kfgen.gap.core.band import BAND, SPREAD_OF_A_RESONANCE, band_log_odds
from kfgen.gap.core.knocks import knocked
from kfgen.gap.core.swing import Swing

Array = NDArray[np.float64]

LIMIT_CYCLE = "it is a limit cycle of steady amplitude (breath, pump, hunting)"
KNOCKS = "it is knocked now and then and rings down (shocks)"
MODULATED_LINE = "it is a spectral line that comes and goes (a supply)"
KNOCKS_IN_A_FADE = (0.1, 0.6)
"""Mean numbers of knocks in the time in which a swing fades."""
WALK_IN_A_BLOCK_RAD2 = 0.25
"""Variance of the walk of a limit cycle's phase over one block."""
MIN_BLOCKS = 16
"""Of a record, however narrow the resonance is that a file states."""
MODULATED_SPREAD = (0.5, 0.2, 0.3)
"""The same of a modulated line, whose frequency is known to a part of the inverse record: of damping, size and phase [rad]."""
LINE_SPREAD = np.array([0.5, 0.2, 0.3])
"""The same of a line that may stay: of its frequency in bins, of the logarithm of its size, of its phase [rad]."""
REACH_DAMPINGS = 3.0
"""From the frequency, within which that of a modulated line is looked for."""
TRIALS_PER_BIN, TRIAL_PHASES = 1.5, 6
"""Its frequencies in a half cycle over the record, and its phases in half a turn."""
BLOCKS_OF_A_LINE = 256
"""Of a record, in which a spectral line is looked at that may come and go."""
CHANGES_IN_RECORD = (2.0, 4.0, 8.0, 16.0, 32.0)
"""Of such a line: lengths of the record over the time in which its amplitude is another."""
STEADY_SHARES = (0.0, 0.5)
"""Of the power of a line that comes and goes: it changes its sign; it is switched on for half the time."""


def other_law(z: Array, omega: float, damping: float, rms: float) -> tuple[str, float]:
    """Whether what has the spectrum of a resonance has one of the other laws: the likeliest, and how likely they all are.

    Parameters
    ----------
    z : ndarray, shape (n,)
        The record without the resonance in its model, white and of unit variance but for what swings.
    omega : float
        Frequency of the resonance [rad per sample].
    damping : float
        Its damping ratio.
    rms : float
        Its standard deviation, over that of the white noise beside it.

    Returns
    -------
    (str, float)
        The words of the likeliest, and the logarithm of the odds of all of them, each as likely as the others, over the
        resonance, which is as likely before as they are together [nats].
    """
    fade = damping * omega
    size = min(int(WALK_IN_A_BLOCK_RAD2 / (2.0 * fade)), z.size // MIN_BLOCKS)
    swing = Swing.of(z, omega, max(1, size))
    middle = np.array([0.0, np.log(fade), np.log(rms)])

    def log_of(law: Callable[[Array, Array, Array], Array]) -> float:
        return log_integral_about(
            lambda x: law(fade * x[:, 0], np.exp(x[:, 1]), np.exp(x[:, 2])), middle, SPREAD_OF_A_RESONANCE
        )

    own = log_of(swing.resonance)
    lines = [_modulated_line(swing, fade, rms, share) for share in STEADY_SHARES]
    knocks = [log_of(partial(knocked, swing, rate=rate)) for rate in KNOCKS_IN_A_FADE]
    odds = {
        LIMIT_CYCLE: log_of(swing.limit_cycle) - own,
        KNOCKS: log_mean(np.array(knocks)) - own,
        MODULATED_LINE: log_mean(np.array(lines)) - own,
        BAND: band_log_odds(z, omega, damping, rms),
    }
    return max(odds, key=lambda w: odds[w]), log_mean(np.array([*odds.values()]))


def comes_and_goes_log_odds(z: Array, omega: float, amplitude: float) -> float:
    """How likely it is that a spectral line comes and goes, over that it stays, both as likely before.

    Parameters
    ----------
    z : ndarray, shape (n,)
        The record without the line in its model, white and of unit variance but for the line.
    omega : float
        Frequency of the line [rad per sample].
    amplitude : float
        Of the line, over the standard deviation of the white noise beside it.

    Returns
    -------
    float
        The logarithm of the odds [nats].
    """
    swing = Swing.of(z, omega, max(1, z.size // BLOCKS_OF_A_LINE))
    rms = amplitude / np.sqrt(2.0)
    phase = np.arange(2 * TRIAL_PHASES) * np.pi / TRIAL_PHASES
    zero = np.zeros(phase.size)
    at = phase[int(np.argmax(swing.modulated_line(zero, zero, zero + rms, phase, 1.0)))]
    bin_width = np.pi / swing.samples
    middle = np.array([0.0, np.log(rms), at])

    def log_of(fade: float, steady: float) -> float:
        return log_integral_about(
            lambda x: swing.modulated_line(
                bin_width * x[:, 0], np.full(len(x), fade), np.exp(x[:, 1]), x[:, 2], steady
            ),
            middle,
            LINE_SPREAD,
        )

    goes = [log_of(k / swing.samples, STEADY_SHARES[1]) for k in CHANGES_IN_RECORD]
    return log_mean(np.array(goes)) - log_of(0.0, 1.0)


def _modulated_line(swing: Swing, fade: float, rms: float, steady: float) -> float:
    """Logarithm of the likelihood of a line of any phase, the frequency in dampings."""
    reach = REACH_DAMPINGS * fade
    count = int(np.ceil(2.0 * reach * swing.samples / np.pi * TRIALS_PER_BIN))
    walk, phase = np.meshgrid(
        np.linspace(-REACH_DAMPINGS, REACH_DAMPINGS, max(count, 2)),
        np.arange(TRIAL_PHASES) * np.pi / TRIAL_PHASES,
    )
    trials = np.column_stack(
        [walk.ravel(), np.full(walk.size, np.log(fade)), np.full(walk.size, np.log(rms)), phase.ravel()]
    )

    def law(x: Array) -> Array:
        return swing.modulated_line(fade * x[:, 0], np.exp(x[:, 1]), np.exp(x[:, 2]), x[:, 3], steady)

    best = trials[int(np.argmax(law(trials)))]
    spread = np.array([np.pi / (swing.samples * fade * 2.0 * TRIALS_PER_BIN), *MODULATED_SPREAD])

    def of_half_a_turn(x: Array) -> Array:
        return np.asarray(np.where(np.abs(x[:, 3] - best[3]) < 0.5 * np.pi, law(x), -1e9))

    return log_integral_about(of_half_a_turn, best, spread) - float(np.log(np.pi))
