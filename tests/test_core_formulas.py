"""Proves numbers of core modules one by one, in closed form: what changes of single operators left unnoticed before."""

from __future__ import annotations

import numpy as np
import pytest
import sympy as sp

from kfgen.core import linear
from kfgen.core.errors import InputError
from kfgen.core.recent_results import RecentResults
from kfgen.core.units import derived_unit
from kfgen.effects import make
from kfgen.emit.covariance.packed import MIN_LOOP_COLUMNS, batches, each, groups
from kfgen.emit.ir.ir import For, Let, Num, Stmt
from kfgen.emit.reference import Machine
from kfgen.emit.routines import Program
from kfgen.identify.evidence.allan import degrees_of_freedom
from kfgen.identify.evidence.shapes import Shapes
from kfgen.identify.evidence.whittle import SINGLE_ORDINATES, ordinates
from kfgen.model.discretise import LONGEST_STEP, DiscreteModel
from kfgen.model.library import build
from kfgen.run.adaptive.rules import Factors, Seen, by_chance, rule_named


def test_one_state_keeps_half_its_drive_over_its_decay() -> None:
    """``2 a P = W``."""
    P = linear.stationary_covariance(np.array([[-0.25]]), np.array([[3.0]]))
    assert pytest.approx(np.array([[6.0]])) == P


def test_a_slow_resonance_keeps_what_its_damping_lets_it() -> None:
    """``x' = v + n0, v' = -w^2 x - 2 z w v + n1`` of densities p and q, by the three equations of its covariance."""
    w, z, p, q = 1e-3, 0.05, 3.0, 2.0
    P = linear.stationary_covariance(np.array([[0.0, 1.0], [-(w**2), -2.0 * z * w]]), np.diag([p, q]))
    v = (q + w**2 * p) / (4.0 * z * w)
    np.testing.assert_allclose(P, [[(v + z * w * p) / w**2, -0.5 * p], [-0.5 * p, v]], rtol=1e-6)


@pytest.mark.parametrize(
    ("slope", "m", "edf"), [(-1.0, 5, 26.70438), (0.0, 5, 21.98491), (1.0, 5, 17.73011), (0.0, 1, 86.20053)]
)
def test_degrees_of_freedom_of_a_hundred_and_one_samples(slope: float, m: int, edf: float) -> None:
    """The formulas of W. J. Riley, NIST SP 1065, table 5, worked by hand."""
    assert degrees_of_freedom(101, np.array([m]), np.array([slope]))[0] == pytest.approx(edf, rel=1e-6)


def test_a_flicker_is_a_bank_of_times_four_to_one() -> None:
    """Over 1 s to 64 s: 1, 4, 16 and 64 s, each of ``B^2 ln(4) / pi``."""
    form = make("bias_instability", B=2.0, shortest=1.0, longest=64.0).form()
    A, W = np.array(form.A, dtype=float), np.array(form.W, dtype=float)
    np.testing.assert_allclose(-1.0 / np.diag(A), [1.0, 4.0, 16.0, 64.0])
    np.testing.assert_allclose(np.diag(W) / (-2.0 * np.diag(A)), 4.0 * np.log(4.0) / np.pi)


def test_a_flicker_of_which_only_its_size_is_stated_is_over_all_that_the_record_shows() -> None:
    bare = make("bias_instability", B=2.0)
    wide, narrow = bare.in_record(0.01, 1e5), bare.in_record(5.0, 100.0)
    assert (wide.shortest, wide.longest) == (0.01, 1e5)
    assert (narrow.shortest, narrow.longest) == (1.0, 1e4)


def test_sensors_keep_rates_of_their_own() -> None:
    assert DiscreteModel.at_rate(build("ins15"), 100.0, rates={"gnss_position": 5.0}).rates == {
        "gnss_position": 5.0
    }
    assert DiscreteModel.at_rate(build("ins15"), 100.0).rates == {}


def test_few_ordinates_stand_alone() -> None:
    found = ordinates([np.array([1.0, 2.0, 3.0, 4.0, 5.0])], 0.01, 1)
    assert found.count.tolist() == [1] * 5
    assert found.gram[:, 0, 0].tolist() == [1.0, 4.0, 9.0, 16.0, 25.0]
    np.testing.assert_allclose(found.omega, np.arange(1, 6) * np.pi / 6)


