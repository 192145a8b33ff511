"""What repeats without being a sine: harmonics are distinguished from lines that have nothing to do with each other."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from kfgen.effects import make
from kfgen.effects.noise_model import ChannelNoise, Term
from kfgen.gap.rest.channel_gap import channel_gap
from kfgen.gap.rest.comb import comb_of
from kfgen.gap.rest.comparison import ChannelGap
from kfgen.identify.evidence.record import Record
from kfgen.report.gap import sentences

T = 300.0


@pytest.mark.parametrize("orders", [(1, 2, 3, 4), (2, 9, 12, 19), (9, 12, 19, 22)])
def test_harmonics_have_their_fundamental(orders: tuple[int, ...]) -> None:
    """Each known to a tenth of the record's resolution, so that the fundamental is to a tenth over the lowest order."""
    rng = np.random.default_rng(1)
    f0 = 0.652
    f = [k * f0 + 0.1 / T * rng.uniform(-1.0, 1.0) for k in orders]
    assert comb_of(f, T) == pytest.approx(f0, abs=0.1 / T)


def test_other_lines_have_none() -> None:
    """Four lines at random up to 25 Hz in 1000 records: false alarms at no more than 1 %."""
    rng = np.random.default_rng(2)
    found = sum(comb_of(rng.uniform(0.1, 25.0, 4).tolist(), T) > 0.0 for _ in range(1000))
    assert found <= 10
    assert comb_of([1.0, 2.0, 3.0], T) == 0.0


def gap_of(y: NDArray[np.float64], dt: float) -> ChannelGap:
    assumed = ChannelNoise("rad/s", (Term(make("white_noise", N=np.sqrt(dt))),))
    return channel_gap("gyro_x", Record(np.arange(y.size) * dt, y), assumed)


@pytest.mark.long
def test_ticks_are_a_wave_that_is_up_for_one_sample() -> None:
    """Every 46th sample is off by 2.2 standard deviations of the noise: 22 lines of 21 nats each."""
    rng, n, dt = np.random.default_rng(3), 9000, 1.0 / 30.0
    gap = gap_of(rng.standard_normal(n) + 2.2 * (np.arange(n) % 46 == 7), dt)
    (found,) = gap.findings
    wave = found.effect
    assert wave.name == "periodic_wave"
    assert wave.period == pytest.approx(46 * dt, abs=dt * 46 / n)  # type: ignore[attr-defined]
    assert wave.size == pytest.approx(2.2, abs=4.5 / np.sqrt(n / 46))  # type: ignore[attr-defined]


@pytest.mark.long
def test_harmonics_of_no_trapezoid_are_called_unknown_with_their_period() -> None:
    """Four of them of one size and any phase, each of 200 nats."""
    rng, n, dt = np.random.default_rng(3), 9000, 1.0 / 30.0
    t = np.arange(n) * dt
    lines = [np.sin(2 * np.pi * k * 0.652 * t + p) for k, p in zip((2, 3, 5, 7), (0.3, 2.0, 4.4, 1.1))]
    gap = gap_of(rng.standard_normal(n) + 0.3 * np.sum(lines, axis=0), dt)
    assert gap.verdict == "unknown_effect"
    said = next(s for s in sentences(gap) if "harmonics" in s)
    fundamental = float(said.partition("harmonics of ")[2].partition(" Hz")[0])
    assert fundamental == pytest.approx(0.652, abs=0.1 / T)
    assert max(f.probability for f in gap.findings) <= 0.9
