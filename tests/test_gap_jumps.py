"""Proves that a Gauss-Markov bias is one, and that a bias that jumps or is kicked and fades is none.

The chain on a grid is exact: it is compared with a sum over all histories. Of 33 Gauss-Markov biases of 30 to 1000 nats
(other seeds) none has odds of jumps above 2 nats; of 12 biases of 100 nats that are kicked and fade all have.
"""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from in_part import in_part
from numpy.typing import NDArray
from scipy.signal import lfilter
from scipy.stats import norm

from kfgen.effects import make
from kfgen.effects.noise_model import ChannelNoise, Term
from kfgen.effects.process.stochastic import GaussMarkov
from kfgen.gap.core.jump_law import (
    ANY_LEVEL,
    FADING_KICKS,
    BiasNumbers,
    _any_level,
    _fading,
    _log_chain,
    jumps_log_odds,
)
from kfgen.gap.rest.channel_gap import as_written, channel_gap, series_of
from kfgen.gap.rest.course import LOG_ODDS_OF_ITS_OWN_LAW
from kfgen.identify.evidence.record import Record

Array = NDArray[np.float64]

N, DT, TAU_SAMPLES = 16384, 0.1, 80.0
T = DT * np.arange(N)
WHITE = make("white_noise", N=np.sqrt(DT))
BIAS = GaussMarkov(0.5, TAU_SAMPLES * DT)


def kicked(rng: np.random.Generator) -> Array:
    """A third of a kick in its time, of standard deviation 0.5."""
    kicks = (rng.random(N) < 0.3 / TAU_SAMPLES) * np.exp(0.5 * rng.standard_normal(N))
    x = lfilter([1.0], [1.0, -np.exp(-1.0 / TAU_SAMPLES)], kicks)
    return np.asarray(0.5 * x / x.std())


def any_level(rng: np.random.Generator) -> Array:
    """It jumps once in its time."""
    jumps = np.cumsum(rng.random(N) < 1.0 / TAU_SAMPLES)
    return np.asarray(0.5 * rng.standard_normal(int(jumps[-1]) + 1)[jumps])


def odds_of(y: Array) -> tuple[str, float]:
    return jumps_log_odds(series_of(as_written(Record(T, y), (WHITE,))), BIAS)


def test_likelihood_of_a_chain_is_the_sum_over_all_histories() -> None:
    x, y = np.array([-1.0, 0.2, 0.9]), np.array([0.4, -1.0, 0.7, 1.2])
    move = np.array([[0.8, 0.15, 0.05], [0.1, 0.7, 0.2], [0.3, 0.3, 0.4]])
    start = np.linalg.matrix_power(move, 200)[0]
    seen = norm.pdf(y[:, None], x, 0.7)
    wanted = sum(
        start[a] * move[a, b] * move[b, c] * move[c, d] * seen[0, a] * seen[1, b] * seen[2, c] * seen[3, d]
        for a, b, c, d in product(range(3), repeat=4)
    )
    assert _log_chain(y, 0.49, x, [move]) == pytest.approx([np.log(wanted)], rel=1e-9)


@pytest.mark.parametrize("law", ["any level", "kicks"])
def test_chains_have_the_variance_and_the_memory_of_the_bias(law: str) -> None:
    """Of the grid's law in the long run, and of one step: a twelfth of the time makes exp(-1 / 12)."""
    bias = BiasNumbers(0.5, 12.0)
    x = np.linspace(-4.0, 4.0, 400)
    move = _any_level(x, bias) if law == "any level" else _fading(x, bias, 0.5)
    assert move.sum(axis=1) == pytest.approx(1.0)
    p = np.linalg.matrix_power(move, 4096)[0]
    mean, variance = float(p @ x), float(p @ x**2 - (p @ x) ** 2)
    assert mean == pytest.approx(0.0, abs=0.03)
    assert np.sqrt(variance) == pytest.approx(0.5, rel=0.05)
    memory = float((p * x) @ move @ x - mean**2) / variance
    assert memory == pytest.approx(np.exp(-1.0 / 12.0), rel=0.02)


@pytest.mark.long
def test_a_gauss_markov_bias_is_one() -> None:
    for seed in range(3):
        rng = np.random.default_rng([29, seed])
        assert odds_of(rng.standard_normal(N) + BIAS.simulate(T, rng))[1] < 0.0


@pytest.mark.parametrize(
    ("words", "sign"), in_part([(FADING_KICKS, 1.0), (FADING_KICKS, -1.0), (ANY_LEVEL, 1.0)])
)
def test_a_bias_that_jumps_is_none(words: str, sign: float) -> None:
    for seed in range(2):
        rng = np.random.default_rng([31, seed])
        course = kicked(rng) if words == FADING_KICKS else any_level(rng)
        said, odds = odds_of(rng.standard_normal(N) + sign * course)
        assert said == words
        assert odds > LOG_ODDS_OF_ITS_OWN_LAW


def test_beside_other_slow_noise_nothing_is_said() -> None:
    rng = np.random.default_rng(33)
    walk = make("rate_random_walk", K=0.05)
    series = series_of(as_written(Record(T, rng.standard_normal(N) + walk.simulate(T, rng)), (WHITE, walk)))
    assert jumps_log_odds(series, BIAS) == ("", -np.inf)


@pytest.mark.long
def test_doors_that_open_are_no_certain_gauss_markov_bias() -> None:
    """The name stands in for something else, and the sentence says for what."""
    rng = np.random.default_rng(35)
    gap = channel_gap(
        "gyro_x", Record(T, rng.standard_normal(N) + 0.6 * kicked(rng)), ChannelNoise("rad/s", (Term(WHITE),))
    )
    assert gap.verdict == "unknown_effect"
    assert all(f.probability < 0.5 for f in gap.findings)