@pytest.mark.parametrize("a", [0.0, -1e-12, -0.7, 0.3])
def test_one_state_is_that_of_a_pair_of_which_the_other_does_nothing(a: float) -> None:
    """The closed form of one state against the series of two, over steps of six decades."""
    dt = np.geomspace(1e-3, 30.0, 7)
    Phi, Qd = linear.van_loan(np.array([[a]]), np.array([[2.0]]), dt)
    both, driven = linear.van_loan(np.diag([a, 0.0]), np.diag([2.0, 0.0]), dt)
    np.testing.assert_allclose(Phi[:, 0, 0], both[:, 0, 0], rtol=1e-13)
    np.testing.assert_allclose(Qd[:, 0, 0], driven[:, 0, 0], rtol=1e-12)


def test_the_mean_of_one_sample_is_the_value_at_its_time() -> None:
    warm = make("warm_up", size=2.0, tau=5.0)
    whole = warm.mean(np.arange(8) * 0.5)
    assert warm.mean(np.array([1.5])) == pytest.approx(whole[3:4])


def test_the_longest_step_is_that_of_the_fastest_effect() -> None:
    """A time constant of 20 ms allows 20 ms; none, a tenth of a second; the period of the rate is always allowed."""
    plain = build("ahrs6")
    fast = plain.augment("gyro_x", make("gauss_markov", sigma=1e-3, tau=0.02))
    assert DiscreteModel.at_rate(plain, 100.0).max_step == LONGEST_STEP == 0.1
    assert DiscreteModel.at_rate(fast, 100.0).max_step == pytest.approx(0.02)
    assert DiscreteModel.at_rate(fast, 20.0).max_step == pytest.approx(1.05 / 20.0)


def test_a_second_order_takes_steps_up_to_half_a_time_constant() -> None:
    model = build("gyro-static").augment("gyro_x", make("gauss_markov", sigma=1e-3, tau=0.2))
    assert DiscreteModel(model, order=2, max_step=0.1).Phi.rows
    with pytest.raises(InputError, match="half of the shortest time constant"):
        DiscreteModel(model, order=2, max_step=0.101).Phi  # noqa: B018


def test_bins_stand_alone_and_then_forty_eight_to_a_decade() -> None:
    """Two decades above the 96 that stand alone: 96 and twice 48."""
    n = 100 * SINGLE_ORDINATES
    coefficients = np.random.default_rng(0).standard_normal(n)
    found = ordinates([coefficients], 0.01, 1)
    assert found.n == n
    assert found.count[:SINGLE_ORDINATES].tolist() == [1] * SINGLE_ORDINATES
    assert found.count.size == SINGLE_ORDINATES + 2 * 48
    assert found.gram.sum() == pytest.approx(coefficients @ coefficients)


def test_a_band_that_is_skipped_leaves_no_power() -> None:
    """Of 50 Hz in 1,000 ordinates those from 10 Hz to 20 Hz are 201; the rest keeps its own."""
    coefficients = np.random.default_rng(1).standard_normal(1000)
    omega = np.arange(1, 1001) * np.pi / 1001
    beyond = (omega / (2.0 * np.pi * 0.01) < 10.0) | (omega / (2.0 * np.pi * 0.01) > 20.0)
    found = ordinates([coefficients], 0.01, 1, skip=((10.0, 20.0),))
    assert found.gram.sum() == pytest.approx(np.sum(coefficients[beyond] ** 2))


def test_the_gyro_that_is_calm_is_not_held_to_fade() -> None:
    """Innovations below what chance makes leave every factor of the second stage at one."""
    calm = Seen(500.0, 0.1, 0.1, 2.0, 1.0, 1.5)
    found = rule_named("shafkf-p").adapt(calm, Factors(1.0, 1.0, 1.0, 1.0), 0.97)
    assert (found.fade, found.once, found.q) == (1.0, 1.0, 1.0)
    found = rule_named("shafkf-r").adapt(calm, Factors(1.0, 1.0, 1.0, 1.0), 0.97)
    assert (found.fade, found.once, found.q) == (1.0, 1.0, 1.0)


@pytest.mark.parametrize(
    ("template", "unit", "derived"),
    [
        ("U/sqrt(Hz)", "deg/s", "deg/s/sqrt(Hz)"),
        ("1/(U)", "", ""),
        ("U*s", "rad/s", "rad"),
        ("U", "m/s^2", "m/s^2"),
        ("U", "g/16384", "g/16384"),
        ("U*s", "g/16384", "(g/16384)*s"),
    ],
)
def test_units_that_follow_from_a_channels(template: str, unit: str, derived: str) -> None:
    assert derived_unit(template, unit) == derived


