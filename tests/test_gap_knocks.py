"""Proves that what is knocked now and then is no resonance: by a likelihood that is a sum over all histories of knocks."""

from __future__ import annotations

from itertools import pairwise, product

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import lfilter
from scipy.stats import multivariate_normal

from kfgen.effects import make
from kfgen.effects.noise_model import ChannelNoise, Term
from kfgen.gap.core.knocks import knocked
from kfgen.gap.core.swing import Swing
from kfgen.gap.core.swing_law import KNOCKS, other_law
from kfgen.gap.core.thresholds import MAX_PROBABILITY_OF_STAND_IN
from kfgen.gap.rest.channel_gap import channel_gap
from kfgen.gap.rest.course import LOG_ODDS_OF_ITS_OWN_LAW
from kfgen.identify.evidence.record import Record

Array = NDArray[np.float64]


def rung(rng: np.random.Generator, n: int, frequency: float, count: float) -> Array:
    """Knocks of either sign at any time that ring down over three cycles, some harder than others; of unit variance."""
    hit = (rng.random(n) < count / n) * rng.choice([-1.0, 1.0], n) * np.exp(0.5 * rng.standard_normal(n))
    w, fade = 2.0 * np.pi * frequency, np.exp(-frequency / 3.0)
    x = lfilter([0.0, fade * np.sin(w)], [1.0, -2.0 * fade * np.cos(w), fade**2], hit)
    return np.asarray(x / x.std())


def test_likelihood_of_knocks_is_the_sum_over_all_histories() -> None:
    """Five blocks of three samples; each knock is a normal law of two components, integrated by its covariance.

    At the beginning a knock may be so many blocks old as one is followed, else all is quiet.
    """
    omega, walk, fade, rms, rate, size = 0.6, 0.05, 0.3, 0.8, 0.4, 3
    z = 2.0 * np.random.default_rng(4).standard_normal(5 * size)
    followed, variance = 4, 2.0 * rms**2 / rate  # FADES_FOLLOWED / (fade size) is below four
    hit = 1.0 - np.exp(-rate * fade * size)

    def seen(first: int, last: int, age: int) -> float:
        """Likelihood over that of white noise of blocks of one knock that was `age` blocks before the first of them."""
        t = np.arange(first * size, last * size)
        since = (
            t // size - first + age
        )  # whole blocks: in one a swing is taken to be as it was at its beginning
        u = (omega * t) + walk * size * since
        C = np.exp(-fade * size * since)[:, None] * np.column_stack([np.cos(u), -np.sin(u)])
        white = np.eye(t.size)
        whole = multivariate_normal(cov=white + variance * C @ C.T).logpdf(z[t])
        return float(np.exp(whole - multivariate_normal(cov=white).logpdf(z[t])))

    total = 0.0
    for age, knocks in product(range(followed + 1), product([False, True], repeat=4)):
        p = hit * (1.0 - hit) ** age if age < followed else (1.0 - hit) ** followed
        starts = [0, *(k + 1 for k, knock in enumerate(knocks) if knock), 5]
        for part, (first, last) in enumerate(pairwise(starts)):
            before = age if part == 0 else 0
            end = min(last, first + max(followed - before, 0))
            p *= seen(first, end, before) if end > first else 1.0
        total += p * hit ** sum(knocks) * (1.0 - hit) ** (4 - sum(knocks))
    found = knocked(Swing.of(z, omega, size), *np.array([[walk], [fade], [rms]]), rate)
    assert np.exp(found) == pytest.approx([total], rel=1e-9)


@pytest.mark.long
def test_knocks_are_no_resonance() -> None:
    """Three records of twenty knocks in 200 cycles, of the spectrum of a resonance of 30 nats or so.

    Of forty of other seeds 29 have odds for knocks above 2 nats, of as many resonances of the same spectrum one.
    """
    n, frequency, size = 4096, 0.05, 0.22
    omega = 2.0 * np.pi * frequency
    for seed in range(3):
        rng = np.random.default_rng([23, seed])
        z = rng.standard_normal(n) + size * rung(rng, n, frequency, 20.0)
        words, odds = other_law(z, omega, 1.0 / (6.0 * np.pi), size)
        assert words == KNOCKS
        assert odds > LOG_ODDS_OF_ITS_OWN_LAW


@pytest.mark.long  # in every run: a breath, and the likelihoods of knocks
def test_knocks_are_no_certain_resonance() -> None:
    rng, n, dt = np.random.default_rng(24), 4096, 0.01
    y = rng.standard_normal(n) + 0.3 * rung(rng, n, 0.05, 20.0)
    noise = ChannelNoise("rad/s", (Term(make("white_noise", N=np.sqrt(dt))),))
    gap = channel_gap("gyro_x", Record(dt * np.arange(n), y), noise)
    assert gap.verdict == "unknown_effect"
    assert gap.findings[0].probability <= MAX_PROBABILITY_OF_STAND_IN
    assert gap.findings[0].objection == KNOCKS
