"""Proves the rules of adaptation number by number, and the loop against a plain Kalman filter with lists."""

from __future__ import annotations

import numpy as np
import pytest

from kfgen.arma.process import Arma
from kfgen.core.errors import InputError
from kfgen.run.adaptive.loop import Filtered, ScalarModel, _least_pivot, run_filter
from kfgen.run.adaptive.rules import Bounds, Factors, Rule, Seen, bounded, by_chance, rule_named, rules

B = 0.9
D = 0.1 / (1.0 - 0.9**3)
"""What Sage and Husa give the third sample at ``b = 0.9``."""
BEFORE = Factors(7.0, 2.0, 5.0, 3.0)
MODEL = ScalarModel(
    np.array([[0.9, 0.2], [0.0, 0.7]]), np.array([[0.2, 0.05], [0.05, 0.1]]), np.array([1.0, 0.5]), 0.8
)


def seen(now: float = 5.0, mean: float = 3.0, chance: float = 1.5) -> Seen:
    """Of the third sample, where the filter predicts 2 and the noise is 4."""
    return Seen(2.0, now, mean, 2.0, 4.0, chance)


def test_nothing_adapts_in_the_conventional_filter() -> None:
    assert rule_named("kf").adapt(seen(), BEFORE, B) == (1.0, 1.0, 1.0, 1.0)


def test_r_explains_what_p_does_not() -> None:
    """``(3 - 2) / 4``."""
    assert rule_named("iae").adapt(seen(), BEFORE, B) == (1.0, 0.25, 1.0, 1.0)


@pytest.mark.parametrize(("mean", "ratio"), [(3.0, 0.5), (100.0, 10.0), (0.01, 0.1), (6.0, 1.0)])
def test_q_goes_towards_agreement(mean: float, ratio: float) -> None:
    """By ``(mean / (2 + 4))^(1 - b)``, a factor of ten at most in either sense."""
    found = rule_named("iae-q").adapt(seen(mean=mean), BEFORE, B)
    assert found == (1.0, 1.0, 1.0, pytest.approx(3.0 * ratio**0.1))


@pytest.mark.parametrize(("mean", "fade"), [(20.0, 2.0), (15.0, 1.0), (14.0, 1.0)])
def test_p_fades_by_its_excess_over_chance(mean: float, fade: float) -> None:
    """Expected are ``2 + 2 4 = 10``; at 1.5 of that the excess is still chance."""
    found = rule_named("shafkf-p").adapt(seen(6.0, mean), BEFORE, B)
    assert found == (pytest.approx(fade), pytest.approx((1.0 - D) * 2.0 + D * 4.0 / 4.0), 1.0, 1.0)


@pytest.mark.parametrize(
    ("mean", "fade", "once"),
    [(40.0, 4.0, 40.0 / (4.0 * 2.0 + 8.0)), (9.0, 1.0, 1.0), (15.0, 1.0, 1.0)],
)
def test_what_fading_leaves_goes_to_r(mean: float, fade: float, once: float) -> None:
    found = rule_named("shafkf-r").adapt(seen(6.0, mean), BEFORE, B)
    r = (1.0 - D) * 2.0 + D * 4.0 / 4.0
    assert found == (pytest.approx(fade), pytest.approx(r), pytest.approx(once), 1.0)


def test_at_its_bound_what_fading_leaves_is_chance() -> None:
    """With a prediction, a noise and an r of 1 a mean of 4 fades by 2 and leaves ``4 / (2 + 1)``."""
    third = Seen(2.0, 0.0, 4.0, 1.0, 1.0, 4.0 / 3.0)
    assert rule_named("shafkf-r").adapt(third, Factors(1.0, 1.0, 1.0, 1.0), B).once == 1.0
    below = third._replace(chance=1.3)
    assert rule_named("shafkf-r").adapt(below, Factors(1.0, 1.0, 1.0, 1.0), B).once == pytest.approx(4 / 3)


def test_sage_and_husa_remember_less_and_less() -> None:
    found = rule_named("sage-husa").adapt(seen(6.0), BEFORE, B)
    assert found == (1.0, pytest.approx((1.0 - D) * 2.0 + D * 4.0 / 4.0), 1.0, 1.0)


