"""Proves that noise of a band with edges is no resonance, and that a resonance is no noise of a band."""

from __future__ import annotations

import numpy as np
import pytest
from in_part import in_part
from numpy.typing import NDArray
from scipy.fft import idct
from scipy.signal import butter, sosfilt

from kfgen.effects import make
from kfgen.effects.noise_model import ChannelNoise, Term
from kfgen.gap.core.band import BAND, band_log_odds
from kfgen.gap.core.thresholds import MAX_PROBABILITY_OF_STAND_IN
from kfgen.gap.rest.channel_gap import channel_gap
from kfgen.gap.rest.course import LOG_ODDS_OF_ITS_OWN_LAW
from kfgen.identify.evidence.record import Record

Array = NDArray[np.float64]

N = 8192
OMEGA = 0.4


def octave(rng: np.random.Generator) -> Array:
    """Noise of an octave about `OMEGA`, with steep edges, of unit variance."""
    edges = np.array([OMEGA, 2.0 * OMEGA]) / np.sqrt(2.0)
    x = sosfilt(butter(4, edges / np.pi, "band", output="sos"), rng.standard_normal(2 * N))[N:]
    return np.asarray(x / x.std())


def resonance(rng: np.random.Generator, damping: float) -> Array:
    """Ordinates of the spectrum of a driven oscillator, of unit variance."""
    w = np.pi * np.arange(1, N) / N
    S = 1.0 / ((OMEGA**2 - w**2) ** 2 + (2.0 * damping * OMEGA * w) ** 2)
    X = rng.standard_normal(N - 1) * np.sqrt(S / S.mean())
    return np.asarray(idct(np.concatenate([[0.0], X]), norm="ortho"))


@pytest.mark.parametrize("seed", in_part(range(3)))
def test_noise_of_a_band_and_resonances_are_distinguished(seed: int) -> None:
    """Of 100 nats or more: of 16 of other seeds 14 bands have odds above 2 nats, of 32 resonances none."""
    rng = np.random.default_rng([41, seed])
    white = rng.standard_normal((3, N))
    assert band_log_odds(white[0] + 0.4 * octave(rng), OMEGA, 0.18, 0.4) > LOG_ODDS_OF_ITS_OWN_LAW
    for damping, z in ((0.03, white[1]), (0.2, white[2])):
        assert band_log_odds(z + 0.4 * resonance(rng, damping), OMEGA, damping, 0.4) < 0.0


@pytest.mark.long
def test_noise_of_a_band_is_no_certain_resonance() -> None:
    """Once a resonance at 100 %, verdict "effects_found"."""
    rng, dt = np.random.default_rng(44), 0.05
    y = rng.standard_normal(N) + 0.3 * octave(rng)
    noise = ChannelNoise("rad/s", (Term(make("white_noise", N=np.sqrt(dt))),))
    gap = channel_gap("gyro_x", Record(dt * np.arange(N), y), noise)
    assert gap.verdict == "unknown_effect"
    assert gap.findings[0].effect.name == "resonance"
    assert gap.findings[0].objection == BAND
    assert gap.findings[0].probability <= MAX_PROBABILITY_OF_STAND_IN
