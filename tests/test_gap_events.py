"""Proves that what happens at a time, and what is not normal, is named with its numbers, and removed.

Records are plain numpy: white noise of one per sample and one event. Each event is worth over 30 nats, so that its
name is missed in fewer than 1e-6 of the seeds; its numbers are held to 2.5 half-widths of their 95 % intervals
(1e-6 each). A Bayes factor exceeds e^x without an event in at most e^-x of the seeds (Markov): 8 nats in 30 records of
four effects in 4 %. Seeds are fixed.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from in_part import in_part
from numpy.typing import NDArray
from scipy.stats import kstest

from kfgen.effects import Effect, catalogue, make
from kfgen.effects.noise_model import ChannelNoise, Term
from kfgen.effects.series import WhiteSeries
from kfgen.gap.rest.channel_gap import channel_gap
from kfgen.gap.rest.comparison import ChannelGap
from kfgen.gap.rest.evidence import assumed, series_of
from kfgen.identify.evidence.record import Record

Array = NDArray[np.float64]

N, DT = 8192, 0.1
T = np.arange(N) * DT
WHITE = make("white_noise", N=np.sqrt(DT))


def step(y: Array, rng: np.random.Generator) -> Array:
    return y + 0.5 * (T >= 300.0)


def change(y: Array, rng: np.random.Generator) -> Array:
    return np.where(T >= 500.0, 1.3 * y, y)


def outliers(y: Array, rng: np.random.Generator) -> Array:
    return y + 8.0 * rng.standard_normal(N) * (rng.random(N) < 0.01)


def telegraph(y: Array, rng: np.random.Generator) -> Array:
    """Exponential dwell times of 20 s, levels 1.5 apart."""
    edges = np.cumsum(rng.exponential(20.0, 400))
    return y + 1.5 * (np.searchsorted(edges, T) % 2)


def bursts(y: Array, rng: np.random.Generator) -> Array:
    """Twice as loud for 12 s on average, after 48 s of quiet on average."""
    lengths = np.column_stack([rng.exponential(48.0, 100), rng.exponential(12.0, 100)])
    return np.where(np.searchsorted(np.cumsum(lengths.ravel()), T) % 2, 2.0 * y, y)


EVENTS: dict[str, tuple[Any, dict[str, float], str]] = {
    "bias_step": (step, {"size": 0.5, "time": 300.0}, "every other block of the record"),
    "noise_change": (
        change,
        {"ratio": 1.3, "time": 500.0},
        "every third of the record, by a fit to the other two",
    ),
    "outliers": (
        outliers,
        {"share": 0.01, "sigma": 8.0},
        "every third of the record, by a fit to the other two",
    ),
    "random_telegraph": (
        telegraph,
        {"size": 1.5, "dwell": 20.0},
        "every third of the record, by a fit to the other two",
    ),
    "intermittent_noise": (
        bursts,
        {"ratio": 2.0, "share": 0.2, "lasting": 12.0},
        "every third of the record, by a fit to the other two",
    ),
}
ALTERING = ["noise_change", "outliers", "random_telegraph", "intermittent_noise"]


def record_of(name: str, seed: int = 3) -> Record:
    rng = np.random.default_rng([seed, 11])
    return Record(T, EVENTS[name][0](rng.standard_normal(N), rng))


def gap_of(record: Record, *more: Effect) -> ChannelGap:
    return channel_gap("gyro_x", record, ChannelNoise("rad/s", tuple(Term(e) for e in (WHITE, *more))))


@pytest.mark.parametrize("name", in_part(EVENTS))
def test_an_event_is_named_with_its_numbers(name: str) -> None:
    _, truth, unseen = EVENTS[name]
    gap = gap_of(record_of(name))
    assert gap.verdict == "effects_found"
    assert [f.effect.name for f in gap.findings] == [name]
    (found,) = gap.findings
    assert found.probability > 0.9
    assert not any(t.significant for t in gap.after)
    assert gap.gap.held_out == unseen
    assert gap.gap.after < gap.gap.before
    for parameter, value in truth.items():
        lo, hi = found.ci95[parameter]
        assert lo <= float(getattr(found.effect, parameter)) <= hi
        half = 0.5 * (hi - lo) + DT * (parameter == "time")  # a time is one of the samples'
        assert abs(value - 0.5 * (lo + hi)) < 2.5 * half, parameter
        assert half < (0.4 if name != "intermittent_noise" else 1.2) * value  # of a dozen bursts


@pytest.mark.parametrize("name", in_part(ALTERING))
def test_what_is_assumed_of_an_event_is_no_gap(name: str) -> None:
    effect = make(name, **EVENTS[name][1])
    gap = gap_of(record_of(name), effect)
    assert gap.verdict == "no_gap"
    assert effect in gap.updated.effects


def test_an_assumed_step_is_no_gap() -> None:
    gap = gap_of(record_of("bias_step"), make("bias_step", size=0.5, time=300.0))
    assert (gap.verdict, gap.findings) == ("no_gap", ())


def series(y: Array) -> WhiteSeries:
    return series_of(assumed(Record(np.arange(y.size) * DT, y), (WHITE,), {}))


@pytest.mark.parametrize("name", ALTERING)
def test_what_is_removed_leaves_white_normal_samples(name: str) -> None:
    """Kolmogorov's test at 1e-4; powers of three scales of time within 4.5 sqrt(2 / m), and 3 % for what a level
    that jumps leaves beside its jumps."""
    y = record_of(name).y
    left = make(name, **EVENTS[name][1]).removed_from(series(y))
    assert left is not None
    left = left - left.mean()
    assert kstest(left, "norm").pvalue > 1e-4
    for block in (1, 8, 64):
        means = left[: N // block * block].reshape(-1, block).mean(axis=1)
        power = float(np.mean(means**2)) * block
        assert abs(power - 1.0) < 4.5 * np.sqrt(2.0 / means.size) + 0.03
    raw = y - y.mean()
    assert kstest(raw, "norm").pvalue < 1e-3 or name == "outliers"


def test_outliers_have_a_chance_each() -> None:
    """By Bayes: share N(z; 0, 1 + k^2) over the sum of both laws; the gated ones are those far away."""
    y = np.random.default_rng(1).standard_normal(2048)
    y[100], y[200] = 9.0, -0.1
    effect, s = make("outliers", share=0.01, sigma=8.0), series(y)
    z, wide = s.z[[100, 200]], np.hypot(1.0, 8.0 / s.sd)
    inside, outside = (w * np.exp(-0.5 * (z / d) ** 2) / d for w, d in ((0.99, 1.0), (0.01, wide)))
    np.testing.assert_allclose(
        effect.chance(s.sd * s.z, s.sd)[[100, 200]], outside / (inside + outside), rtol=1e-6
    )  # type: ignore[attr-defined]
    assert effect.chance(s.sd * s.z, s.sd)[100] > 0.999  # type: ignore[attr-defined]
    assert effect.chance(s.sd * s.z, s.sd)[200] < 0.01  # type: ignore[attr-defined]


def test_white_noise_has_no_events() -> None:
    for seed in range(10):
        s = series(np.random.default_rng([seed, 5]).standard_normal(2048))
        for name in ALTERING:
            found = [x.evidence for x in catalogue()[name].detect(s)]
            assert all(e is not None and e < 8.0 for e in found), (seed, name, found)


def test_the_onset_of_a_step_is_as_likely_as_the_whole_scan_says() -> None:
    """By brute force: each onset's least squares beside a constant, integrated over the prior of its size."""
    from kfgen.effects.series import OF_A_COEFFICIENT

    n = 256
    y = np.random.default_rng(8).standard_normal(n) + 1.0 * (np.arange(n) >= 100)
    s = series(y)
    (found,) = catalogue()["bias_step"].detect(s)
    scores = []
    for k in range(9, n - 8):
        x = (np.arange(n) >= k) - (n - k) / n
        scores.append(x @ (y - y.mean()) / np.sqrt(x @ x) / s.sd)
    score = np.array(scores)
    w = 0.5 * score**2 - np.log(np.maximum(np.abs(score), 1.0))
    best = int(np.argmax(w))
    assert found.effect.time == pytest.approx((best + 9) * DT)  # type: ignore[attr-defined]
    assert found.located == pytest.approx(float(np.log(np.mean(np.exp(w - w[best])))), abs=0.1)
    assert pytest.approx(2.0 * np.log(1e4)) == OF_A_COEFFICIENT
    x = (np.arange(n) >= best + 9) - (n - best - 9) / n
    assert found.effect.size == pytest.approx(x @ y / (x @ x), rel=1e-3)  # type: ignore[attr-defined]