def test_the_first_sample_is_all_that_a_fading_memory_has() -> None:
    """``d = (1 - b) / (1 - b) = 1``."""
    for name in ("sage-husa", "shafkf-p", "shafkf-r"):
        first = rule_named(name).adapt(seen()._replace(updates=0.0), BEFORE, B)
        assert first.r == pytest.approx((5.0 - 2.0) / 4.0)


def test_factors_stay_in_their_box() -> None:
    box = Bounds()
    assert (box.least_r, box.most_r, box.most_fade, box.least_q, box.most_q) == (1e-4, 1e6, 1e3, 1e-4, 1e6)
    own = Bounds(0.25, 8.0, 4.0, 0.5, 2.0)
    assert bounded(Factors(0.1, 0.1, 0.1, 0.1), own) == (1.0, 0.25, 1.0, 0.5)
    assert bounded(Factors(9.0, 9.0, 9.0, 9.0), own) == (4.0, 8.0, 8.0, 2.0)
    assert bounded(Factors(1.5, 1.5, 1.5, 1.5), own) == (1.5, 1.5, 1.5, 1.5)


def test_every_rule_has_its_name() -> None:
    assert set(rules()) == {"kf", "iae", "iae-q", "sage-husa", "shafkf-p", "shafkf-r"}
    with pytest.raises(InputError, match="no filter 'ekf'"):
        rule_named("ekf")


