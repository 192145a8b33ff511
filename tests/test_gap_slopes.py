"""Proves that noise flatter or steeper than flicker is named so, with its slope, and that flicker keeps its name."""

from __future__ import annotations

import numpy as np
import pytest
from in_part import in_part
from numpy.typing import NDArray

from kfgen.effects import Effect, make
from kfgen.effects.noise_model import ChannelNoise, Term
from kfgen.effects.process.power_law import PowerLawNoise
from kfgen.gap.core.result import Gap
from kfgen.gap.rest.channel_gap import channel_gap
from kfgen.identify.evidence.record import Record
from kfgen.identify.fit.fit import Prior, Problem

Array = NDArray[np.float64]

DT = 0.1


def sloped(seed: int, slope: float, n: int = 12000, size: float = 1.0) -> Record:
    """White noise of N = 0.1 and noise of spectrum ``size^2 w^-slope`` up to half the sampling rate, in rad/s."""
    rng, m = np.random.default_rng([31, seed]), 4 * n
    w = 2.0 * np.pi * np.fft.rfftfreq(m, DT)
    w[0] = np.inf
    X = np.fft.rfft(rng.standard_normal(m)) * w ** (-0.5 * slope) * size / np.sqrt(DT)
    white = rng.standard_normal(n) * 0.1 / np.sqrt(DT)
    return Record(np.arange(n) * DT, white + np.fft.irfft(X, m)[:n])


def gap_of(record: Record) -> Gap:
    return channel_gap("gyro_z", record, ChannelNoise("rad/s", (Term(make("white_noise", N=0.1)),)))


@pytest.mark.long
@pytest.mark.parametrize(("slope", "size"), in_part([(0.5, 0.1), (1.5, 0.05)]))
def test_noise_of_a_slope_is_named_with_it(slope: float, size: float) -> None:
    """Of several hundred nats. Noise of half a slope was once a Gauss-Markov bias, at 100 %."""
    gap = gap_of(sloped(1, slope, size=size))
    (found,) = gap.findings
    assert found.effect.name == "power_law_noise"
    lo, hi = found.ci95["slope"]
    assert lo < slope < hi
    assert hi - lo < 0.5


@pytest.mark.long
def test_flicker_keeps_its_name() -> None:
    """Up to half the sampling rate it is flicker: a bank that began ten samples slower had lost to a slope of 0.85."""
    (found,) = gap_of(sloped(2, 1.0, size=0.06)).findings
    assert found.effect.name == "bias_instability"
    assert found.effect.shortest == pytest.approx(DT)


@pytest.mark.parametrize(("start", "between"), [(0.5, (0.3, 0.85)), (1.0, (0.3, 0.85)), (1.5, (1.2, 1.8))])
def test_a_slope_is_looked_for_in_the_range_of_its_start(start: float, between: tuple[float, float]) -> None:
    """Its interval may leave the range: from the flattest slope of all to nearly that of a random walk."""
    effects: tuple[Effect, ...] = (PowerLawNoise(1.0, start),)
    problem = Problem(sloped(3, 1.0, n=200), effects)
    assert np.exp(problem.box((0, "slope"))) == pytest.approx(between)
    assert np.exp(problem.reach((0, "slope"))) == pytest.approx((0.3, 1.99))


@pytest.mark.parametrize("slope", [0.5, 1.42, 1.995])
def test_a_wide_interval_of_a_slope_ends_where_noise_is_a_walk(slope: float) -> None:
    """A file that states 0.56 to 1.99: a fit that went beyond 2 had ended the command with an error."""
    wide = {(0, "slope"): Prior(np.log(slope), 0.33)}
    lo, hi = np.exp(Problem(sloped(3, 1.0, n=200), (PowerLawNoise(1.0, slope),), wide).box((0, "slope")))
    assert 0.0 < lo < slope <= hi <= max(slope, 1.99)
