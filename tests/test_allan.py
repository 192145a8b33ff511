"""Proves the overlapping Allan deviation against published numbers, another program, and chance.

The 1000 numbers of NIST SP 1065 must give its table to every printed digit; random data must agree with
allantools to 1e-12; and the 95 % bands must hold the truth. The last is a Monte Carlo over 400 records of white
noise: the share inside is asked to lie in the central 99.9 % of the binomial at the nominal rate (false alarm 1e-3 for
each factor), widened by the 1.5 % by which chi-square bands with approximate degrees of freedom may be off.

A stream may be cut into chunks of any length, the loops may be compiled or not, a long record may be thinned, and
the samples may stand on a large offset or drift: each is held against the plain definition in extended precision.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator

import allantools
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import toeplitz
from scipy.signal import fftconvolve
from scipy.special import gammaln
from scipy.stats import binom

from kfgen.core.errors import InputError
from kfgen.identify.evidence import differences, running_allan
from kfgen.identify.evidence.allan import (
    allan_curve,
    curve_of_chunks,
    degrees_of_freedom,
    log_factors,
    octave_factors,
    overlapping_variance,
    variance_of_chunks,
)
from kfgen.log.readers.tables.table import chunks

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
    """How many of the bands hold the true Allan deviation of white noise, by factor."""
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


# Streams, kernels and thinning.

LONG = 300_000


@pytest.fixture
def thinned(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every record counts as a long one, and blocks are short, so that there are many."""
    monkeypatch.setattr(running_allan, "MAX_SAMPLES_EXACT", 0)
    monkeypatch.setattr(running_allan, "BUFFER_DIFFERENCES", 1 << 12)


