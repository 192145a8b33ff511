"""Proves that the gap on held-out data is that of the whole updated model, whatever is among its effects.

What a model loses whose white noise has a standard deviation of 1 where the record's is s is, per sample,
``1/2 (s^2 - 1 - ln s^2)`` nats [S. Kullback, Information Theory and Statistics, 1959, ch. 9]: 0.0868 at 1.3.
"""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import lfilter
from scipy.stats import norm

from kfgen.effects import Effect, make
from kfgen.effects.series import Detection
from kfgen.gap.core.holdout import CLASSES_BEYOND, held_out_gap
from kfgen.gap.core.search import Chosen
from kfgen.gap.rest.checks import checks_of, without_losses
from kfgen.gap.rest.evidence import Candidate
from kfgen.gap.rest.explanation import MIN_NATS_OF_NOISE, ChannelExplanation
from kfgen.identify.evidence.record import Record
from kfgen.identify.fit.fit import Problem, maximise

Array = NDArray[np.float64]

N = 16000
T = np.arange(N) * 1.0
LOST = 0.5 * (1.3**2 - 1.0 - np.log(1.3**2))
WARM = {"temperature": np.linspace(0.0, 10.0, N)}


def noisy(seed: int, sd: float) -> Array:
    return sd * np.random.default_rng(seed).standard_normal(N)


@pytest.mark.parametrize(
    ("effect", "course"),
    [
        (make("bias_step", size=0.3, time=9000.0), 0.3 * (T >= 9000.0)),
        (make("rate_ramp", R=2e-5), 2e-5 * T),
        (make("temperature", coefficient=0.04), 0.04 * WARM["temperature"]),
    ],
    ids=["every other block", "the tail", "the warm third"],
)
def test_a_wrong_level_counts_beside_a_shape(effect: Effect, course: np.ndarray) -> None:
    """Of 4800 to 8000 samples the loss is known to 0.013 nats per sample at 4 sigma, sqrt(2 / n) (s^2 - 1) / 2 each."""
    record = Record(T, noisy(0, 1.3) + course, drive=WARM)
    white = make("white_noise", N=1.0)
    gap = held_out_gap(record, record, [white], Problem(record, (white, effect)))
    assert gap.before > LOST - 0.013
    assert gap.after < 0.002
    assert gap.closed > 0.95


def explanation(record: Record, *added: Effect) -> ChannelExplanation:
    """White noise, with these added one after the other."""
    white = make("white_noise", N=1.0)
    chosen = []
    for k, effect in enumerate(added):
        problem = Problem(record, (white, *added[: k + 1]))
        chosen.append(Chosen(Candidate(effect.name, maximise(problem), problem, 10.0), {}))
    return ChannelExplanation(record, (white,), {}, tuple(chosen))


def ringing(seed: int, n: int) -> Array:
    """White noise through a pole of 0.05 cycles per sample and a damping of 0.02, of standard deviation 1, and white noise."""
    rng = np.random.default_rng(seed)
    r, w = np.exp(-0.02 * 0.1 * np.pi), 0.1 * np.pi
    x = lfilter([1.0], [1.0, -2.0 * r * np.cos(w), r * r], rng.standard_normal(n + 2000))[2000:]
    return np.asarray(x / x.std() + rng.standard_normal(n))


def test_noise_of_which_a_later_one_left_nothing_is_not_kept() -> None:
    """A correlation time of five samples before the resonance is known: with it nothing is left of that noise."""
    record = Record(np.arange(8000.0), ringing(3, 8000))
    found = explanation(
        record,
        make("gauss_markov", sigma=1.0, tau=5.0),
        make("resonance", frequency=0.05, damping=0.02, rms=1.0),
    )
    fitted = found.base.fit.effects
    data = found.record.likelihood(fitted)
    assert (
        data.log_likelihood(fitted).value - data.log_likelihood((fitted[0], fitted[2])).value
        < MIN_NATS_OF_NOISE
    )
    assert [c.name for c in found.without_vanished().chosen] == ["resonance"]


@pytest.mark.long
def test_a_resonance_of_no_size_is_the_assumed_model() -> None:
    """The check compares the two in the same bins, of which a resonance has more."""
    record = Record(np.arange(4000.0), ringing(4, 4000))
    found = explanation(record, make("resonance", frequency=0.05, damping=0.02, rms=1.0))
    checks = checks_of(found, found.base.fit.effects, [("resonance", 0.9, 1.1)])
    assert checks.nested_nats < 1e-6


