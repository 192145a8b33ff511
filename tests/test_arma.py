"""Proves that equivalent ARMA models, their factors and their estimators are those of the textbooks.

The equations of Hemerly 2017 (Systems Science & Control Engineering 5(1)) are typed in as printed and compared in
symbols; his process (7)-(13) is written out in its white noises, sample by sample. Estimators are held against the
asymptotic standard deviation of maximum likelihood (Brockwell and Davis 1991, ex. 8.8), at six of them (2e-9 each)
with a factor for the less efficient ones; the tests of a series against their stated false-alarm rate, at most the
99.9 % point of the binomial.
"""

from __future__ import annotations

import numpy as np
import pytest
import sympy as sp
from numpy.typing import NDArray
from scipy.signal import lfilter
from scipy.stats import binom

from kfgen.arma.equivalent import MARKOV_WHITE_WALK, Equivalent, condition
from kfgen.arma.estimate import estimate, estimators, kind
from kfgen.arma.process import Arma, autocovariance_of, spectral_factor
from kfgen.arma.series import FALSE_ALARM_RATE, correlations, orders, series_tests
from kfgen.core.errors import InputError

Array = NDArray[np.float64]

a = sp.Symbol("alpha", positive=True)
s1, s2, s3 = sp.symbols("sigma_1 sigma_2 sigma_3", positive=True)
e0, e1, e2 = sp.symbols("e_0 e_1 e_2", real=True)
ANGLE_AND_QUANTISATION = Equivalent(("white_noise", "quantisation"))
MARKOV_AND_ANGLE = Equivalent(("gauss_markov", "white_noise"))


def zero(expression: sp.Expr) -> bool:
    return bool(sp.simplify(sp.expand(expression)) == 0)


# The equations of the paper.


def test_equation_5() -> None:
    rows = sp.Matrix(ANGLE_AND_QUANTISATION.rows(0)) * sp.Matrix([s1**2, s2**2])
    assert zero(rows[0] - (s1**2 + 2 * s2**2))
    assert zero(rows[1] + s2**2)


def test_equation_6_solves_equation_5() -> None:
    inner = s1**2 + 2 * s2**2 + s1 * sp.sqrt(s1**2 + 4 * s2**2)
    first, second = sp.sqrt(inner / 2), -sp.sqrt(2) * s2**2 / sp.sqrt(inner)
    assert zero(first**2 + second**2 - (s1**2 + 2 * s2**2))
    assert zero(first * second + s2**2)


def test_numbers_of_section_2() -> None:
    """Printed: 133.7 and -98.1; and by equation (6)."""
    e = [float(v) for v in ANGLE_AND_QUANTISATION.moving_average(0.0, [35.6**2, 114.525**2])]
    assert e == pytest.approx([133.7, -98.1], abs=0.05)
    inner = 35.6**2 + 2 * 114.525**2 + 35.6 * np.sqrt(35.6**2 + 4 * 114.525**2)
    assert e == pytest.approx([np.sqrt(inner / 2), -np.sqrt(2) * 114.525**2 / np.sqrt(inner)], rel=1e-12)


def test_equation_15_by_writing_the_process_out() -> None:
    """Equations (7)-(13) with a symbol for every white noise; covariances by counting."""
    w = sp.symbols("w1:4_0:8")
    w1, w2, w3 = w[:8], w[8:16], w[16:]
    walk, markov = [sp.Integer(0)], [sp.Integer(0)]
    for k in range(1, 8):
        markov.append(a * markov[-1] + s1 * w1[k - 1])
        walk.append(walk[-1] + s3 * w3[k - 1])
    y = [markov[k] + s2 * w2[k] + walk[k] for k in range(8)]
    d = [y[k] - y[k - 1] for k in range(1, 8)]
    x = [sp.expand(d[k] - a * d[k - 1]) for k in range(1, 7)]
    gamma = [sp.expand(sum(x[5].coeff(v) * x[5 - lag].coeff(v) for v in w)) for lag in range(4)]
    printed = [
        2 * s1**2 + (2 + 2 * a + 2 * a**2) * s2**2 + (1 + a**2) * s3**2,
        -(s1**2) - (1 + 2 * a + a**2) * s2**2 - a * s3**2,
        a * s2**2,
        0,
    ]
    ours = [*(sp.Matrix(MARKOV_WHITE_WALK.rows(a)) * sp.Matrix([s1**2, s2**2, s3**2])), 0]
    for counted, equation, derived in zip(gamma, printed, ours):
        assert zero(counted - equation)
        assert zero(counted - derived)


