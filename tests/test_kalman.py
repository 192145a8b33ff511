"""Proves that the exact likelihood is the Gaussian density it claims to be, whatever the times.

The reference is dense linear algebra, written down here from the covariance of each term: its determinant, its
solve, and the restricted likelihood of Patterson and Thompson (1971) for the constant of flat prior. Then records
made in plain numpy. Chance: 95 % intervals of N, sigma and tau hold the truth in at least 9 of 12 records of
fixed seeds each (0.2 % of right programs below) and in at least 30 of all 36 (0.3 %, as if independent); a mean of logarithms over k records stays within 4 bounds / sqrt(k) (6e-5).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.signal import lfilter

from kfgen.effects import Effect, make
from kfgen.identify.evidence import kalman
from kfgen.identify.evidence.kalman import chain
from kfgen.identify.evidence.record import Record
from kfgen.identify.evidence.sampling import evidence
from kfgen.identify.fit.bounds import relative_bound
from kfgen.identify.fit.fit import Problem, maximise
from kfgen.identify.identify import Identified, identify

Array = NDArray[np.float64]
DT = 0.1


# The density, written down.


def covariance(effects: Sequence[Effect], t: Array, dt: float) -> Array:
    """Of samples at times t, from the textbook covariance of each term."""
    n = t.size
    C = np.zeros((n, n))
    for e in effects:
        p: Any = e
        if e.name == "white_noise":
            C += p.N**2 / dt * np.eye(n)
        elif e.name == "gauss_markov":
            C += p.sigma**2 * np.exp(-np.abs(np.subtract.outer(t, t)) / p.tau)
        elif e.name == "rate_random_walk":
            C += p.K**2 * np.minimum.outer(t - t[0], t - t[0])
        elif e.name == "quantisation":  # differences of a white sequence, over dt
            C += (p.Q / dt) ** 2 * (2.0 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1))
    return C


def restricted(C: Array, y: Array, one: Array, X: Array | None = None) -> tuple[float, Array]:
    """Log-likelihood with the constant integrated out, less its powers of 2 pi; coefficients of X by GLS."""
    W = np.linalg.inv(C)
    P = W - np.outer(W @ one, one @ W) / (one @ W @ one)
    theta = np.linalg.solve(X.T @ P @ X, X.T @ P @ y) if X is not None else np.zeros(0)
    r = y - X @ theta if X is not None else y
    logdet = np.linalg.slogdet(C)[1] + np.log(one @ W @ one)
    return -0.5 * float(logdet + r @ P @ r), theta


MODELS: dict[str, tuple[Effect, ...]] = {
    "white": (make("white_noise", N=0.4),),
    "walk": (make("white_noise", N=0.4), make("rate_random_walk", K=0.3)),
    "markov": (make("white_noise", N=0.4), make("gauss_markov", sigma=0.8, tau=2.0)),
    "two markov": (
        make("white_noise", N=0.2),
        make("gauss_markov", sigma=0.5, tau=0.4),
        make("gauss_markov", sigma=2.0, tau=9.0),
    ),
    "short": (make("white_noise", N=0.4), make("gauss_markov", sigma=0.8, tau=0.02 * DT)),
    "long": (make("white_noise", N=0.4), make("gauss_markov", sigma=5.0, tau=1e5 * DT)),
    "all": (
        make("white_noise", N=0.1),
        make("gauss_markov", sigma=0.8, tau=1.0),
        make("rate_random_walk", K=0.2),
    ),
}


def times(kind: str, n: int = 100) -> Array:
    """Even, with gaps, or with every step a random multiple of dt / 64 not below dt."""
    rng = np.random.default_rng(11)
    if kind == "even":
        return np.arange(n) * DT
    if kind == "gaps":
        steps = np.where(np.isin(np.arange(n - 1), (17, 18, 60)), 1 + rng.integers(3, 200, n - 1), 1)
        return np.concatenate([[0.0], np.cumsum(steps)]) * DT
    return np.concatenate([[0.0], np.cumsum(64 + rng.integers(0, 150, n - 1))]) * DT / 64


def samples(n: int = 100) -> Array:
    rng = np.random.default_rng(5)
    return np.cumsum(0.1 * rng.standard_normal(n)) + rng.standard_normal(n)


@pytest.mark.parametrize("kind", ["even", "gaps", "uneven"])
@pytest.mark.parametrize("name", MODELS)
def test_likelihood_is_the_dense_one(name: str, kind: str) -> None:
    t, y, one = times(kind), samples(), np.ones(100)
    expected, _ = restricted(covariance(MODELS[name], t, DT), y, one)
    # The white noise that every model is given, 1e-10 of the variance, moves it by less than this.
    assert chain(t, y, DT).log_likelihood(MODELS[name]).value == pytest.approx(expected, abs=1e-5)


@pytest.mark.parametrize("kind", ["even", "gaps", "uneven"])
@pytest.mark.parametrize("name", ["white", "walk", "two markov"])
def test_regressors_are_generalised_least_squares(name: str, kind: str) -> None:
    t, y, one = times(kind), samples(), np.ones(100)
    X = np.column_stack([t, np.exp(-t / 2.0)])
    expected, theta = restricted(covariance(MODELS[name], t, DT), y, one, X)
    found = chain(t, y, DT, list(X.T)).log_likelihood(MODELS[name])
    assert found.value == pytest.approx(expected, abs=1e-5)
    np.testing.assert_allclose(found.coefficients, theta, rtol=1e-6)
    W = np.linalg.inv(covariance(MODELS[name], t, DT))
    P = W - np.outer(W @ one, one @ W) / (one @ W @ one)
    np.testing.assert_allclose(found.covariance, np.linalg.inv(X.T @ P @ X), rtol=1e-5)
    held = chain(t, y, DT, list(X.T)).log_likelihood(MODELS[name], np.array([0.3, -1.0]))
    expected, _ = restricted(covariance(MODELS[name], t, DT), y - X @ [0.3, -1.0], one)
    assert held.value == pytest.approx(expected, abs=1e-5)


@pytest.mark.parametrize("name", ["white", "walk", "two markov"])
def test_quantisation_is_the_dense_one(name: str) -> None:
    effects = (*MODELS[name], make("quantisation", Q=0.05))
    t, y = times("even"), samples()
    expected, _ = restricted(covariance(effects, t, DT), y, np.ones(100))
    assert chain(t, y, DT).log_likelihood(effects).value == pytest.approx(expected, abs=1e-5)


@pytest.mark.parametrize("offset", [0.0, 37.0, -1e4])
def test_the_constant_does_not_count(offset: float) -> None:
    t, y = times("gaps"), samples()
    plain = chain(t, y, DT).log_likelihood(MODELS["all"]).value
    assert chain(t, y + offset, DT).log_likelihood(MODELS["all"]).value == pytest.approx(plain, abs=1e-4)


@pytest.mark.parametrize("name", ["walk", "two markov"])
def test_steps_shorter_than_a_period_are_as_short_as_they_are(name: str) -> None:
    """Jittered and random times have steps below the period; their sum is the time that passed."""
    steps = np.random.default_rng(3).integers(5, 123, 99)
    t = np.concatenate([[0.0], np.cumsum(steps)]) * DT / 64
    expected, _ = restricted(covariance(MODELS[name], t, DT), samples(), np.ones(100))
    assert chain(t, samples(), DT).log_likelihood(MODELS[name]).value == pytest.approx(expected, abs=1e-5)


# Slopes.


@pytest.mark.parametrize("name", ["walk", "two markov", "all"])
def test_slope_is_the_difference_of_likelihoods(name: str) -> None:
    """Against a fourth-order difference of the dense likelihood, in each logarithm."""
    t, y, h = times("gaps"), samples(), 1e-2
    effects = MODELS[name]
    keys = [(i, p.name) for i, e in enumerate(effects) for p in e.estimated()]

    def dense(key: tuple[int, str], shift: float) -> float:
        moved = list(effects)
        values = {p.name: float(getattr(moved[key[0]], p.name)) for p in moved[key[0]].estimated()}
        values[key[1]] *= float(np.exp(shift))
        moved[key[0]] = make(moved[key[0]].name, **values)
        return restricted(covariance(moved, t, DT), y, np.ones(100))[0]

    expected = [
        (8 * (dense(k, h) - dense(k, -h)) - (dense(k, 2 * h) - dense(k, -2 * h))) / (12 * h) for k in keys
    ]
    np.testing.assert_allclose(chain(t, y, DT).slope(effects, keys), expected, rtol=1e-4, atol=1e-4)


# Blocks.


@pytest.mark.parametrize("kind", ["even", "gaps"])
@pytest.mark.parametrize("name", ["white", "walk", "all"])
def test_means_of_blocks_have_their_dense_likelihood(
    name: str, kind: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Blocks of four, none over a gap, and the differences inside them as independent of variance AVAR."""
    monkeypatch.setattr(kalman, "MAX_BLOCKS", 25)
    t, y = times(kind), samples()
    starts = np.flatnonzero(np.diff(t, prepend=-9.0) > 1.5 * DT).tolist()
    rows, haar = [], []
    for a, b in zip(starts, [*starts[1:], 100]):
        for s in range(a, b, 4):
            e = min(s + 4, b)
            rows.append((np.arange(100) >= s) & (np.arange(100) < e))
            if e - s == 4:
                p = y[s:e]
                haar += [
                    (DT, p[1] - p[0]),
                    (DT, p[3] - p[2]),
                    (2 * DT, 0.5 * (p[3] + p[2] - p[1] - p[0])),
                ]
    M = np.array(rows, float) / np.sum(rows, axis=1)[:, None]
    effects = MODELS[name]
    expected, _ = restricted(M @ covariance(effects, t, DT) @ M.T, M @ y, np.ones(len(rows)))
    for tau, d in haar:
        avar = sum(allan(e, tau) for e in effects)
        expected -= 0.5 * (np.log(avar) + 0.5 * d * d / avar)
    got = chain(t, y, DT)
    assert got.count.size == len(rows)
    assert got.log_likelihood(effects).value == pytest.approx(expected, abs=1e-5)