@pytest.fixture(params=["numpy", "numba"])
def kernel(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    """Each of the two kernels in turn, whatever the length."""
    if request.param == "numba":
        pytest.importorskip("numba")
        monkeypatch.setattr(differences, "MIN_SAMPLES_FOR_COMPILED", 0)
    else:
        monkeypatch.setitem(sys.modules, "kfgen.identify.evidence.compiled", None)
    return str(request.param)


def record(kind: str, n: int = LONG) -> Array:
    rng = np.random.default_rng(11)
    w = rng.standard_normal(n)
    return {
        "white": w,
        "walk": np.cumsum(w),
        "quantisation": np.diff(w, prepend=0.0),
        "offset": w + 1e6,
        "ramp": w + 1e6 * np.arange(n) / n,
    }[kind]


def definition(y: Array, m: NDArray[np.int64], thin: bool) -> Array:
    """Eq. (11) of NIST SP 1065 in extended precision, at every point or at those of the stride."""
    x = np.concatenate([[0.0], np.cumsum(y.astype(np.longdouble) - np.longdouble(y.mean()))])
    out = []
    for k in m.tolist():
        s = running_allan.stride(k) if thin else 1
        z, q = x[::s], k // s
        d = z[2 * q :] - 2 * z[q:-q] + z[: -2 * q]
        out.append(float(np.mean(d * d) / (2 * k * k)))
    return np.array(out)


def cut(y: Array, pieces: str) -> Iterator[Array]:
    """`y` in chunks of one length, or of random ones with empty ones between them."""
    if pieces != "random":
        yield from chunks(y, int(pieces))
        return
    rng, start = np.random.default_rng(5), 0
    while start < y.size:
        n = int(rng.choice([0, 1, 7, 1000, 4096, 30_000]))
        yield y[start : start + n]
        start += n


@pytest.mark.usefixtures("thinned")
@pytest.mark.parametrize("pieces", ["997", "4096", "8192", "100001", "random"])
@pytest.mark.parametrize("known", [True, False])
def test_the_cut_into_chunks_does_not_matter(kernel: str, pieces: str, known: bool) -> None:
    y = record("walk", 100_003)
    m = log_factors(y.size)
    got = variance_of_chunks(cut(y, pieces), m, y.size if known else None)
    np.testing.assert_array_equal(got, overlapping_variance(y, m), err_msg=kernel)


@pytest.mark.parametrize("pieces", ["1", "1000", "random"])
@pytest.mark.parametrize("known", [True, False])
def test_a_short_stream_takes_every_difference(pieces: str, known: bool) -> None:
    y = record("white", 3001)
    m = np.array([1, 2, 129, 701, 1500])
    got = variance_of_chunks(cut(y, pieces), m, y.size if known else None)
    np.testing.assert_allclose(got, definition(y, m, thin=False), rtol=1e-12)


RTOL = {"white": 1e-12, "walk": 1e-12, "quantisation": 1e-11, "offset": 1e-12, "ramp": 1e-11}


@pytest.mark.parametrize("kind", RTOL)
def test_long_records_keep_their_digits(thinned: None, kernel: str, kind: str) -> None:
    """Against the definition in extended precision; a ramp of 1e6 sigma hides the noise, not the digits."""
    y = record(kind)
    m = log_factors(y.size)
    np.testing.assert_allclose(overlapping_variance(y, m), definition(y, m, thin=True), rtol=RTOL[kind])


def test_an_offset_costs_the_digits_of_the_samples_only(thinned: None, kernel: str) -> None:
    """1e6 sigma above zero, a sample is rounded to 1e-10 sigma; the variance is off by less than that."""
    m = log_factors(LONG)
    np.testing.assert_allclose(
        overlapping_variance(record("offset"), m), overlapping_variance(record("white"), m), rtol=1e-10
    )


@pytest.mark.parametrize("y", ["long", "short"])
def test_both_kernels_agree(monkeypatch: pytest.MonkeyPatch, y: str) -> None:
    pytest.importorskip("numba")
    values = record("walk", LONG if y == "long" else 20_000)
    monkeypatch.setattr(running_allan, "MAX_SAMPLES_EXACT", 100_000)
    m = log_factors(values.size)
    got = []
    for threshold in (0.0, float("inf")):
        monkeypatch.setattr(differences, "MIN_SAMPLES_FOR_COMPILED", threshold)
        got.append(overlapping_variance(values, m))
    np.testing.assert_allclose(got[0], got[1], rtol=1e-12)


def test_without_numba_numpy_takes_its_place(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "kfgen.identify.evidence.compiled", None)
    assert isinstance(differences.kernel(float("inf")), differences.NumpyKernel)


def test_a_short_record_does_not_pay_for_the_compiler() -> None:
    assert isinstance(differences.kernel(1_000_000), differences.NumpyKernel)


@pytest.mark.parametrize(("kind", "part"), [("white", 0.1), ("walk", 0.1), ("quantisation", 0.5)])
def test_thinning_is_far_below_the_statistical_error(thinned: None, kind: str, part: float) -> None:
    y = record(kind)
    m = log_factors(y.size)
    off = np.abs(overlapping_variance(y, m) / definition(y, m, thin=False) - 1.0)
    edf = degrees_of_freedom(y.size, m.astype(float), np.full(m.size, 1.0 if kind == "walk" else -1.0))
    assert (off < part * np.sqrt(2.0 / edf)).all()
    if kind != "quantisation":
        assert off[m < y.size / 50].max() < 0.01


@pytest.mark.usefixtures("thinned")
@pytest.mark.parametrize("m", [[1000], [999], [1, 131, 4097, 99_999], [3, 2048, 6001]])
def test_factors_that_are_no_multiples_are_computed_more_densely(m: list[int]) -> None:
    y, factors = record("white", 200_001), np.array(m)
    got = overlapping_variance(y, factors)
    exact = definition(y, factors, thin=False)
    edf = degrees_of_freedom(y.size, factors.astype(float), np.full(len(m), -1.0))
    assert (np.abs(got / exact - 1.0) < 0.1 * np.sqrt(2.0 / edf)).all()
    uneven = factors % 2 == 1
    np.testing.assert_allclose(got[uneven], exact[uneven], rtol=1e-11)


@pytest.mark.parametrize("kind", ["f4", "f8", ">f4", "i2"])
def test_any_kind_of_number(thinned: None, kernel: str, kind: str) -> None:
    y = (100 * record("white", 50_000)).astype(kind)
    y.setflags(write=False)
    m = octave_factors(y.size)
    wide = y.astype(np.float64)
    np.testing.assert_array_equal(variance_of_chunks([y[:333], y[333:]], m), overlapping_variance(wide, m))


def test_the_curve_of_a_stream_of_unknown_length(thinned: None) -> None:
    y = record("white", 100_000)
    curve = curve_of_chunks(chunks(y, 5000), 0.01)
    factors = np.round(curve.tau / 0.01).astype(np.int64)
    known = allan_curve(y, 0.01, factors)
    assert y.size / 4 < factors[-1] <= y.size / 3
    np.testing.assert_allclose(curve.deviation, known.deviation, rtol=1e-12)
    np.testing.assert_allclose(curve.hi, known.hi, rtol=1e-12)


def test_a_stream_shorter_than_a_factor_says_so() -> None:
    got = variance_of_chunks([np.arange(10.0)], np.array([1, 5, 6, 10**12]))
    np.testing.assert_array_equal(np.isnan(got), [False, False, True, True])


def test_another_number_of_samples_than_was_said_is_refused() -> None:
    with pytest.raises(InputError, match="9 samples came instead of 10"):
        variance_of_chunks([np.zeros(9)], np.array([1]), 10)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_a_sample_that_is_not_a_number_is_located(thinned: None, bad: float) -> None:
    y = record("white", 20_000)
    y[12_344] = bad
    with pytest.raises(InputError, match="sample 12345 is not a number"):
        variance_of_chunks(chunks(y, 1000), np.array([1, 200]))
