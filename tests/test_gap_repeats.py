"""Samples that repeat now and then are seen on coarse grids, and neighbours that are equal by chance are not called so.

Records are plain numpy and scipy, rounded to a grid of a stated step over their standard deviation. False alarms: both
tests must fail, each at 5e-4. An ideal analyst who knows the noise counts equal neighbours: with the chance
c = sum of squares of the grid's probabilities, a share p stands ``p (1 - c) sqrt(n / (c (1 - c)))`` standard
deviations above it; one who does not know it needs about twice as much, and nobody sees what is below three.
Seeds are fixed.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import butter, lfilter
from scipy.stats import norm

from kfgen.effects.faults.repeats import repeated_share, rounded_normal
from kfgen.effects.faults.samples import MIN_REPEATED_SHARE, RepeatedSamples
from kfgen.effects.series import RawSamples

Array = NDArray[np.float64]
Rng = np.random.Generator

N = 16_384
GRIDS = (0.1, 0.3, 0.5, 1.0)
"""Steps of the grid, in standard deviations of a sample."""


def normed(y: Array) -> Array:
    return y / y.std()


NOISE: dict[str, Callable[[Rng], Array]] = {
    "white": lambda rng: rng.standard_normal(N),
    "Gauss-Markov": lambda rng: lfilter([np.sqrt(0.51)], [1.0, -0.7], rng.standard_normal(N)),
    "slow Gauss-Markov beside white": lambda rng: (
        0.5 * rng.standard_normal(N) + lfilter([np.sqrt(1 - 0.95**2)], [1.0, -0.95], rng.standard_normal(N))
    ),
    "random walk": lambda rng: np.cumsum(rng.standard_normal(N)),
    "low-passed": lambda rng: normed(lfilter(*butter(2, 0.2), rng.standard_normal(N))),
    "oversampled": lambda rng: normed(lfilter(*butter(2, 0.05), rng.standard_normal(N))),
    "heavy tails": lambda rng: rng.standard_t(4, N),
}


def rounded(y: Array, step: float, rng: Rng) -> Array:
    return np.asarray(step * np.round((y + rng.random()) / step))


def repeating(y: Array, share: float, rng: Rng) -> Array:
    hit = rng.random(y.size) < share
    return np.asarray(y[np.maximum.accumulate(np.where(hit & (np.arange(y.size) > 0), 0, np.arange(y.size)))])


def record(seed: int, step: float, share: float = 0.0, kind: str = "white") -> RawSamples:
    rng = np.random.default_rng([seed, int(100 * step), int(100 * share), 41])
    y = repeating(rounded(NOISE[kind](rng), step, rng), share, rng)
    return RawSamples(np.arange(N) * 0.01, y, 1.0)


def share_of(raw: RawSamples) -> float:
    found = RepeatedSamples.detect_fault(raw)
    return float(found.effect.share) if found is not None else 0.0  # type: ignore[attr-defined]


@pytest.mark.parametrize("step", GRIDS)
@pytest.mark.parametrize("share", [0.05, 0.1])
def test_repeats_are_seen_on_every_grid_that_is_not_wider_than_the_noise(share: float, step: float) -> None:
    """Before: 5 % at half a standard deviation in one of three, nothing at a whole one. The share within a third."""
    found = np.array([share_of(record(seed, step, share)) for seed in range(10)])
    assert (found > 0.0).all()
    assert found.mean() == pytest.approx(share, rel=0.35)


@pytest.mark.parametrize(("step", "least"), [(0.1, 10), (0.3, 10), (0.5, 9), (1.0, 5)])
def test_three_percent_are_seen(step: float, least: int) -> None:
    """By an ideal analyst 6.1 standard deviations at the widest grid, of which the free shape of the noise costs half."""
    found = [share_of(record(seed, step, 0.03)) > 0.0 for seed in range(10)]
    assert sum(found) >= least


def test_what_an_ideal_analyst_does_not_see_is_not_said() -> None:
    """3 % of 1,500 samples at a whole standard deviation: 1.9 standard deviations of the count, for one who knows c."""
    edges = norm.cdf(np.arange(-8, 9) - 0.5)
    c = float(np.sum(np.diff(edges) ** 2))
    n = 1500
    assert 0.03 * (1 - c) * np.sqrt(n / (c * (1 - c))) < 2.0
    assert all(repeated_share(record(seed, 1.0, 0.03).y[:n], 1.0) == 0.0 for seed in range(10))


@pytest.mark.parametrize("kind", NOISE)
def test_sound_noise_of_any_colour_does_not_repeat(kind: str) -> None:
    """80 records a kind, of a rate of 5e-4 each at most: an alarm in 4 % of the seeds."""
    found = [share_of(record(seed, step, kind=kind)) for step in GRIDS for seed in range(20)]
    assert max(found) < MIN_REPEATED_SHARE


def test_every_other_sample_and_samples_of_no_grid() -> None:
    y = np.random.default_rng(5).standard_normal(N)
    assert repeated_share(np.repeat(y[::2], 2), 0.0) == pytest.approx(0.5, abs=1e-3)
    assert repeated_share(repeating(y, 0.01, np.random.default_rng(6)), 0.0) == pytest.approx(0.01, abs=3e-3)
    assert repeated_share(y, 0.0) == 0.0


@pytest.mark.parametrize("step", GRIDS)
@pytest.mark.parametrize("drift", [0.1, 1.0, 10.0])
def test_a_drift_behind_the_converter_makes_no_repeats_of_equal_codes(drift: float, step: float) -> None:
    """A sensor corrects its temperature behind its converter: 1 to 26 % of its samples were "repeated", all of them sound."""
    t = np.arange(N) / N
    for seed in range(5):
        rng = np.random.default_rng([seed, int(100 * step), 43])
        y = rounded(rng.standard_normal(N), step, rng) + drift * (t + 0.1 * np.sin(6.0 * t))
        for digits in (3, 4):
            written = np.round(y, digits)
            assert share_of(RawSamples(N * 0.01 * t, written, 1.0)) == 0.0
            assert repeated_share(written, 0.0) == 0.0


@pytest.mark.parametrize("s", [0.7, 1.4, 5.0])
def test_differences_of_rounded_deviates_have_their_law(s: float) -> None:
    """Against counts of a million pairs with a random place on the grid."""
    rng = np.random.default_rng(7)
    a = 50.0 * rng.random(1_000_000)
    d = np.round(a + s * rng.standard_normal(a.size)) - np.round(a)
    for k in range(4):
        assert float(np.mean(d == k)) == pytest.approx(rounded_normal(np.array([k]), s)[0], abs=4.5 * 5e-4)