def allan(e: Effect, tau: float) -> float:
    """Table of docs/noise.md."""
    p: Any = e
    if e.name == "white_noise":
        return float(p.N**2 / tau)
    if e.name == "rate_random_walk":
        return float(p.K**2 * tau / 3)
    x, q2 = tau / p.tau, 2 * p.sigma**2 / p.tau
    return float(q2 * p.tau**2 / tau * (1 - (3 - 4 * np.exp(-x) + np.exp(-2 * x)) / (2 * x)))


def test_white_noise_in_blocks_loses_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    """Means and Haar differences are an orthogonal transform: the likelihood changes by a constant only."""
    y, t = samples(512), np.arange(512) * DT
    values = []
    for length in (4096, 64):
        monkeypatch.setattr(kalman, "MAX_BLOCKS", length)
        values.append(
            [chain(t, y, DT).log_likelihood([make("white_noise", N=N)]).value for N in (0.1, 0.3, 2.0)]
        )
    assert np.diff(values[0]) == pytest.approx(np.diff(values[1]), abs=1e-4)


# Records.


def white_and_markov(seed: int, t: Array, dt: float, truth: tuple[float, float, float]) -> Array:
    """White noise of density N^2 and an exact Gauss-Markov process at any increasing times."""
    N, sigma, tau = truth
    rng = np.random.default_rng([seed, 77])
    e = np.exp(-np.diff(t) / tau)
    if np.ptp(np.diff(t)) < 1e-9:
        w = sigma * rng.standard_normal(t.size)
        w[1:] *= np.sqrt(1 - e**2)
        x = np.asarray(lfilter([1.0], [1.0, -float(e[0])], w))
    else:
        x = np.empty(t.size)
        x[0] = sigma * rng.standard_normal()
        for i, w in enumerate(rng.standard_normal(t.size - 1)):
            x[i + 1] = e[i] * x[i] + sigma * np.sqrt(1 - e[i] ** 2) * w
    return np.asarray(x + N / np.sqrt(dt) * rng.standard_normal(t.size))