def test_a_shape_is_computed_once_for_all_sizes() -> None:
    """Of one size: four times the size is sixteen times the density; another time constant is another shape."""
    seen: list[float] = []

    def density(effect: object) -> np.ndarray:
        seen.append(effect.tau)  # type: ignore[attr-defined]
        return effect.density(np.array([0.1, 1.0]))  # type: ignore[attr-defined]

    shapes = Shapes(density)
    one, four = (make("gauss_markov", sigma=s, tau=3.0) for s in (0.5, 2.0))
    assert shapes.of(four) == pytest.approx(16.0 * shapes.of(one))
    assert shapes.of(four) == pytest.approx(four.density(np.array([0.1, 1.0])))
    shapes.of(make("gauss_markov", sigma=0.5, tau=4.0))
    assert seen == [3.0, 4.0]


def test_recent_results_forget_what_was_not_asked_for_longest() -> None:
    made: list[int] = []
    recent = RecentResults[int](2)
    for k in (1, 2, 1, 3, 1, 2):
        assert recent.recalled(k, lambda k=k: made.append(k) or 10 * k) == 10 * k
    assert made == [1, 2, 3, 2]


def test_a_rate_of_innovations_by_chance_is_that_of_chi_square() -> None:
    """The 95 % points of 1 and of 10 degrees of freedom (Abramowitz and Stegun, table 26.8) over these."""
    assert by_chance(1) == pytest.approx(3.84146, rel=1e-5)
    assert by_chance(5, 2) == pytest.approx(1.83070, rel=1e-5)


def test_sage_husa_by_hand() -> None:
    """b = 0.9 at the third sample: ``d = 0.1 / (1 - 0.9^3) = 0.369004``; ``R <- (1 - d) 2 + d (5 - 1) / 4``."""
    found = rule_named("sage-husa").adapt(
        Seen(2.0, 5.0, 5.0, 1.0, 4.0, 1.5), Factors(1.0, 2.0, 1.0, 1.0), 0.9
    )
    d = 0.1 / 0.271
    assert found == Factors(1.0, pytest.approx((1.0 - d) * 2.0 + d), 1.0, 1.0)


def test_rows_are_stepped_before_those_that_they_need() -> None:
    """Position needs velocity, and that acceleration: in this order; what stands alone goes with the first of its depth."""
    one = sp.Integer(1)
    chain = {0: {0: one, 1: one}, 1: {1: one, 2: one}, 2: {2: one}, 3: {3: one}}
    assert batches(chain) == [[0, 3], [1], [2]]
    turning = {0: {0: one, 1: one}, 1: {0: one, 1: one}, 2: {2: one}}
    assert sorted(groups(turning)) == [[0, 1], [2]]
    assert batches(turning) == [[0, 1], [2]]


def test_no_more_than_three_rows_are_stepped_together() -> None:
    one = sp.Integer(1)
    assert batches({k: {k: one} for k in range(7)}) == [[0, 1, 2], [3, 4, 5], [6]]


@pytest.mark.parametrize(
    ("share", "status"), [(0.79, "GATED"), (0.81, "OK"), (1.0, "OK"), (1.19, "OK"), (1.21, "GATED")]
)
def test_a_field_is_gated_by_its_length(share: float, status: str) -> None:
    """A gate of a fifth of the field's length, on both sides."""
    machine = Machine(Program(DiscreteModel(build("ahrs6", options={"field_gate": "0.2"})), "ud"))
    machine.call("init")
    assert machine.call("update_mag", [[20e-6 * share, 0.0, 44e-6 * share]]) == status


def test_columns_beside_each_other_are_one_loop() -> None:
    n = MIN_LOOP_COLUMNS
    columns = [*range(n), *range(n + 1, 2 * n + 1), *range(2 * n + 2, 3 * n + 1)]

    def of(k: object) -> list[Stmt]:
        return [Let("v", Num(1.0))]

    body = each(columns, set(), of, True)
    loops = [(s.start, s.stop) for s in body if isinstance(s, For)]
    assert loops == [(0, n), (n + 1, 2 * n + 1)]
    assert len(body) == 2 + n - 1  # the last run is too short for a loop
    assert len(each(columns, set(), of, False)) == len(columns)