def plain(
    z: np.ndarray, model: ScalarModel, rule: type[Rule], window: int, b: float, box: Bounds
) -> Filtered:
    """The same filter with lists: the window is a slice, the gain and the covariance are those of the textbook."""
    x, P = np.zeros(2), np.eye(2) * (np.trace(model.Q) + model.R)
    squares: list[float] = []
    gains, rows, least, f = [], [], 1.0, Factors(1.0, 1.0, 1.0, 1.0)
    for value in z:
        x, P = model.A @ x, model.A @ P @ model.A.T + f.q * model.Q
        nis, gain = 0.0, np.zeros(2)
        if np.isfinite(value):
            v = value - model.H @ x
            squares.append(v * v)
            seen = Seen(
                len(squares) - 1.0,
                v * v,
                float(np.mean(squares[-window:])),
                model.H @ P @ model.H,
                model.R,
                by_chance(window),
            )
            f = bounded(rule.adapt(seen, f, b), box)
            P = f.fade * P
            S = model.H @ P @ model.H + f.r * f.once * model.R
            gain, nis = P @ model.H / S, v * v / S
            x, P = x + gain * v, P - S * np.outer(gain, gain)
        D = np.linalg.cholesky(P / np.abs(P).max())
        least = min(least, float((np.diag(D) ** 2).min()))
        rows.append([model.H @ x, nis, f.r * f.once, f.fade, f.q])
        gains.append(gain)
    half = gains[(len(gains) + 1) // 2 :]
    return Filtered(*np.array(rows).T, np.mean(half, axis=0), least)


@pytest.mark.parametrize("name", sorted(rules()))
@pytest.mark.parametrize("n", [41, 42])
def test_the_loop_is_the_filter_of_the_textbook(name: str, n: int) -> None:
    """Over a window of four, with a jump of the noise in the middle and three samples that are no numbers, the first among them."""
    z = np.random.default_rng(5).standard_normal(n) * np.where(np.arange(n) > 20, 4.0, 1.0)
    z[[0, 3, 30]] = np.nan
    box = Bounds(0.05, 20.0, 5.0, 0.05, 20.0)
    found = run_filter(z, MODEL, rule_named(name), 4, B, box)
    expected = plain(z, MODEL, rule_named(name), 4, B, box)
    for field in ("estimate", "nis", "r", "fade", "q", "gain", "least"):
        np.testing.assert_allclose(getattr(found, field), getattr(expected, field), rtol=1e-9, err_msg=field)


def test_without_bounds_of_ones_own_those_of_the_house_hold() -> None:
    z = 1e6 * np.random.default_rng(6).standard_normal(8)
    assert run_filter(z, MODEL, rule_named("shafkf-p"), 2, B).fade.max() == Bounds().most_fade


def test_one_sample_has_no_second_half() -> None:
    assert run_filter(np.array([1.0]), MODEL, rule_named("kf"), 1, B).gain == pytest.approx([0.0, 0.0])


@pytest.mark.parametrize(
    ("matrix", "pivot"),
    [
        (np.diag([4.0, 1.0]), 0.25),
        (np.array([[0.0, 0.5], [0.5, 1.0]]), 0.0),
        (np.array([[4.0, 2.0], [2.0, 3.0]]), 0.5),
        (np.array([[1.0, 1.0], [1.0, 1.0]]), 0.0),
        (np.array([[2.0, 2.0, 0.0], [2.0, 1.0, 0.0], [0.0, 0.0, 2.0]]), -0.5),
        (np.array([[4.0, 2.0, 2.0], [2.0, 4.0, 2.0], [2.0, 2.0, 4.0]]), 2.0 / 3.0),
        (np.array([[4.0, 0.0, 2.0], [0.0, 4.0, 2.0], [2.0, 2.0, 2.5]]), 0.125),
    ],
)
def test_pivots_over_the_largest_entry(matrix: np.ndarray, pivot: float) -> None:
    """By elimination: of the fifth 1, then ``1 - 1 / 4`` and ``1 - 1 / 4 - (1 / 4)^2 / (3 / 4) = 2 / 3``."""
    assert _least_pivot(matrix) == pytest.approx(pivot, abs=1e-15)


def test_what_is_no_model_is_refused() -> None:
    one = np.eye(1)
    for R in (0.0, -1.0, np.inf, np.nan):
        with pytest.raises(InputError, match="singular"):
            ScalarModel(one, one, np.ones(1), R)
    with pytest.raises(InputError, match="no covariance"):
        ScalarModel(np.eye(2), np.diag([1.0, -1e-3]), np.ones(2), 1.0)
    assert ScalarModel(np.eye(2), np.diag([1.0, -1e-10]), np.ones(2), 1.0).R == 1.0
    with pytest.raises(InputError, match="no covariance"):
        ScalarModel(np.eye(2), np.diag([1.0, -1e-8]), np.ones(2), 1.0)


def test_a_process_is_measured_with_its_own_noise() -> None:
    """``x' = 0.8 x + w`` of standard deviation 3: R is 9, Q a 980th of that."""
    model = ScalarModel.of(Arma((0.8,), (), 3.0))
    assert (model.R, model.Q[0, 0], model.A[0, 0]) == pytest.approx((9.0, 9.0 / 980.0, 0.8))


def test_q_is_a_covariance_to_rounding_of_its_trace() -> None:
    assert ScalarModel(np.eye(2), np.diag([1e3, -5e-7]), np.ones(2), 1.0).R == 1.0
    with pytest.raises(InputError, match="no covariance"):
        ScalarModel(np.eye(2), np.diag([1e-3, -5e-7]), np.ones(2), 1.0)
    with pytest.raises((InputError, np.linalg.LinAlgError)):
        ScalarModel(np.eye(2), np.diag([1.0, np.nan]), np.ones(2), 1.0)


def test_a_process_of_two_terms_is_driven_through_both() -> None:
    process = Arma((0.8, -0.2), (0.3,), 3.0)
    A, r, H = process.state_space()
    model = ScalarModel.of(process, 10.0)
    assert pytest.approx(0.9 * np.outer(r, r)) == model.Q
    assert pytest.approx(A) == model.A
    assert pytest.approx(H) == model.H
    assert len(set(np.abs(r))) == 2


def test_the_mean_gain_of_the_second_half_of_two_samples_is_that_of_the_second() -> None:
    z = np.array([1.0, 2.0])
    found = run_filter(z, MODEL, rule_named("kf"), 1, B)
    assert found.gain == pytest.approx(plain(z, MODEL, rule_named("kf"), 1, B, Bounds()).gain)


def test_samples_beyond_numbers_are_refused() -> None:
    with pytest.raises(InputError, match="leaves all bounds"):
        run_filter(np.array([1.0, 1e200, 1.0]), MODEL, rule_named("shafkf-p"), 1, B)


@pytest.mark.parametrize(("window", "b"), [(0, B), (4, B), (2, 0.0), (2, 1.0)])
def test_windows_and_memories_that_are_none_are_refused(window: int, b: float) -> None:
    z = np.array([1.0, np.nan, 2.0, 3.0])
    assert run_filter(z, MODEL, rule_named("kf"), 3, B).nis[1] == 0.0
    with pytest.raises(InputError):
        run_filter(z, MODEL, rule_named("kf"), window, b)
