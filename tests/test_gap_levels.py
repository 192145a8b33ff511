"""Proves that a telegraph of two levels is one, and that a bias that jumps to any level is none.

Where there is no slow noise the recursion is exact: it is compared with a sum over all histories. Of 32 telegraphs of other
seeds, of sizes from 0.35 to 1.2 standard deviations of a sample, none has odds of many levels above 2 nats.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from in_part import in_part
from numpy.typing import NDArray
from scipy.stats import norm

from kfgen.effects import make
from kfgen.effects.noise_model import ChannelNoise, Term
from kfgen.effects.process.switching_level import Slow, Switching, SwitchingParameters
from kfgen.effects.process.telegraph import Cells
from kfgen.gap.core.level_law import MANY_LEVELS, many_levels_log_odds
from kfgen.gap.rest.channel_gap import as_written, channel_gap, series_of
from kfgen.gap.rest.course import LOG_ODDS_OF_ITS_OWN_LAW
from kfgen.identify.evidence.record import Record

Array = NDArray[np.float64]

N, DT = 8192, 0.1
WHITE = make("white_noise", N=np.sqrt(DT))


def any_level(rng: np.random.Generator, dwell: float) -> Array:
    """A bias that jumps to any level and stays there; half the standard deviation of a telegraph of unit size."""
    jumps = np.cumsum(rng.random(N) < 2.0 * DT / dwell)
    return np.asarray(0.5 * rng.standard_normal(int(jumps[-1]) + 1)[jumps])


def test_likelihood_of_three_levels_is_the_sum_over_all_histories() -> None:
    levels, stay = np.array([-0.7, 0.1, 0.6]), float(np.exp(-2.0 * 0.5 / 3.0))
    y = np.array([0.4, -1.0, 0.7, 2.0])
    T = stay * np.eye(3) + (1.0 - stay) / 3.0
    seen = norm.pdf(y[:, None], 0.2 + 1.5 * levels, 0.8 * 1.1)
    wanted = 0.0
    for a, b, c, d in product(range(3), repeat=4):
        wanted += seen[0, a] * T[a, b] * seen[1, b] * T[b, c] * seen[2, c] * T[c, d] * seen[3, d] / 3.0
    switching = Switching(y, 0.5, 0.8, Slow.of((), 0.5), levels)
    at = SwitchingParameters(*np.array([[1.5], [3.0], [0.2], [1.1], [1.0]]))
    assert switching.log_likelihood(at) == pytest.approx([np.log(wanted)], rel=1e-9)


@pytest.mark.long
@pytest.mark.parametrize("size", in_part([0.6, 1.0]))
def test_two_levels_and_many(size: float) -> None:
    for seed in range(2):
        rng = np.random.default_rng([18, seed])
        white, telegraph = rng.standard_normal(N), make("random_telegraph", size=size, dwell=15.0)
        odds = [
            many_levels_log_odds(
                series_of(as_written(Record(DT * np.arange(N), white + y), (WHITE,))), telegraph
            )
            for y in (telegraph.simulate(DT * np.arange(N), rng), size * any_level(rng, 15.0))
        ]
        assert odds[0] < 0.0
        assert odds[1] > LOG_ODDS_OF_ITS_OWN_LAW


@pytest.mark.long
def test_a_bias_of_many_levels_is_no_certain_telegraph() -> None:
    """Where one is found for it: the sentence says what speaks against it."""
    rng = np.random.default_rng(23)
    y = rng.standard_normal(N) + 0.35 * any_level(rng, 60.0)
    gap = channel_gap("gyro_x", Record(DT * np.arange(N), y), ChannelNoise("rad/s", (Term(WHITE),)))
    assert gap.verdict == "unknown_effect"
    assert [(f.effect.name, f.objection) for f in gap.findings] == [("random_telegraph", MANY_LEVELS)]


@pytest.mark.long
def test_slow_noise_beside_two_levels_is_weighed_with_them() -> None:
    """A telegraph and a Gauss-Markov bias that are true are likelier together than many levels are."""
    rng, t = np.random.default_rng(3), DT * np.arange(N)
    telegraph, bias = (
        make("random_telegraph", size=1.0, dwell=15.0),
        make("gauss_markov", sigma=0.4, tau=30.0),
    )
    record = Record(t, rng.standard_normal(N) + telegraph.simulate(t, rng) + bias.simulate(t, rng))
    beside, alone = (series_of(as_written(record, e)) for e in ((WHITE, bias), (WHITE,)))
    assert many_levels_log_odds(beside, telegraph, alone) < 0.0
    assert many_levels_log_odds(alone, telegraph) > 0.0  # what the test would say without the bias


def test_a_line_at_the_bottom_of_the_spectrum_is_no_end() -> None:
    """Where the lowest ordinate is left out of the likelihood, as of a rest of a flight, the next one tells the level."""
    series = series_of(
        as_written(Record(DT * np.arange(N), np.random.default_rng(3).standard_normal(N)), (WHITE,))
    )
    weight = series.weight.copy()
    weight[1] = 0.0
    assert Cells.of(replace(series, weight=weight)).still == pytest.approx(1.0 / (series.weight[2] * N**0.5))
