"""Proves the overlapping Allan deviation against published numbers, another program, and chance.

The 1000 numbers of NIST SP 1065 must give its table to every printed digit; random data must agree with
allantools to 1e-12; and the 95 % bands must hold the truth. The last is a Monte Carlo over 400 records of white
noise: the share inside is asked to lie in the central 99.9 % of the binomial at the nominal rate (false alarm 1e-3 for
each factor), widened by the 1.5 % by which chi-square bands with approximate degrees of freedom may be off.
"""

from __future__ import annotations

import allantools
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import toeplitz
from scipy.signal import fftconvolve
from scipy.special import gammaln
from scipy.stats import binom

from kfgen.errors import InputError
from kfgen.identify.allan import allan_curve, degrees_of_freedom, log_factors, overlapping_variance

Array = NDArray[np.float64]


@pytest.fixture(scope="module")
def nist() -> Array:
    """NIST SP 1065: n -> 16807 n mod 2147483647 from 1234567890, as fractions."""
    n, out = 1234567890, []
    for _ in range(1000):
        out.append(n / 2147483647)
        n = 16807 * n % 2147483647
    return np.array(out)


@pytest.mark.parametrize(
    ("factor", "printed"), [(1, "2.922319e-01"), (10, "9.159953e-02"), (100, "3.241343e-02")]
)
def test_nist_table(nist: Array, factor: int, printed: str) -> None:
    curve = allan_curve(nist, 1.0, np.array([factor]))
    assert f"{curve.deviation[0]:.6e}" == printed
    assert curve.tau[0] == factor


@pytest.mark.parametrize("kind", ["white", "walk", "offset", "tiny"])
def test_equal_to_allantools(kind: str) -> None:
    y = np.random.default_rng(3).standard_normal(5000)
    y = {"white": y, "walk": np.cumsum(y), "offset": y + 1e3, "tiny": 1e-9 * y}[kind]
    m, rate = np.array([1, 2, 3, 7, 50, 333, 1666]), 50.0
    curve = allan_curve(y, 1 / rate, m)
    tau, reference, _, _ = allantools.oadev(y - y.mean(), rate=rate, data_type="freq", taus=m / rate)
    np.testing.assert_allclose(curve.tau, tau, rtol=1e-12)
    np.testing.assert_allclose(curve.deviation, reference, rtol=1e-12)


def test_by_hand() -> None:
    """Averages of one: half the mean square of the differences; of two: (12, 3.5) -> by its definition."""
    y = np.array([1.0, 4.0, 2.0, 8.0, 5.0])
    assert overlapping_variance(y, np.array([1]))[0] == pytest.approx(np.mean(np.diff(y) ** 2) / 2, rel=1e-14)
    pairs = [(5.0 - 2.5) ** 2, (6.5 - 3.0) ** 2]  # mean(2,8) - mean(1,4), mean(8,5) - mean(4,2)
    assert overlapping_variance(y, np.array([2]))[0] == pytest.approx(np.mean(pairs) / 2, rel=1e-14)


@pytest.mark.parametrize("n", [9, 10, 100, 12345, 10_000_000])
def test_factors(n: int) -> None:
    m = log_factors(n)
    assert m[0] == 1
    assert n // 3 * (1 - 1 / 64) <= m[-1] <= n // 3  # thinned factors are rounded to one part in 64
    assert (np.diff(m) > 0).all()


def test_too_few_samples_are_refused() -> None:
    with pytest.raises(InputError, match="8 samples"):
        allan_curve(np.arange(8.0), 1.0)


def covariance(kind: str, n: int) -> Array:
    """Of n samples: white, random walk, or flicker as half an integration (a constant more does not matter)."""
    if kind == "white":
        return np.eye(n)
    if kind == "walk":
        return np.minimum.outer(np.arange(1.0, n + 1), np.arange(1.0, n + 1))
    k = np.arange(40000 + n)
    psi = np.exp(gammaln(k + 0.5) - gammaln(k + 1) - gammaln(0.5))
    return toeplitz(fftconvolve(psi, psi[::-1])[k.size - 1 : k.size - 1 + n])


@pytest.mark.parametrize("m", [1, 4, 16, 64, 200])
@pytest.mark.parametrize(("kind", "slope"), [("white", -1.0), ("flicker", 0.0), ("walk", 1.0)])
def test_degrees_of_freedom(kind: str, slope: float, m: int) -> None:
    """2 mean^2 / variance of the estimate, from its exact covariance: the published fits are good to 12 %."""
    n = 1024
    A = np.zeros((n - 2 * m + 1, n))
    for i in range(A.shape[0]):
        A[i, i : i + m], A[i, i + m : i + 2 * m] = -1.0, 1.0
    G = A @ covariance(kind, n) @ A.T
    exact = np.trace(G) ** 2 / np.sum(G**2)
    got = degrees_of_freedom(n, np.array([float(m)]), np.array([slope]))[0]
    assert got == pytest.approx(exact, rel=0.12)


RUNS, LENGTH = 400, 1000
FACTORS = np.array([1, 3, 10, 30, 100])


@pytest.fixture(scope="module")
def inside() -> Array:
    """How many of the bands hold the true deviation of white noise, by factor."""
    rng = np.random.default_rng(7)
    truth = 1.0 / np.sqrt(FACTORS)
    curves = [allan_curve(rng.standard_normal(LENGTH), 1.0, FACTORS) for _ in range(RUNS)]
    return np.sum([(c.lo <= truth) & (truth <= c.hi) for c in curves], axis=0)


@pytest.mark.parametrize("at", range(FACTORS.size))
def test_band_holds_the_truth(inside: Array, at: int) -> None:
    slack = 0.015
    lo, hi = binom.ppf(0.0005, RUNS, 0.95 - slack), binom.ppf(0.9995, RUNS, 0.95 + slack)
    assert lo <= inside[at] <= hi


def test_band_encloses_its_point() -> None:
    curve = allan_curve(np.random.default_rng(0).standard_normal(3000), 0.01)
    assert (curve.lo < curve.deviation).all()
    assert (curve.deviation < curve.hi).all()
    assert (np.diff((curve.hi / curve.lo)[::6]) > 0).all()
