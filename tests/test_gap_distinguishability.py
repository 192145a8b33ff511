"""How far two names are apart, against the divergence of dense Gaussians; what is said of a set."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import toeplitz
from scipy.signal import lfilter

from kfgen.effects import Effect, make
from kfgen.effects.noise_model import ChannelNoise, Term
from kfgen.gap.core.holdout import Gap
from kfgen.gap.core.result import Comparison, Finding
from kfgen.gap.core.search import Distinguishability
from kfgen.gap.rest.channel_gap import channel_gap
from kfgen.gap.rest.distinguishability import distinguishability, divergence
from kfgen.gap.rest.evidence import Candidate
from kfgen.gap.words import finding_sentence
from kfgen.identify.evidence.record import Record
from kfgen.identify.fit.fit import Problem, maximise

N, DT = 400, 0.1


def as_written(*effects: Effect, y: np.ndarray | None = None) -> Candidate:
    """A candidate with these numbers."""
    record = Record(np.arange(N) * DT, np.random.default_rng(0).standard_normal(N) if y is None else y)
    every = frozenset((i, p.name) for i, e in enumerate(effects) for p in e.searched())
    problem = Problem(record, effects, fixed=every)
    return Candidate(effects[-1].name, maximise(problem), problem, 0.0)


def dense(sigma: float, tau: float) -> np.ndarray:
    """Covariance of unit white samples and a Gauss-Markov bias, of what is left of them less their mean."""
    C = np.eye(N) + sigma**2 * toeplitz(np.exp(-np.arange(N) * DT / tau))
    P = np.eye(N) - 1.0 / N
    basis = np.linalg.svd(P)[0][:, : N - 1]
    return basis.T @ C @ basis


@pytest.mark.parametrize(("a", "b"), [((0.5, 2.0), (0.5, 8.0)), ((0.3, 1.0), (0.0, 1.0))])
def test_the_divergence_of_two_gaussians(a: tuple[float, float], b: tuple[float, float]) -> None:
    """``(tr B^-1 A - n - ln |A| / |B|) / 2`` of dense matrices, within a tenth: its ordinates are taken as independent."""
    white = make("white_noise", N=np.sqrt(DT))
    fitted = [as_written(white, make("gauss_markov", sigma=max(s, 1e-6), tau=tau)) for s, tau in (a, b)]
    A, B = dense(*a), dense(*b)
    logs = np.linalg.slogdet(A)[1] - np.linalg.slogdet(B)[1]
    wanted = 0.5 * (np.trace(np.linalg.solve(B, A)) - (N - 1) - logs)
    assert divergence(*fitted) == pytest.approx(wanted, rel=0.1)


def test_a_shape_counts_by_its_energy() -> None:
    """A ramp beside unit white noise: half the sum of its squares about its mean, with no noise to hide in."""
    white = make("white_noise", N=np.sqrt(DT))
    t = np.arange(N) * DT
    ramp, none = as_written(white, make("rate_ramp", R=0.02), y=0.02 * t), as_written(white)
    shape = 0.02 * (t - t.mean())
    assert divergence(ramp, none) == pytest.approx(0.5 * float(shape @ shape), rel=0.02)
    itself = distinguishability(ramp, ramp, none)
    assert (itself.cos2, itself.nats) == (pytest.approx(1.0), pytest.approx(0.0, abs=1e-9))


@pytest.mark.long
def test_what_would_tell_is_said() -> None:
    """A weak slow bias: names that are not ruled out stand with their cosine and a longer record."""
    rng, n, tau = np.random.default_rng(7), 8000, 60.0
    a = np.exp(-DT / tau)
    slow = lfilter([1.0], [1.0, -a], 0.12 * np.sqrt(1.0 - a * a) * rng.standard_normal(n))
    record = Record(np.arange(n) * DT, rng.standard_normal(n) + slow)
    gap = channel_gap("gyro", record, ChannelNoise("", (Term(make("white_noise", N=np.sqrt(DT))),)))
    (found,) = gap.findings
    assert found.others
    assert {o.effect for o in found.others} == set(found.indistinguishable)
    for other in found.others:
        assert 0.0 <= other.cos2 <= 1.0
        assert f"{other.effect} (cos2 {other.cos2:.2f}" in finding_sentence(gap, found)
    assert "record" in finding_sentence(gap, found)


def test_a_record_that_is_long_enough_is_not_made_longer() -> None:
    assert Distinguishability("rate_ramp", "", 0.2, 30.0).record_factor == 1.0
    near = Distinguishability("rate_ramp", "", 0.9, 1.5)
    assert near.record_factor == pytest.approx(2.0)
    alternatives = (("rate_ramp", "", 0.3),)
    found = Finding(
        make("gauss_markov", sigma=1.0, tau=1.0), "gyro", alternatives=alternatives, others=(near,)
    )
    nothing = Gap(0.0, 0.0, 0.0, (0.0, 0.0))
    whole = Comparison(
        channels=("gyro",),
        verdict="effects_found",
        findings=(found,),
        before=(),
        after=(),
        gap=nothing,
        span_s=(0.0, 1.0),
    )
    assert "a record 2 times as long" in finding_sentence(whole, found)