def test_equation_16_has_a_sign_error_as_printed() -> None:
    """With - (1+alpha)^2 sigma_2^2 in its first row it follows from (15), with + it misses by twice that."""
    gamma = sp.Matrix(MARKOV_WHITE_WALK.rows(a)) * sp.Matrix([s1**2, s2**2, s3**2])
    e1_sum, squares = gamma[1], gamma[0]  # e1 (e0 + e2), and e0^2 + e1^2 + e2^2
    M = sp.Matrix([[1, a], [2, 1 + a**2]])
    left = M * sp.Matrix([s1**2, s3**2])
    corrected = sp.Matrix([-e1_sum - (1 + a) ** 2 * s2**2, squares - 2 * (1 + a + a**2) * s2**2])
    assert all(zero(v) for v in left - corrected)
    printed = sp.Matrix([-e1_sum + (1 + a) ** 2 * s2**2, corrected[1]])
    assert zero((left - printed)[0] + 2 * (1 + a) ** 2 * s2**2)
    assert zero(M.det() - (1 - a) ** 2)


def test_equation_17() -> None:
    rows = sp.Matrix(MARKOV_AND_ANGLE.rows(a)) * sp.Matrix([s1**2, s2**2])
    assert zero(rows[0] - (s1**2 + (1 + a**2) * s2**2))
    assert zero(rows[1] + a * s2**2)


def test_condition_number_of_section_2() -> None:
    """10^9 at alpha = 0.9999, by the paper and by numpy on M as printed; smaller for slower samples."""
    alpha = np.exp(-1e-4)
    printed = np.linalg.cond([[1.0, alpha], [2.0, 1.0 + alpha**2]])
    assert condition(100.0, 0.01) == pytest.approx(printed, rel=1e-6)
    assert np.log10(condition(100.0, 0.01)) == pytest.approx(9.0, abs=1e-3)
    assert condition(100.0, 1.0) < 1.1e5
    assert condition(1.0, 1.0) < 100.0


def test_moving_average_of_section_2_2() -> None:
    """Its factor has the autocovariance of (15) and zeros .99983973 and .99990235; the way back ends at the start."""
    alpha, T = 0.9999, 0.01
    variances = [1.55e-2**2 * 0.01 * (1 - alpha**2) / 2, 5.75e-2**2 / T, 9e-4**2 * T]
    e = MARKOV_WHITE_WALK.moving_average(alpha, variances)
    numbers = [float(v) for v in e]
    assert numbers == pytest.approx([0.575045407918682, -1.149942502001154, 0.574897103082022], rel=1e-8)
    assert sorted(np.abs(np.roots(numbers))) == pytest.approx([0.99983973, 0.99990235], abs=2e-8)
    assert MARKOV_WHITE_WALK.variances(alpha, e) == pytest.approx(variances, rel=1e-12)
    slightly = [numbers[0] * (1 + 1e-8), *numbers[1:]]
    assert abs(MARKOV_WHITE_WALK.variances(alpha, slightly)[0] / variances[0] - 1) > 1.0


@pytest.mark.parametrize("names", [
    ("white_noise",), ("white_noise", "rate_random_walk"), ("white_noise", "quantisation", "gauss_markov"),
    ("white_noise", "quantisation", "gauss_markov", "rate_random_walk"),
])  # fmt: skip
def test_other_sums_of_noises_go_there_and_back(names: tuple[str, ...]) -> None:
    model, variances = Equivalent(names), [0.7, 0.2, 0.05, 0.01][: len(names)]
    e = model.moving_average(0.9, variances)
    assert model.variances(0.9, e) == pytest.approx(variances, rel=1e-12)
    assert np.abs(np.roots([float(v) for v in e])).max(initial=0.0) < 1.0


