"""A level that switches in slow noise, against sums over all histories; integrals by drawing, against known ones."""

from __future__ import annotations

from itertools import pairwise, product

import numpy as np
import pytest
from scipy.fft import dct
from scipy.linalg import expm, toeplitz
from scipy.signal import lfilter
from scipy.stats import kstest, multivariate_normal, multivariate_t

from kfgen.effects import make
from kfgen.effects.process import markov_chain as chain
from kfgen.effects.process.population_monte_carlo import integral
from kfgen.effects.process.switching_level import Slow, Switching, SwitchingParameters
from kfgen.effects.process.telegraph import RandomTelegraph
from kfgen.effects.series import WhiteSeries

DT, M = 0.5, 9


def point(**given: float) -> SwitchingParameters:
    values = {"size": 1.0, "dwell": 2.0, "middle": 0.2, "loud": 1.0, "wander": 1.0} | given
    return SwitchingParameters(**{name: np.array([v]) for name, v in values.items()})


def over_all_histories(y: np.ndarray, sigma: float, tau: float, sd: float) -> float:
    """The likelihood summed over 2^m histories of a level with exponential dwell times, exactly."""
    lags = np.arange(y.size) * DT
    noise = multivariate_normal(
        np.zeros(y.size), toeplitz(sigma**2 * np.exp(-lags / tau)) + sd**2 * np.eye(y.size)
    )
    change = 0.5 - 0.5 * np.exp(-2.0 * DT / 2.0)
    total = 0.0
    for history in product((0, 1), repeat=y.size):
        level = np.array(history)
        jumps = int(np.abs(np.diff(level)).sum())
        chance = 0.5 * change**jumps * (1.0 - change) ** (y.size - 1 - jumps)
        total += chance * noise.pdf(y - 0.2 - 1.0 * (level - 0.5))
    return float(np.log(total))


@pytest.mark.parametrize("seed", range(4))
def test_levels_in_white_noise_have_the_likelihood_of_all_histories(seed: int) -> None:
    y = np.random.default_rng(seed).standard_normal(M)
    cells = Switching(y, DT, 0.7, Slow.of([], DT))
    assert cells.log_likelihood(point())[0] == pytest.approx(over_all_histories(y, 0.0, 1.0, 0.7), abs=1e-9)


@pytest.mark.parametrize("seed", range(3))
def test_a_chain_has_the_likelihood_of_all_its_histories(seed: int) -> None:
    """Two levels of unequal share; the chances of a step are those of the rates' matrix exponential."""
    share, lasting = 0.3, 1.7
    rates = np.array([[-share / (1.0 - share), share / (1.0 - share)], [1.0, -1.0]]) / lasting
    T = expm(rates * DT)
    np.testing.assert_allclose(
        chain.transitions(np.array([share]), np.array([lasting]), DT)[0], T, rtol=1e-12
    )
    log_e = np.random.default_rng(seed).normal(0.0, 2.0, (M, 2))
    total = {True: 0.0, False: 0.0}
    for path in product((0, 1), repeat=M):
        first = share if path[0] else 1.0 - share
        steps = np.prod([T[a, b] for a, b in pairwise(path)])
        total[bool(path[4])] += first * steps * np.exp(sum(log_e[k, s] for k, s in enumerate(path)))
    value = chain.log_likelihood(log_e[:, None, :], T[None], np.array([share]))
    assert value[0] == pytest.approx(np.log(sum(total.values())), abs=1e-10)
    rng, odds = np.random.default_rng(seed), log_e[:, 1] - log_e[:, 0]
    often = np.mean([chain.history(odds, T, share, rng)[4] for _ in range(4000)])
    chance = total[True] / sum(total.values())
    assert abs(often - chance) < 4.5 * np.sqrt(chance * (1.0 - chance) / 4000)  # 1e-5


@pytest.mark.parametrize("seed", range(4))
def test_levels_in_slow_noise_have_it_nearly(seed: int) -> None:
    """Merged histories are no normal law: two hundredths of a nat are left, of gains of tens."""
    y = np.random.default_rng(seed).standard_normal(M)
    cells = Switching(y, DT, 0.7, Slow.of([make("gauss_markov", sigma=0.6, tau=3.0).form()], DT))
    assert cells.log_likelihood(point())[0] == pytest.approx(over_all_histories(y, 0.6, 3.0, 0.7), abs=0.02)


def test_innovations_are_white_and_normal_and_give_the_noise_back() -> None:
    """Kolmogorov's test at 1e-4, correlation within 4 / sqrt(m); without levels the noise is itself."""
    rng, m = np.random.default_rng(7), 3000
    t, slow = np.arange(m) * DT, make("gauss_markov", sigma=0.6, tau=9.0)
    noise = 0.7 * rng.standard_normal(m) + slow.simulate(t, rng)
    y = noise + 1.2 * (np.searchsorted(np.cumsum(rng.exponential(8.0, m)), t) % 2) - 0.6
    cells = Switching(y, DT, 0.7, Slow.of([slow.form()], DT))
    z = cells.innovations(point(size=1.2, dwell=8.0, middle=0.0))
    assert kstest(z, "norm").pvalue > 1e-4
    assert abs(np.corrcoef(z[1:], z[:-1])[0, 1]) < 4.0 / np.sqrt(m)
    alone = Switching(noise, DT, 0.7, cells.slow)
    nothing = point(size=0.0, middle=0.0)
    np.testing.assert_allclose(alone.quiet(nothing, alone.innovations(nothing)), noise, atol=1e-6)


@pytest.mark.parametrize("nu", [4.0, 200.0])
def test_a_law_integrates_to_one(nu: float) -> None:
    """Heavy and light tails, four arguments of scales from 1e-3 to 10, first points two standard deviations off."""
    mean, L = (
        np.array([1.0, -2.0, 0.5, 3.0]),
        np.diag([1e-3, 0.1, 1.0, 10.0]) @ (np.eye(4) + 0.4 * np.eye(4, k=-1)),
    )
    law = multivariate_t(mean, L @ L.T, nu)
    starts = mean + (2.0 + np.random.default_rng(2).standard_normal((60, 4))) * np.diag(L)
    found = integral(law.logpdf, starts)
    assert found is not None
    assert found.log == pytest.approx(0.0, abs=0.2)
    assert np.all(np.abs(found.mean - mean) < 4.0 * np.diag(L) / np.sqrt(10.0))


@pytest.mark.parametrize("held", [0.0, 0.7])
def test_levels_are_looked_for_in_even_noise_alone(held: float) -> None:
    """Of samples that a pole holds back the noise in the cells is not white: a sum over white samples says nothing."""
    rng, n = np.random.default_rng(8), 1500
    white = lfilter([np.sqrt(1.0 - held**2)], [1.0, -held], rng.standard_normal(n))
    y = white + 2.0 * (np.searchsorted(np.cumsum(rng.exponential(40.0, n)), np.arange(n)) % 2)
    omega = np.pi * np.arange(n) / n
    weight = np.sqrt((1.0 - 2.0 * held * np.cos(omega) + held**2) / (1.0 - held**2))
    weight[0] = 0.0
    weight /= np.sqrt(np.mean((dct(y, norm="ortho") * weight) ** 2))  # as a fit leaves it
    nothing = np.zeros(n)
    series = WhiteSeries(
        np.arange(n) * 1.0, y - y.mean(), 1.0, weight, nothing, np.zeros((n, 0)), (0.0, 1.0), {}
    )
    assert bool(RandomTelegraph.detect(series)) == (held == 0.0)