def test_a_constant_is_no_noise_that_changes() -> None:
    """Gravity on a channel whose noise changes makes no step: the constant is not scaled with the noise."""
    n, dt = 8000, 0.02
    rng = np.random.default_rng(11)
    t = np.arange(n) * dt
    y = 9.8 + 0.01 * rng.standard_normal(n) * np.where(t < 90.0, 1.0, 0.8)
    gap = channel_gap(
        "accel_z", Record(t, y), ChannelNoise("m/s^2", (Term(make("white_noise", N=0.01 * np.sqrt(dt))),))
    )
    assert [f.effect.name for f in gap.findings] == ["noise_change"]


@pytest.mark.long
def test_levels_are_distinguished_from_the_slow_noise_that_is_assumed() -> None:
    """A bias of 0.3 over 50 s, and levels 0.7 apart for 15 s: their spectra are alike, their laws are not."""
    rng = np.random.default_rng([2, 17])
    slow = make("gauss_markov", sigma=0.3, tau=50.0)
    edges = np.cumsum(rng.exponential(15.0, 400))
    y = rng.standard_normal(N) + slow.simulate(T, rng) + 0.7 * (np.searchsorted(edges, T) % 2)
    gap = gap_of(Record(T, y), slow)
    assert gap.verdict == "effects_found"
    (found,) = gap.findings
    assert found.effect.name == "random_telegraph"
    assert found.probability > 0.9
    for name, value in {"size": 0.7, "dwell": 15.0}.items():
        lo, hi = found.ci95[name]
        assert lo < value < hi
    assert gap_of(Record(T, rng.standard_normal(N) + slow.simulate(T, rng)), slow).verdict == "no_gap"