# Factors and processes.


def test_factor_of_a_known_moving_average() -> None:
    """(1 - 0.5 z)(1 + 0.8 z) doubled; mirrored roots give the same."""
    wanted = [2.0, 0.6, -0.8]
    assert spectral_factor(autocovariance_of(wanted, 2)) == pytest.approx(wanted, rel=1e-12)
    mirrored = 2.0 * 0.5 * 0.8 * np.convolve([1.0, -2.0], [1.0, 1.25])
    assert spectral_factor(autocovariance_of(list(mirrored), 2)) == pytest.approx(wanted, rel=1e-12)


@pytest.mark.parametrize("gamma", [[2.0, -1.0], [1.0, 0.9], [0.0, 0.0]])
def test_no_factor_on_the_unit_circle(gamma: list[float]) -> None:
    with pytest.raises(InputError):
        spectral_factor(gamma)


@pytest.mark.parametrize("phi", [(1.0,), (0.5, 0.5), (1.2,), (2.0, -1.0)])
def test_roots_on_the_unit_circle_are_refused(phi: tuple[float, ...]) -> None:
    with pytest.raises(InputError, match="unit circle"):
        Arma(phi, (), 1.0)


def test_state_space_has_the_density() -> None:
    model = Arma((0.5, 0.3), (0.4,), 0.7)
    A, r, H = model.state_space()
    for omega in (0.1, 1.0, 3.0):
        z = np.exp(1j * omega)
        transfer = H @ np.linalg.solve(z * np.eye(2) - A, r) * z
        assert model.sigma**2 * abs(transfer) ** 2 == pytest.approx(
            float(model.density(np.array([omega]))[0]), rel=1e-12
        )


# Estimators: the asymptotic standard deviations of phi and theta are those of example 8.8.1 of Brockwell and Davis.

N = 20_000
PROCESSES = {
    "ar": Arma((0.5, -0.3), (), 2.0),
    "ma": Arma((), (0.5, 0.2), 2.0),
    "arma": Arma((0.8,), (0.4,), 2.0),
}
LEAST_DEVIATION = {"ar": np.sqrt((1 - 0.09) / N), "ma": np.sqrt((1 - 0.04) / N), "arma": 1.2 / np.sqrt(N)}
WASTE = {"modified-yule-walker": 5.0, "innovations": 2.0, "least-squares": 2.0}


def simulated(model: Arma, seed: int, n: int = N) -> Array:
    w = model.sigma * np.random.default_rng(seed).standard_normal(n + 500)
    return np.asarray(lfilter(model.ma, model.ar, w)[500:])


@pytest.mark.parametrize("name", sorted(estimators()))
@pytest.mark.parametrize("process", sorted(PROCESSES))
def test_estimators_find_the_process(name: str, process: str) -> None:
    if process not in estimators()[name].of:
        p, q = PROCESSES[process].order
        with pytest.raises(InputError, match="estimates no process"):
            estimate(np.ones(1000), p, q, name)
        return
    wanted = PROCESSES[process]
    found = estimate(simulated(wanted, 7), *wanted.order, name)
    allowed = 6.0 * WASTE.get(name, 1.0) * LEAST_DEVIATION[process]
    assert np.abs(np.array(found.phi) - wanted.phi).max(initial=0.0) < allowed
    # A short innovations recursion and a long autoregression leave the moving average a bias of their own.
    assert np.abs(np.array(found.theta) - wanted.theta).max(initial=0.0) < allowed + 0.2 * (
        process == "ma" and name in WASTE
    )
    assert found.sigma == pytest.approx(wanted.sigma, rel=0.03 + 0.1 * (name in WASTE))


