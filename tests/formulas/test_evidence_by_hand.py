"""Proves the parts of a likelihood and of an Allan curve number by number, beside dense linear algebra and tables.

A record of a few dozen samples has a covariance that can be written down in full: the exact likelihood is its density.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import toeplitz
from scipy.stats import chi2

from kfgen.core import linear
from kfgen.core.errors import InputError
from kfgen.effects import make
from kfgen.identify.evidence.allan import (
    AllanCurve,
    allan_curve,
    curve_from_variance,
    curve_of_chunks,
    degrees_of_freedom,
    log_factors,
    octave_factors,
    pooled,
)
from kfgen.identify.evidence.block_differences import differences_inside
from kfgen.identify.evidence.kalman import Chain, Exact, _edges, chain
from kfgen.identify.evidence.record import Record
from kfgen.identify.evidence.shapes import Shapes
from kfgen.identify.evidence.whittle import (
    Ordinates,
    block_means,
    coarse_transform,
    density_of_differences,
    frequencies,
    least_squares,
    ordinates,
    residual_power,
    residual_ratio,
    transform,
)

Array = NDArray[np.float64]
RNG = np.random.default_rng(21)
WHITE, SLOW = make("white_noise", N=0.3), make("gauss_markov", sigma=0.8, tau=2.0)
STEPS, WALK = make("quantisation", Q=0.02), make("rate_random_walk", K=0.2)


# Whittle's likelihood.


def some_ordinates() -> Ordinates:
    """Four ordinates in three bins, of a record and one regressor."""
    x, b = np.array([1.0, -2.0, 0.5, 1.5]), np.array([0.4, 0.1, -0.3, 0.2])
    at = [0, 1, 2]
    gram = np.array(
        [
            [np.add.reduceat(x * x, at), np.add.reduceat(x * b, at)],
            [np.add.reduceat(b * x, at), np.add.reduceat(b * b, at)],
        ]
    ).transpose(2, 0, 1)
    return Ordinates(np.array([0.5, 1.0, 2.0]), np.array([1.0, 1.0, 2.0]), gram, 0.1, 1)


def test_the_likelihood_of_ordinates_in_full() -> None:
    """``-1/2 sum (count ln S + X^2 / S)`` of white noise: ``S = 4 sin^2(w / 2) N^2 / dt``; slope and information too."""
    o = some_ordinates()
    S = 4.0 * np.sin(0.5 * o.omega) ** 2 * 0.09 / 0.1
    assert o.n == 4
    assert o.frequency == pytest.approx(o.omega / (2.0 * np.pi * 0.1))
    assert o.part(WHITE) == pytest.approx(S)
    assert o.density([WHITE]) == pytest.approx(S)
    assert density_of_differences([WHITE], o.omega, 0.1, 1) == pytest.approx(S)
    xx, xb, bb = (float(np.sum(o.gram[:, i, j] / S)) for i, j in ((0, 0), (0, 1), (1, 1)))
    fit = o.log_likelihood([WHITE])
    assert fit.coefficients == pytest.approx([xb / bb])
    assert fit.covariance == pytest.approx(np.array([[1.0 / bb]]))
    assert fit.value == pytest.approx(-0.5 * (o.count @ np.log(S) + xx - xb**2 / bb))
    given = o.log_likelihood([WHITE], np.array([2.0]))
    assert given.value == pytest.approx(-0.5 * (o.count @ np.log(S) + xx - 4.0 * xb + 4.0 * bb))
    key = [(0, "N")]
    h = 1e-6
    up, down = (o.log_likelihood([make("white_noise", N=0.3 * math.exp(s))]).value for s in (h, -h))
    assert o.slope([WHITE], key) == pytest.approx([(up - down) / (2.0 * h)], rel=1e-5)
    assert o.information([WHITE], key) == pytest.approx(np.array([[0.5 * 4.0 * 4]]))
    assert o.relative_slopes([WHITE], key) == pytest.approx(2.0 * np.ones((1, 3)))


def test_where_a_filter_stops_the_density_is_what_is_seen() -> None:
    """In the bin of two ordinates nothing passes: there S is the power of the record over its count, and fits nothing.

    At 2 rad per sample, 3.2 Hz, a low-pass of second order of 0.35 Hz passes 1.5e-4 of the power; at 1.6 Hz 2e-3.
    """
    o = some_ordinates()
    o.__dict__["_shapes"] = Shapes(
        lambda e: np.full(3, float(e.name == "white_noise")), lambda _: np.array([0.5, 1.0, 1e-30])
    )
    both = [WHITE, make("low_pass", corner=0.35, order=2)]
    S = np.array([0.5 * 0.09, 0.09, (0.25 + 2.25) / 2.0])
    assert o.density(both) == pytest.approx(S)
    assert o.weight(both) == pytest.approx([1.0 / S[0], 1.0 / S[1], 0.0])
    fit = o.log_likelihood(both)
    xx, xb, bb = 1.0 / S[0] + 4.0 / S[1], 0.4 / S[0] - 0.2 / S[1], 0.16 / S[0] + 0.01 / S[1]
    assert fit.coefficients == pytest.approx([xb / bb])
    assert fit.value == pytest.approx(-0.5 * (o.count @ np.log(S) + xx - xb**2 / bb + 2.0))
    assert o.information(both, [(0, "N")]) == pytest.approx(np.array([[0.5 * 4.0 * 2]]))


def test_power_that_is_left_without_a_regressor() -> None:
    o = some_ordinates()
    left = o.gram[:, 0, 0] - 4.0 * o.gram[:, 0, 1] + 4.0 * o.gram[:, 1, 1]
    assert residual_power(o, np.array([2.0])) == pytest.approx(left)
    expected = left / (o.count * o.density([WHITE]))
    assert residual_ratio(o, [WHITE], np.array([2.0])) == pytest.approx(expected)


def test_least_squares_of_products() -> None:
    """Two regressors of which one is twice the other: the shortest solution, the misfit of the space they span."""
    b = RNG.standard_normal(9)
    x = RNG.standard_normal(9)
    rows = np.array([x, b, 2.0 * b])
    theta, covariance, misfit = least_squares(rows @ rows.T)
    along = float(x @ b / (b @ b))
    assert theta == pytest.approx(along * np.array([0.2, 0.4]))
    assert covariance == pytest.approx(np.linalg.pinv(rows[1:] @ rows[1:].T), rel=1e-6)
    assert misfit == pytest.approx(float(x @ x - along**2 * b @ b))
    none = least_squares(np.array([[4.0]]))
    assert none[0].size == 0
    assert none[2] == 4.0


def test_means_of_blocks() -> None:
    y = np.arange(7.0)
    assert block_means(y, 1) is y
    assert block_means(y, 3).tolist() == [1.0, 4.0]
    assert block_means(np.column_stack([y, 2.0 * y]), 2).tolist() == [[0.5, 1.0], [2.5, 5.0], [4.5, 9.0]]


def test_sine_coefficients_of_differences() -> None:
    """Orthonormal: ``sqrt(2 / (n + 1)) sum_k d_k sin(pi j k / (n + 1))``."""
    y = RNG.standard_normal(6)
    d, k = np.diff(y), np.arange(1, 6)
    expected = [math.sqrt(2.0 / 6.0) * float(d @ np.sin(np.pi * j * k / 6.0)) for j in k]
    assert transform(y) == pytest.approx(expected)
    assert frequencies(5) == pytest.approx(np.pi * k / 6.0)


def test_low_coefficients_of_a_slow_function_from_its_cells() -> None:
    """Of a parabola over 4,000 samples in 100 cells, at their edges: the first 25, to a part in a thousand."""
    n = 4000
    t = np.arange(n + 1) / n
    fine = transform(t**2)
    coarse = coarse_transform(np.linspace(0.0, 1.0, 101) ** 2, fine.size)
    assert coarse.size == 25
    assert coarse[:4] == pytest.approx(fine[:4], rel=2e-3)
    assert coarse_transform(np.arange(3.0), 50).size == 1
    assert coarse_transform(np.arange(43.0), 500).size == 10
    assert coarse_transform(np.arange(41.0), 5).size == 5


def test_bins_count_what_is_in_them() -> None:
    """Of 200 ordinates 96 stand alone; ``int(48 log10(200 / 96)) + 1 = 16`` edges lie above, and centres are means."""
    x = RNG.standard_normal(200)
    o = ordinates([x, x[:50]], 0.01)
    assert o.n == 200
    assert o.count.size == 96 + 15
    assert o.gram[:, 0, 0].sum() == pytest.approx(x @ x)
    assert o.gram[:, 0, 1].sum() == pytest.approx(x[:50] @ x[:50])
    assert (o.gram == o.gram.transpose(0, 2, 1)).all()
    every = np.arange(1, 201) * np.pi / 201
    assert o.omega[:96] == pytest.approx(every[:96])
    assert float(o.count @ o.omega) == pytest.approx(every.sum())
    wide = ordinates([x], 0.01, per_decade=6)
    assert wide.count.size == 96 + 1


def test_a_band_is_left_out_at_its_edges_too() -> None:
    """Of ordinates at exactly 1, 2, ... Hz those from 3 to 5 Hz are three; a band that begins below zero takes the first."""
    n, dt = 9, 0.05
    x = np.arange(1.0, n + 1.0)
    o = ordinates([x], dt, skip=((2.9, 5.1),))
    assert o.frequency == pytest.approx([1.0, 2.0, 6.0, 7.0, 8.0, 9.0])
    assert ordinates([x], dt, skip=((-1.0, 1.5), (8.5, math.inf))).frequency == pytest.approx(
        np.arange(2.0, 9.0)
    )
    two = ordinates([x], dt, 2, skip=((1.4, 2.6),))
    assert two.frequency == pytest.approx([0.5, 1.0, 3.0, 3.5, 4.0, 4.5])


# Shapes of effects.


def test_slopes_of_shapes_in_logarithms() -> None:
    """Of a size 2 S; of a time as by differences; of a regressor none; under a filter times what it passes."""
    w = np.array([0.3, 1.0])
    shapes = Shapes(lambda e: e.sampled_density(w, 0.1))
    assert shapes.slopes([WHITE], [(0, "N")])[0] == pytest.approx(2.0 * shapes.of(WHITE))
    h = 1e-4
    up, down = (
        make("gauss_markov", sigma=0.8, tau=2.0 * math.exp(s)).sampled_density(w, 0.1) for s in (h, -h)
    )
    found = shapes.slopes([WHITE, SLOW], [(1, "tau"), (1, "sigma")])
    assert found[0] == pytest.approx((up - down) / (2.0 * h), rel=1e-5)
    assert found[1] == pytest.approx(2.0 * shapes.of(SLOW))
    assert shapes.total([WHITE, SLOW]) == pytest.approx(shapes.of(WHITE) + shapes.of(SLOW))
    assert shapes.total([]) == pytest.approx(np.finfo(float).tiny)
    assert shapes.factor([WHITE]) == 1.0


def test_what_a_filter_passes_is_a_factor() -> None:
    """A made one that passes ``1 / (1 + corner)``: the sum is divided, and its slope is that of the quotient."""
    w = np.array([0.3, 1.0])
    low = make("low_pass", corner=3.0)
    assert low.is_filter
    shapes = Shapes(
        lambda e: e.sampled_density(w, 0.1),
        lambda es: np.full(2, math.prod(1.0 / (1.0 + e.corner) for e in es)),  # type: ignore[attr-defined]
    )
    assert shapes.factor([WHITE, low]) == pytest.approx(0.25)
    assert shapes.total([WHITE, low]) == pytest.approx(0.25 * shapes.of(WHITE))
    found = shapes.slopes([WHITE, low], [(0, "N"), (1, "corner")])
    assert found[0] == pytest.approx(0.5 * shapes.of(WHITE))
    assert found[1] == pytest.approx(-3.0 / 16.0 * shapes.of(WHITE), rel=1e-6)
    both = [WHITE, low, make("low_pass", corner=1.0)]
    assert shapes.slopes(both, [(1, "corner")])[0] == pytest.approx(-3.0 / 32.0 * shapes.of(WHITE), rel=1e-6)


# Allan curves.


def test_factors_are_spaced_in_the_logarithm() -> None:
    assert log_factors(3).tolist() == [1]
    assert log_factors(5).tolist() == [1]
    assert log_factors(6).tolist() == [1, 2]
    assert log_factors(30, 1).tolist() == [1, 10]
    assert log_factors(300, 1).tolist() == [1, 10, 100]
    many = log_factors(3000, 12)
    assert many[-1] == 1000
    assert np.all(np.diff(many) > 0)
    assert np.abs(np.log10(many[12:]) * 12 - np.round(np.log10(many[12:]) * 12)).max() < 0.3
    assert octave_factors(5).tolist() == [1, 2]
    assert octave_factors(12).tolist() == [1, 2]
    assert octave_factors(100).tolist() == [1, 2, 4, 8, 16]


def test_an_allan_curve_by_hand() -> None:
    """Of 1, 2, 4, 8, ... (nine samples) the mean of half the squared second differences of the sums."""
    y = 2.0 ** np.arange(9)
    curve = allan_curve(y, 0.5, np.array([1, 2, 4, 5]))
    expected = []
    for m in (1, 2, 4):
        means = np.convolve(y, np.ones(m) / m, "valid")
        expected.append(0.5 * np.mean((means[m:] - means[:-m]) ** 2))
    assert curve.tau == pytest.approx([0.5, 1.0, 2.0])
    assert curve.deviation**2 == pytest.approx(expected)
    with pytest.raises(InputError, match="8 samples give no Allan deviation"):
        allan_curve(y[:8], 0.5)
    parts = curve_of_chunks([y[:2], y[2:7], y[7:]], 0.5)
    whole = curve_of_chunks([y], 0.5, 9)
    assert parts.deviation == pytest.approx(whole.deviation)
    assert whole.tau == pytest.approx([0.5, 1.0, 1.5])


def test_bands_of_a_curve_are_chi_square() -> None:
    avar, m = np.array([4.0, 2.0, 1.0]), np.array([1, 2, 4])
    curve = curve_from_variance(avar, 50, m, 0.1)
    edf = degrees_of_freedom(50, m.astype(float), np.full(3, -1.0))
    assert curve.edf == pytest.approx(edf)
    assert curve.lo == pytest.approx(np.sqrt(avar * edf / chi2.ppf(0.975, edf)))
    assert curve.hi == pytest.approx(np.sqrt(avar * edf / chi2.ppf(0.025, edf)))
    single = curve_from_variance(avar[:1], 50, m[:1], 0.1)
    assert single.edf == pytest.approx(edf[:1])
    rising = curve_from_variance(np.array([1.0, 2.0]), 50, m[:2], 0.1)
    assert rising.edf == pytest.approx(degrees_of_freedom(50, m[:2].astype(float), np.ones(2)))


def test_degrees_of_freedom_at_their_ends() -> None:
    """Never below one; the kinds of noise meet at slopes of -1/2 and 1/2."""
    one, two = np.array([1.0]), np.array([2.0])
    assert degrees_of_freedom(9, np.array([6.0]), np.array([0.0]))[0] == 1.0  # 405 / (24 27)
    walk = 10 / 2.0 * (11**2 - 3 * 2 * 11 + 4 * 4) / 9**2
    assert degrees_of_freedom(12, two, np.array([0.5]))[0] == pytest.approx(walk)
    flicker = 5.0 * 144 / (8.0 * (12 + 6.0))
    assert degrees_of_freedom(12, two, np.array([-0.5]))[0] == pytest.approx(flicker)
    assert degrees_of_freedom(12, one, np.array([0.0]))[0] == pytest.approx(2.0 * 100 / (2.3 * 12 - 4.9))
    white = (3.0 * 11 / 4.0 - 2.0 * 10 / 12) * 16.0 / 21.0
    assert degrees_of_freedom(12, two, np.array([-0.51]))[0] == pytest.approx(white)


def test_curves_are_pooled_by_their_degrees_of_freedom() -> None:
    a = AllanCurve(np.array([1.0, 2.0]), np.array([3.0, 1.0]), *np.zeros((2, 2)), np.array([10.0, 4.0]))
    b = AllanCurve(np.array([1.0]), np.array([1.0]), *np.zeros((2, 1)), np.array([30.0]))
    found = pooled([b, a])
    assert found.tau.tolist() == [1.0, 2.0]
    assert found.edf.tolist() == [40.0, 4.0]
    assert found.deviation**2 == pytest.approx([(10.0 * 9.0 + 30.0) / 40.0, 1.0])
    assert found.lo[0] ** 2 == pytest.approx(3.0 * 40.0 / chi2.ppf(0.975, 40.0))
    assert found.hi[0] ** 2 == pytest.approx(3.0 * 40.0 / chi2.ppf(0.025, 40.0))


# The exact likelihood.


def dense(t: Array, y: Array, dt: float, columns: Array, white: float) -> tuple[float, Array]:
    """Of white noise and the slow process at these times, with a flat constant and columns at their best."""
    C = 0.64 * np.exp(-np.abs(t[:, None] - t) / 2.0) + white * np.eye(t.size)
    L = np.linalg.cholesky(C)
    X = np.linalg.solve(L, np.column_stack([np.ones(t.size), columns]))
    z = np.linalg.solve(L, y)
    theta, *_ = np.linalg.lstsq(X, z, rcond=None)
    left = z - X @ theta
    flat = 0.5 * math.log(float(X[:, 0] @ X[:, 0]))
    return -float(np.log(np.diag(L)).sum()) - 0.5 * float(left @ left) - flat, theta[1:]


TIMES = np.r_[np.arange(12) * 0.25, 4.0 + np.arange(9) * 0.25]


def test_the_exact_likelihood_is_the_density_of_all_samples() -> None:
    """Of 21 samples with a gap, and a ramp beside them; a constant that was added changes nothing."""
    y, ramp = RNG.standard_normal(21), TIMES - 3.0
    c = chain(TIMES, y, 0.25, [ramp], blocks=False)
    white = 0.09 / 0.25 + 1e-10 * float(np.var(y))
    expected, theta = dense(TIMES, y, 0.25, ramp[:, None], white)
    fit = c.log_likelihood([WHITE, SLOW])
    assert fit.value == pytest.approx(expected, rel=1e-9)
    assert fit.coefficients == pytest.approx(theta, rel=1e-7)
    shifted = chain(TIMES + 5.0, y + 7.0, 0.25, [ramp], blocks=False).log_likelihood([WHITE, SLOW])
    assert shifted.value == pytest.approx(expected, rel=1e-7)
    given = c.log_likelihood([WHITE, SLOW], fit.coefficients + 1.0)
    assert given.value == pytest.approx(fit.value - 0.5 / fit.covariance[0, 0], rel=1e-6)


def test_slopes_of_the_exact_likelihood() -> None:
    y = RNG.standard_normal(21)
    c = chain(TIMES, y, 0.25, blocks=False)
    h = 1e-4
    up, down = (
        c.log_likelihood([WHITE, make("gauss_markov", sigma=0.8, tau=2.0 * math.exp(s))]).value
        for s in (h, -h)
    )
    found = c.slope([WHITE, SLOW], [(1, "tau"), (0, "N")])
    assert found[0] == pytest.approx((up - down) / (2.0 * h), rel=1e-6)
    assert found.shape == (2,)


def test_steps_of_the_integral_in_the_exact_likelihood() -> None:
    """White noise and quantisation of even samples: covariance 2 q on the diagonal, -q beside it, ``q = (Q / dt)^2``."""
    n, dt = 20, 0.25
    y = RNG.standard_normal(n)
    q, white = (0.02 / dt) ** 2, 0.09 / dt + 1e-10 * float(np.var(y))
    C = toeplitz(np.r_[white + 2.0 * q, -q, np.zeros(n - 2)])
    L = np.linalg.cholesky(C)
    z, one = np.linalg.solve(L, y), np.linalg.solve(L, np.ones(n))
    left = z - one * (one @ z) / (one @ one)
    expected = -float(np.log(np.diag(L)).sum()) - 0.5 * float(left @ left) - 0.5 * math.log(one @ one)
    found = chain(np.arange(n) * dt, y, dt, blocks=False).log_likelihood([WHITE, STEPS]).value
    assert found == pytest.approx(expected, rel=1e-9)


def test_white_noise_alone_has_no_state() -> None:
    n, dt = 10, 0.5
    y = RNG.standard_normal(n)
    v = 0.09 / dt + 1e-10 * float(np.var(y))
    expected = -0.5 * n * math.log(v) - 0.5 * float(np.sum((y - y.mean()) ** 2)) / v - 0.5 * math.log(n / v)
    assert chain(np.arange(n) * dt, y, dt, blocks=False).log_likelihood([WHITE]).value == pytest.approx(
        expected
    )


def test_what_cannot_be_is_impossible() -> None:
    c = chain(np.arange(10) * 0.5, np.zeros(10), 0.5, [np.arange(10.0)], blocks=False)  # no noise at all
    found = c.log_likelihood([])
    assert found.value == -math.inf
    assert found.coefficients.shape == (1,)
    assert found.covariance.shape == (1, 1)


def test_blocks_never_reach_over_a_gap() -> None:
    """Of three a block, with a gap behind the fourth: 0-2, 3, 4-6, 7-8."""
    missing = np.array([0.0, 0.0, 0.0, 5.0, 0.0, 0.0, 0.0, 0.0])
    assert _edges(missing, 9, 3, 1.0).tolist() == [0, 3, 4, 7, 9]
    assert _edges(missing, 9, 1, 1.0).tolist() == list(range(10))
    assert _edges(np.where(missing > 0, 0.5, 0.0), 9, 3, 1.0).tolist() == [0, 3, 6, 9]


def test_differences_inside_blocks() -> None:
    """Of 1, 3, 2, 6: (2, 4) within pairs, of mean half square 5; 2 between their means, of half square 2."""
    y = np.array([1.0, 3.0, 2.0, 6.0])
    found = differences_inside(y, np.array([0]), 2, 0, 0.25)
    assert found.count.tolist() == [2.0, 1.0]
    assert found.variance.tolist() == [5.0, 2.0]
    assert differences_inside(y, np.array([0]), 2, 1, 0.25).count.tolist() == [0.0, 1.0]
    assert differences_inside(y, np.zeros(0, int), 2, 0, 0.25).count.tolist() == [0.0, 0.0]


def test_a_chain_of_blocks() -> None:
    """Below two periods nothing is looked at: pairs, with steps between their beginnings."""
    y = np.arange(9.0)
    t = np.r_[np.arange(5), 7.0 + np.arange(4)] * 0.5
    c = chain(t, y, 0.5, shortest=1.0)
    assert c.count.tolist() == [2, 2, 1, 2, 2]
    assert c.y[:, 0].tolist() == [0.5, 2.5, 4.0, 5.5, 7.5]
    assert c.y[:, 1].tolist() == [1.0] * 5
    assert c.step.tolist() == [1.0, 1.0, 1.5, 1.0, 0.5]
    assert (c.n, c.dt) == (9, 0.5)
    pairs, kind = c.kinds
    assert pairs[kind].tolist() == [[2, 1], [2, 1], [1, 1.5], [2, 1], [2, 0.5]]
    late = chain(np.array([0.0, 0.51, 0.99]), np.zeros(3), 0.5, blocks=False)
    assert late.step == pytest.approx([33 / 64, 31 / 64, 0.5], rel=0.05)
    assert np.round(late.step / 0.5 * 64) == pytest.approx(late.step / 0.5 * 64)
    together = chain(np.array([0.0, 0.001, 0.5]), np.zeros(3), 0.5, blocks=False)
    assert together.step[0] == pytest.approx(0.5 / 64)


def test_a_record_of_uneven_time_says_what_it_is() -> None:
    view = Record(TIMES, np.arange(21.0))
    e = Exact(TIMES, np.arange(21.0), {}, 0.25, view)
    assert (e.dt, e.step, e.skip, e.lengths) == (0.25, 0.25, (), (21,))
    low = Exact(TIMES, np.arange(21.0), {}, 0.25, view, shortest=1.0)
    assert (low.step, low.skip) == (1.0, ((1.0, math.inf),))
    assert e.scale == pytest.approx(np.std(np.arange(21.0)))
    ramp = make("rate_ramp", R=1.0)
    measured = e.measure([ramp])
    assert isinstance(measured, Chain)
    assert measured.y.shape == (21, 3)
    assert np.diff(measured.y[:, 2]) == pytest.approx(np.diff(TIMES), rel=1e-6)


def test_information_of_what_is_asked_for() -> None:
    """Half of 4 n of white noise alone; a key that is unknown has none."""
    c = chain(np.arange(400) * 0.5, RNG.standard_normal(400), 0.5, blocks=False)
    J = c.information([WHITE], [(0, "N"), (3, "tau")])
    assert J[0, 0] == pytest.approx(2.0 * 400, rel=0.01)
    assert J[1].tolist() == [0.0, 0.0]


# Linear systems.


def test_terms_of_a_series() -> None:
    """``(2 n)^k / (k + 1)!`` below 2e-17: of 0.25 ten or more, of nothing one."""
    assert linear._terms(0.0) == 1
    terms = linear._terms(0.25)
    following = [0.25 * math.prod(0.5 / (k + 1) for k in range(2, m + 1)) for m in range(1, 40)]
    assert terms == 1 + next(k for k, f in enumerate(following) if f <= 2e-17)


def test_what_is_no_number_stays_none() -> None:
    Phi, Qd = linear.van_loan(np.full((2, 2), np.nan), np.eye(2), 1.0)
    assert np.isnan(Phi).all()
    assert np.isnan(Qd).all()
    Phi, Qd = linear.van_loan(np.full((2, 2), np.nan), np.eye(2), np.array([1.0, 2.0, 3.0]))
    assert Phi.shape == Qd.shape == (3, 2, 2)


def test_matrices_beside_each_other() -> None:
    found = linear.beside([np.array([[1.0]]), np.zeros((0, 0)), np.array([[2.0, 3.0], [4.0, 5.0]])])
    assert found.tolist() == [[1.0, 0.0, 0.0], [0.0, 2.0, 3.0], [0.0, 4.0, 5.0]]


def test_a_barely_stable_system_has_no_covariance() -> None:
    """An eigenvalue of zero beside one of -1; one of -1e-17 is zero by rounding."""
    for small in (0.0, -1e-17, 1e-3):
        assert (linear.stationary_covariance(np.diag([small, -1.0]), np.eye(2)) == 0.0).all()
    found = linear.stationary_covariance(np.diag([-1e-3, -1.0]), np.eye(2))
    assert found == pytest.approx(np.diag([500.0, 0.5]))
    assert linear.stationary_covariance(np.zeros((0, 0)), np.zeros((0, 0))).shape == (0, 0)


@pytest.mark.parametrize("coupled", [False, True])
def test_one_random_path_step_by_step(coupled: bool) -> None:
    Phi = np.array([[0.9, 0.1 * coupled], [0.0, 0.5]])
    Qd, x0, n = np.diag([0.25, 4.0]), np.array([1.0, -1.0]), 6
    found = linear.simulate(Phi, Qd, x0, n, np.random.default_rng(2))
    w = np.random.default_rng(2).standard_normal((n, 2)) * [0.5, 2.0]
    x = [x0]
    for k in range(n - 1):
        x.append(Phi @ x[-1] + w[k])
    assert np.abs(found) == pytest.approx(np.abs(np.array(x))) or found == pytest.approx(np.array(x))
