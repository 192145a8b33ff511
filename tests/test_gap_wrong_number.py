"""Proves that a wrong number of the model is said to be one, and is no effect, however sure the model was of it.

A minute of white noise in plain numpy, its N off by a factor against a file whose interval is 1 % to either side, as
``kfgen identify -o`` writes it. Seeds are fixed; without an effect one is named in less than 1 % of records.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from in_part import in_part

from kfgen.effects import make
from kfgen.effects.noise_model import ChannelNoise, NoiseModel, Term
from kfgen.gap.find_gap import find_gap
from kfgen.gap.result import GapResult
from kfgen.gap.words import finding_sentence
from kfgen.log.log import Channel, Log

N, DT, SAMPLES = 1e-3, 0.01, 6000


def answer(factor: float, seed: int, louder: float = 1.0) -> GapResult:
    """The gap of noise that is assumed `factor` times as large, and `louder` in the second half."""
    late = np.arange(SAMPLES) >= SAMPLES // 2
    sd = N / np.sqrt(DT) * np.where(late, louder, 1.0)
    y = sd * np.random.default_rng(seed).standard_normal(SAMPLES)
    log = Log(DT * np.arange(SAMPLES), {"gyro_x": Channel.of(y, "rad/s")})
    term = Term(make("white_noise", N=factor * N), {"N": (0.99 * factor * N, 1.01 * factor * N)})
    return find_gap(log, NoiseModel({"gyro_x": ChannelNoise("rad/s", (term,))}))


@pytest.mark.parametrize(("factor", "seed"), in_part([(1.5, 2), (0.5, 1), (3.0, 3)]))
def test_noise_of_another_size_all_along_is_a_wrong_number(factor: float, seed: int) -> None:
    """Once it was a change of level at the first second, with certainty."""
    found = answer(factor, seed)
    assert found.findings == ()
    assert found.verdict == "effects_found"
    assert found.to_dict()["retuned"] == ["gyro_x"]
    (updated,) = found.comparisons[0].updated.effects  # type: ignore[attr-defined]
    assert pytest.approx(N, rel=4.0 / np.sqrt(2.0 * SAMPLES)) == updated.N


def test_a_change_of_level_is_still_one() -> None:
    (change,) = answer(1.0, 4, louder=1.5).findings
    assert change.name == "noise_change"
    assert change.effect.time == pytest.approx(30.0, abs=1.0)  # type: ignore[attr-defined]
    assert change.ci95["ratio"][0] < 1.5 < change.ci95["ratio"][1]


@pytest.mark.parametrize(("sigma", "tau"), [pytest.param(4e-4, 30.0, marks=pytest.mark.long), (2e-4, 90.0)])
def test_a_wrong_number_of_a_bias_is_no_second_bias(sigma: float, tau: float) -> None:
    """Of an hour, N trusted to 1 % and the bias to 10 %: once it was a second Gauss-Markov bias beside the first."""
    dt, n = 0.1, 36_000
    rng = np.random.default_rng([112_331, int(tau)])
    t = dt * np.arange(n)
    y = 1e-4 / np.sqrt(dt) * rng.standard_normal(n)
    y = y + make("gauss_markov", sigma=sigma, tau=tau).simulate(t, rng)
    white = Term(make("white_noise", N=1e-4), {"N": (0.99e-4, 1.01e-4)})
    bias = Term(make("gauss_markov", sigma=2e-4, tau=30.0), {"sigma": (1.8e-4, 2.2e-4), "tau": (25.0, 36.0)})
    assumed = NoiseModel({"gyro_x": ChannelNoise("rad/s", (white, bias))})
    found = find_gap(Log(t, {"gyro_x": Channel.of(y, "rad/s")}), assumed)
    assert (found.findings, found.to_dict()["retuned"]) == ((), ["gyro_x"])
    (updated,) = (e for e in found.comparisons[0].updated.effects if e.name == "gauss_markov")  # type: ignore[attr-defined]
    # An hour has n / (2 tau) independent parts: sigma is known to a share of sqrt(tau / 3600).
    assert updated.sigma == pytest.approx(sigma, rel=4.0 * np.sqrt(tau / 3600.0))
    assert updated.tau == pytest.approx(tau, rel=8.0 * np.sqrt(tau / 3600.0))


@pytest.mark.long
@pytest.mark.parametrize("seed", [13, *(pytest.param(k, marks=pytest.mark.long) for k in (11, 12))])
def test_a_bias_half_as_large_again_as_a_file_says_is_a_wrong_number(seed: int) -> None:
    """Without intervals in the file: once bias instability of 37 % (seed 11), for a wrong number was one name of twenty.

    Of 291 records of other seeds that refute such numbers (off by a standard deviation of 35 %) 20 had a false name
    before, and 8 have one.
    """
    dt, n = 0.1, 16_384
    t, rng = dt * np.arange(n), np.random.default_rng(seed)
    y = rng.standard_normal(n) + make("gauss_markov", sigma=0.28, tau=5.0).simulate(t, rng)
    white, bias = make("white_noise", N=np.sqrt(dt)), make("gauss_markov", sigma=0.2, tau=5.0)
    assumed = NoiseModel({"gyro_x": ChannelNoise("rad/s", (Term(white), Term(bias)))})
    found = find_gap(Log(t, {"gyro_x": Channel.of(y, "rad/s")}), assumed)
    assert (found.verdict, found.findings, found.to_dict()["retuned"]) == ("effects_found", (), ["gyro_x"])


@pytest.mark.long
def test_numbers_that_a_log_does_not_rule_out_are_called_so() -> None:
    """In words; programs read `retune`."""
    (change,) = answer(1.0, 4, louder=1.5).findings
    rivalled = replace(change, alternatives=(("retune", "gyro_x", 0.4),))
    said = finding_sentence(answer(1.0, 5).comparisons[0], rivalled)
    assert "does not rule out other numbers of the model itself" in said
    assert "retune" not in said
