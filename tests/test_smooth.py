"""`kfgen run --smooth`: estimates with all readings known, against a batch solution and against the truth."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import chi2

import kfgen as kf
from kfgen.core.errors import InputError
from kfgen.emit.routines import Program
from kfgen.log.log import Log
from kfgen.model.discretise import DiscreteModel
from kfgen.run import smooth as smoothing
from kfgen.run.filter_calls import FilterCalls
from kfgen.run.run import FilterRun, program_over, run
from kfgen.run.smooth import ForwardPass, smoothed
from kfgen.simulate.simulate import simulate

N, SIGMA, TAU, K = 1e-3, 4e-3, 5.0, 2e-3
"""White noise, first-order Gauss-Markov error and random walk of a gyro at rest [SI]."""
NOISE = f"""
format = "kfgen-noise-1"
[gyro_x]
unit = "rad/s"
effects = [
  {{ effect = "white_noise", N = "{N} rad/s/sqrt(Hz)" }},
  {{ effect = "gauss_markov", sigma = "{SIGMA} rad/s", tau = "{TAU} s" }},
  {{ effect = "rate_random_walk", K = "{K} rad/s/sqrt(s)" }},
]
"""
FLIGHTS = 12


def at_rest(times: np.ndarray) -> Log:
    rng = np.random.default_rng(1)
    return Log(times, {"gyro_x": kf.Channel(5e-3 * rng.standard_normal(times.size), "rad/s")})


def batch(log: Log, prior_sd: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """States and their standard deviations, shapes (n, 2), by the normal equations of all samples at once."""
    n, z = log.n, log.values("gyro_x")
    A, b = np.zeros((2 * n, 2 * n)), np.zeros(2 * n)
    A[:2, :2] += np.diag(prior_sd**-2.0)
    rate = 1.0 / log.dt
    for k in range(n):
        h = np.zeros(2 * n)
        h[2 * k : 2 * k + 2] = 1.0
        A += np.outer(h, h) / (N**2 * rate)
        b += h * z[k] / (N**2 * rate)
        if k + 1 < n:
            dt = log.t[k + 1] - log.t[k]
            phi = np.exp(-dt / TAU)
            for i, (keeps, q) in enumerate(((phi, SIGMA**2 * (1.0 - phi**2)), (1.0, K**2 * dt))):
                d = np.zeros(2 * n)
                d[2 * k + i], d[2 * k + 2 + i] = -keeps, 1.0
                A += np.outer(d, d) / q
    return np.linalg.solve(A, b).reshape(n, 2), np.sqrt(np.diag(np.linalg.inv(A))).reshape(n, 2)


def test_a_linear_filter_gives_what_least_squares_of_all_samples_gives(tmp_path: Path) -> None:
    """The filter's transition and noise are series of the fifth order in the step: 1e-6 of the standard deviation."""
    path = tmp_path / "noise.toml"
    path.write_text(NOISE, encoding="utf-8")
    model, log = kf.build("gyro-static", noise=path), at_rest(np.arange(60) / 10.0)
    found = run(model, log, smooth=True)
    x, sd = batch(log, np.array([s.prior for s in model.states]))
    assert np.abs(found.estimate - x).max() < 1e-6 * sd.min()
    np.testing.assert_allclose(found.deviation, sd, rtol=1e-6)
    plain = run(model, log)
    assert np.abs(plain.estimate - x).max() > 0.1 * sd.min()  # the filter has not seen the later ones


def flight(seed: int) -> Log:
    model = kf.build("ins15")
    return simulate(DiscreteModel.at_rate(model, 50.0), "generic", 15.0, np.random.default_rng(seed))


@lru_cache
def program() -> Program:
    return program_over(kf.build("ins15"), flight(0))


def errors(found: FilterRun, log: Log) -> np.ndarray:
    """Of position and velocity, shape (n, 6)."""
    names = [f"{a}_{b}" for a in "pv" for b in "NED"]
    return np.column_stack([found.estimate[:, found.names.index(n)] - log.values(f"ref_{n}") for n in names])


@pytest.mark.long
def test_smoothed_errors_are_smaller_and_as_large_as_they_say() -> None:
    """Mean NEES of position and velocity in the middle of 12 flights: false alarms of a right smoother 1 in 1000."""
    nees, squares = [], []
    for seed in range(FLIGHTS):
        log = flight(seed)
        calls, forward = FilterCalls(program(), log), ForwardPass()
        plain = run(program(), log, wrap=forward.wrap)
        P = smoothed(plain, calls, forward).P[:, :6, :6]
        known = smoothing.of_all_readings(plain, calls, forward)
        e, before = errors(known, log), errors(plain, log)
        middle = log.n // 2
        nees.append(float(e[middle] @ np.linalg.solve(P[middle], e[middle])))
        after_start = slice(log.n // 5, -log.n // 5)
        squares.append([np.mean(d[after_start] ** 2, axis=0) for d in (e, before)])
        assert known.attitude is None or known.smoothed
    lo, hi = chi2.ppf([5e-4, 1.0 - 5e-4], 6 * FLIGHTS)
    assert lo < np.sum(nees) < hi
    after, filtered = np.mean(squares, axis=0).reshape(2, 2, 3).sum(axis=-1)  # of position and of velocity
    assert (after < 0.7 * filtered).all()


def test_the_end_is_the_filters_and_its_innovations_stay() -> None:
    log = flight(0)
    plain, known = run(program(), log), run(program(), log, smooth=True)
    np.testing.assert_array_equal(known.estimate[-1], plain.estimate[-1])
    np.testing.assert_allclose(known.deviation[-1], plain.deviation[-1])
    assert (known.deviation <= plain.deviation * (1.0 + 1e-6)).all()
    for name, sensor in plain.sensors.items():
        np.testing.assert_array_equal(known.sensors[name].innovation, sensor.innovation)
    assert known.attitude is not None
    assert plain.attitude is not None
    assert known.attitude.total < plain.attitude.total
    assert known.to_dict()["smoothed"] is True
    assert "smoothed" in known.summary()[0]


def test_a_gap_of_the_log_is_smoothed_step_by_step() -> None:
    """Half a second without any sample, of six steps: within it the smoother knows what comes after."""
    log = flight(0)
    there = (log.t < 6.0) | (log.t > 6.5)
    gappy = Log(log.t[there], {n: kf.Channel(c.values[there], c.unit) for n, c in log.channels.items()})
    known, plain = (run(program(), gappy, smooth=s) for s in (True, False))
    assert known.estimate.shape == plain.estimate.shape
    assert (known.deviation <= plain.deviation * (1.0 + 1e-6)).all()


def test_what_cannot_be_smoothed_is_refused_in_words(monkeypatch: pytest.MonkeyPatch) -> None:
    log = flight(0)
    with pytest.raises(InputError, match="a rule by which it adapts cannot be smoothed"):
        run(program(), log, adaptive="sage-husa", smooth=True)
    monkeypatch.setattr(smoothing, "MAX_BYTES", 1e6)
    with pytest.raises(InputError, match=r"takes .* GB of memory. Cut the log into \d+ parts"):
        run(program(), log, smooth=True)