def test_levinson_solves_the_yule_walker_equations() -> None:
    y = simulated(PROCESSES["ar"], 3)
    one, other = (estimate(y, 4, 0, n) for n in ("yule-walker", "levinson-durbin"))
    assert one.phi == pytest.approx(other.phi, rel=1e-9)
    lags = [np.mean(np.r_[y[k:] * y[: y.size - k], np.zeros(k)]) for k in range(5)]
    T = np.array([[lags[abs(i - j)] for j in range(4)] for i in range(4)])
    assert np.linalg.solve(T, lags[1:]) == pytest.approx(one.phi, rel=1e-9)


@pytest.mark.parametrize(("y", "words"), [
    (np.ones(500), "never changes"),
    (np.random.default_rng(0).standard_normal(20), "too few"),
])  # fmt: skip
def test_bad_series(y: Array, words: str) -> None:
    with pytest.raises(InputError, match=words):
        estimate(y - (y.mean() if y.size > 20 else 0.0), 2, 1)


def test_unknown_estimator() -> None:
    with pytest.raises(InputError, match="Known are"):
        estimate(np.ones(500), 1, 0, "guess")
    assert kind(2, 1) == "arma"


# Tests of a series.


def test_false_alarms() -> None:
    """Of 60 white series each test of a true null rejects about 1 %: at most 5 (99.99 % of the binomial)."""
    names = ["runs", "Ljung-Box", "zero mean", "normality", "reverse arrangements", "runs of power"]
    found = [series_tests(np.random.default_rng(k).standard_normal(500)) for k in range(60)]
    most = binom.ppf(0.9999, 60, FALSE_ALARM_RATE)
    counts = {n: sum(t.named(n).rejected for t in found) for n in names}
    assert max(counts.values()) <= most, counts
    assert all(not t.unit_root for t in found)
    assert np.mean([t.kurtosis for t in found]) == pytest.approx(3.0, abs=0.15)


def test_what_is_wrong_with_a_series_is_seen() -> None:
    rng = np.random.default_rng(5)
    white = rng.standard_normal(4000)
    assert series_tests(np.cumsum(white)).unit_root
    assert series_tests(white + 0.5).named("zero mean").rejected
    assert series_tests(white**3).named("normality").rejected
    assert series_tests(white * np.linspace(1.0, 2.0, 4000)).named("reverse arrangements").rejected
    moving = white + 20.0 * np.sin(np.arange(4000) * 0.1) * (np.abs(np.arange(4000) - 2000) < 1000)
    assert series_tests(moving).named("runs of power").rejected
    assert series_tests(lfilter([1.0], [1.0, -0.5], white)).named("Ljung-Box").rejected
    assert series_tests(white).stationary


def test_partial_autocorrelation_cuts_off() -> None:
    """Of an AR(2) beyond lag 2, of an MA(2) the autocorrelation: 18 lags, at most 5 outside a 95 % band (99.8 %)."""
    ar, ma = (correlations(simulated(PROCESSES[k], 1)) for k in ("ar", "ma"))
    assert np.sum(np.abs(ar.pacf[3:]) > ar.band) <= 5
    assert ar.pacf[2] == pytest.approx(-0.3, abs=0.03)
    bartlett = ma.band * np.sqrt(1 + 2 * np.sum(ma.acf[1:3] ** 2))
    assert np.sum(np.abs(ma.acf[3:]) > bartlett) <= 5


def test_order_by_akaike() -> None:
    found = orders(simulated(PROCESSES["ar"], 2, 4000))
    aic = {o.model.order: o.aic for o in found}
    assert aic[2, 0] < aic[1, 0] - 0.05
    assert found[0].aic == min(aic.values())
    assert aic[2, 0] - found[0].aic < 8.0 / 4000  # more coefficients gain only what chance gives


def test_spectral_density_of_the_estimate_is_positive_everywhere() -> None:
    model = estimate(simulated(PROCESSES["arma"], 9), 2, 1)
    assert (model.density(np.linspace(0.0, np.pi, 100)) > 0.0).all()