TRUTH = (1.0, 1.5, 2.0)
NAMES = ["white_noise", "gauss_markov"]


def fitted(found: Identified) -> Array:
    e: Any = found.fit.effects
    return np.array([e[0].N, e[1].sigma, e[1].tau])


def test_blocks_change_an_estimate_little(monkeypatch: pytest.MonkeyPatch) -> None:
    """In blocks of eight, a tenth of tau, the estimates move by less than a third of their bound."""
    t = np.arange(4096) * DT
    record = Record(t, white_and_markov(3, t, DT, (1.0, 1.5, 8.0)))
    plain = identify(record, NAMES, "kalman")
    monkeypatch.setattr(kalman, "MAX_BLOCKS", 512)
    blocked = identify(record, NAMES, "kalman")
    bounds = np.array(list(plain.bounds.values()))
    assert (np.abs(np.log(fitted(blocked) / fitted(plain))) < bounds / 3).all()


@pytest.mark.parametrize(("runs", "least"), [(3, 6), pytest.param(12, 30, marks=pytest.mark.long)])
def test_intervals_hold_the_truth_with_a_fifth_missing(runs: int, least: int) -> None:
    """And N is where it was, while straight lines over the gap take a tenth of it away.

    Of intervals of 95 %, fewer than `least` hold in two of a thousand such tests.
    """
    n = 1500
    t = np.arange(n) * DT
    keep = (t < 50.0) | (t >= 80.0)
    inside, logs, lines = np.zeros(3, int), [], []
    for seed in range(runs):
        y = white_and_markov(seed, t, DT, TRUTH)
        got, said = evidence(t[keep], y[keep])
        found = identify(got, NAMES)
        assert any("1 gaps" in w or "1 gap" in w for w in said)
        for i, key in enumerate([(0, "N"), (1, "sigma"), (1, "tau")]):
            lo, hi = found.intervals[key]
            inside[i] += lo <= TRUTH[i] <= hi
        logs.append(np.log(fitted(found) / TRUTH))
        updated = identify(Record(t, np.interp(t, t[keep], y[keep])), NAMES)
        lines.append(np.log(fitted(updated)[0]))
    assert inside.sum() >= least
    bound = relative_bound([make("white_noise", N=1.0), make("gauss_markov", sigma=1.5, tau=2.0)], DT, 1200)
    standard = bound[0, "N"] / np.sqrt(runs)
    assert abs(np.mean(logs, axis=0)[0]) < 4 * standard
    assert np.mean(lines) < -4 * standard