def test_a_pulse_inside_a_block_that_is_left_out_is_not_predicted() -> None:
    """Two steps: what they differ by shows in that block alone, and no fit to the others may say how large they are.

    Beside a random walk each sample says a little of those beside it; a fit that took that for knowledge made the gap larger.
    """
    block = N // 32
    at = 17 * block + block // 2  # the 18th is left out
    walk = 0.05 * np.cumsum(noisy(8, 1.0))
    record = Record(T, noisy(9, 1.0) + walk + 3.0 * (np.abs(T - at - 6.5) < 7.0) + 4.0 * (T >= 9000.0))
    shapes = [("bias_step", 3.0, float(at)), ("bias_step", -3.0, at + 14.0), ("bias_step", 4.0, 9000.0)]
    noise = (make("white_noise", N=1.0), make("rate_random_walk", K=0.05))
    model = (*noise, *(make(e, size=size, time=t) for e, size, t in shapes))
    gap = held_out_gap(record, record, noise, Problem(record, model))
    assert gap.after < gap.before


def test_outliers_that_no_spectrum_shows_are_a_gap_that_closes() -> None:
    """A share p of samples is k times as wide, and the assumed noise has the power of all.

    What a normal law of that power loses on counts in classes is the sum of ``q ln(q / p)`` over the shares q of the
    mixture and p of that law. Of 16000 samples it is known to 0.01 nats per sample at 4 sigma.
    """
    share, k = 0.05, 5.0
    rng = np.random.default_rng(12)
    wide = rng.random(N) < share
    z = rng.standard_normal(N)
    whole = float(np.sqrt(1.0 + share * (k * k - 1.0)))
    raw = Record(T, np.where(wide, k, 1.0) * z)
    clean = Record(T, np.where(wide, rng.standard_normal(N), z))
    beyond = np.concatenate([[1.0], CLASSES_BEYOND, [0.0]])
    ends = whole * norm.isf(0.5 * beyond)
    p, q = -np.diff(beyond), -np.diff(2.0 * ((1.0 - share) * norm.sf(ends) + share * norm.sf(ends / k)))
    lost = float(np.sum(q * np.log(q / p)))
    gap = held_out_gap(
        raw, clean, [make("white_noise", N=whole)], Problem(clean, (make("white_noise", N=1.0),))
    )
    assert gap.before == pytest.approx(lost, abs=0.01)
    assert gap.after < 0.002
    assert gap.closed > 0.95


def test_ten_large_samples_are_a_gap_that_no_band_shows() -> None:
    """Ten of 6.5 standard deviations are in the class from 1e-8 to 1e-12 of a normal law, where 1.6e-4 of a sample is
    expected: ``c ln(c / e) - c + e`` is 100 nats; chance in bands and classes is 15 nats at 4 sigma.
    """
    y = noisy(14, 1.0)
    at = np.arange(800, N, 1600)
    y[at] = 6.5 * np.sign(y[at])
    raw, white = Record(T, y), make("white_noise", N=1.0)
    outliers = Detection(make("outliers", share=10.0 / N, sigma=6.5), evidence=100.0)
    problem = Problem(raw, (white,))
    found = ChannelExplanation(
        raw,
        (white,),
        {},
        (Chosen(Candidate("outliers", maximise(problem), problem, 100.0, detect=outliers), {}),),
    )
    kept, gap = without_losses(found, raw, [white])
    assert [c.name for c in kept.chosen] == ["outliers"]
    expected = N * (1e-8 - 1e-12)
    assert gap.before * N == pytest.approx(10.0 * np.log(10.0 / expected) - 10.0, abs=15.0)
    assert gap.closed > 0.8


def test_what_makes_the_mismatch_larger_on_held_out_data_is_not_kept() -> None:
    """A change of the noise that is not there: twice as loud from the middle on, and so halved to remove it."""
    record = Record(T, noisy(13, 1.0))
    white, change = make("white_noise", N=1.0), make("noise_change", ratio=2.0, time=8000.0)
    problem = Problem(record, (white,))
    addition = Candidate(
        "noise_change", maximise(problem), problem, 10.0, detect=Detection(change, evidence=10.0)
    )
    found = ChannelExplanation(record, (white,), {}, (Chosen(addition, {}),))
    kept, gap = without_losses(found, record, [white])
    assert not kept.chosen
    (refused,) = kept.refused
    assert (refused.effect, refused.evidence_nats) == ("noise_change", 10.0)
    assert gap.after < 0.002
