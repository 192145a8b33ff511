"""Proves that lists of effects at rest are compared by what they explain together, and end well when time ends.

Records are simulated with fixed seeds; each expectation has at least eight nats to spare, so that another seed fails in
about one of a thousand.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from kfgen.core import time_budget
from kfgen.effects import make
from kfgen.effects.noise_model import ChannelNoise, Term
from kfgen.gap.core.search import grown, labels, reconsidered, searched
from kfgen.gap.rest.channel_gap import prepared
from kfgen.gap.rest.explanation import ABSORBERS, RANDOM, ChannelExplanation, search_limits
from kfgen.identify.evidence.record import Record

N_SAMPLES = 3000
DT = 0.1


def explanation(*, step: float = 0.0, line: float = 0.0, warm_up: float = 0.0) -> ChannelExplanation:
    """White noise of standard deviation one with shapes of some sizes, against a model of white noise alone."""
    t = DT * np.arange(N_SAMPLES)
    y = np.random.default_rng(17).standard_normal(N_SAMPLES)
    y += step * (t > 190.0) + line * np.sin(2.0 * np.pi * 0.731 * t) + warm_up * np.exp(-t / 40.0)
    sd = float(np.sqrt(DT))
    white = Term(make("white_noise", N=sd), {"N": (0.98 * sd, 1.02 * sd)})
    return prepared(Record(t, y), ChannelNoise("rad/s", (white,))).search


def having(start: ChannelExplanation, *names: str) -> ChannelExplanation:
    """With these chosen, in order."""
    for name in names:
        ranked = start.ranked()
        start = start.plus(next(c for c in ranked if c.name == name), ranked)
    return start


@pytest.mark.long
def test_evidence_of_a_list_does_not_depend_on_its_order() -> None:
    """Of each when it was added it does: the first of two drifts explains most of both. The tolerance is of the fits."""
    start = explanation(step=0.5, warm_up=1.0)
    one, other = having(start, "bias_step", "warm_up"), having(start, "warm_up", "bias_step")
    assert abs(one.chosen[0].gain - other.chosen[1].gain) > 3.0
    assert one.evidence == pytest.approx(other.evidence, abs=1.0)


def test_evidence_of_one_effect_is_its_own() -> None:
    one = having(explanation(line=0.3), "sinusoid")
    assert one.evidence == pytest.approx(one.chosen[0].gain, abs=0.2)


@pytest.mark.long
def test_shapes_are_found_that_a_random_process_explains_as_well_at_first() -> None:
    """Beside a spectral line a step and a warm-up: random drift is worth most while there is nothing else."""
    start = explanation(step=1.0, warm_up=2.0, line=0.3)
    assert start.ranked()[0].name in RANDOM
    assert sorted(c.name for c in searched(start, search_limits()).chosen) == [
        "bias_step",
        "sinusoid",
        "warm_up",
    ]


def test_shapes_do_not_follow_the_course_of_a_random_walk() -> None:
    """While it is kept back, the first shape may be any; another one has to explain nearly half of what it explains."""
    rng = np.random.default_rng(17)
    y = rng.standard_normal(N_SAMPLES) + np.cumsum(rng.standard_normal(N_SAMPLES))
    sd = float(np.sqrt(DT))
    white = Term(make("white_noise", N=sd), {"N": (0.98 * sd, 1.02 * sd)})
    record = Record(DT * np.arange(N_SAMPLES), y)
    start = replace(prepared(record, ChannelNoise("rad/s", (white,))).search, waiting=RANDOM)
    shapes = grown(start, search_limits())
    left = {c.name: c.gain for c in reversed(shapes.every_candidate)}
    best = max(gain for name, gain in left.items() if name not in RANDOM)
    assert shapes.chosen
    assert shapes.ranked() == []
    assert 100.0 < best < 0.45 * max(left[name] for name in ABSORBERS)
    assert shapes.with_absorbers().ranked()[0].name in ABSORBERS


def test_what_is_no_shape_waits_unless_it_stood_beside_what_is_random() -> None:
    """Beside a drift that is kept back, noise of another colour or level would explain what it leaves."""
    found = having(explanation(step=0.5), "outliers", "rate_random_walk")
    again = found.absorbers_last()
    assert again is not None
    assert again.chosen == ()
    assert {"rate_random_walk", "random_telegraph", "low_pass", "noise_change"} <= again.waiting
    assert not {"outliers", "bias_step", "sinusoid", "temperature"} & again.waiting
    assert again.with_absorbers().waiting == frozenset()


@pytest.mark.long
def test_where_time_ended_what_others_explain_is_removed_and_the_rest_stays() -> None:
    """A random walk found first is nothing beside the step and the spectral line that were found later."""
    found = having(explanation(step=0.5, line=0.3), "rate_random_walk", "sinusoid", "bias_step")
    with time_budget.time_budget() as budget:
        budget.search_s = 0.0
        found = reconsidered(found, search_limits())
    assert [name for name, _ in labels(found)] == ["sinusoid", "bias_step"]


@pytest.mark.parametrize("n", [97, 9973, 10_007, 10_164, 100_003, 238_256])
def test_a_long_record_has_a_length_of_quick_transforms(n: int) -> None:
    """97 and 9973 are short; the first of 10 007, a prime, are kept but for 1.5 %."""
    record = Record(DT * np.arange(n), np.arange(float(n)))
    quick = record.quick()
    assert quick.y.size == n if n <= 10_000 else 0.985 * n < quick.y.size <= n
    assert np.array_equal(quick.y, record.y[: quick.y.size])
    left = quick.y.size
    for prime in (2, 3, 5, 7, 11):
        while left % prime == 0:
            left //= prime
    assert left == 1 or n <= 10_000