@pytest.mark.parametrize("seed", range(3))
def test_kalman_and_whittle_agree_on_an_even_record(seed: int) -> None:
    """Within a tenth of the interval, in the logarithm."""
    t = np.arange(4096) * DT
    record = Record(t, white_and_markov(seed, t, DT, TRUTH))
    a, b = identify(record, NAMES, "kalman"), identify(record, NAMES)
    width = np.array([np.log(hi / lo) for lo, hi in b.intervals.values()])
    assert (np.abs(np.log(fitted(a) / fitted(b))) < 0.1 * width).all()


def test_the_maximum_at_random_times_is_that_of_the_dense_likelihood() -> None:
    """Sampled as a Poisson process: each logarithm within 0.05 (lengthened steps would make tau a fifth longer)."""
    rng = np.random.default_rng([1, 5])
    t = np.cumsum(rng.exponential(DT, 300))
    y = white_and_markov(1, t, DT, (0.1, 1.0, 2.0))
    got, said = evidence(t, y)
    assert isinstance(got, kalman.Exact)
    assert any("jitter" in w for w in said)
    start = (make("white_noise", N=0.1), make("gauss_markov", sigma=1.0, tau=2.0))
    found = maximise(Problem(got, start))

    def loss(p: Array) -> float:
        N, sigma, tau = np.exp(p).tolist()
        effects = (make("white_noise", N=N), make("gauss_markov", sigma=sigma, tau=tau))
        return -restricted(covariance(effects, t, got.dt), y, np.ones(t.size))[0]

    best = minimize(
        loss, np.log([0.1, 1.0, 2.0]), method="Nelder-Mead", options={"xatol": 1e-4, "fatol": 1e-7}
    )
    assert loss(found.point) > best.fun - 1e-4, "the reference is no maximum"
    assert found.point == pytest.approx(best.x, abs=0.05)
