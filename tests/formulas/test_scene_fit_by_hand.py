"""Proves each part of the fit of a scene by its formula: coordinates, steps, levels, priors, what a step tries.

The scene is linear in two numbers and exponential in a third, over twelve readings of two channels, so that everything
has a closed form.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from kfgen.effects import make
from kfgen.gap.scene import newton
from kfgen.gap.scene.newton import SceneFit, derivative, first_steps, fitted, fitted_from
from kfgen.gap.scene.posterior import level_sd_of_log, levels_of, log_posterior, over_levels
from kfgen.gap.scene.scene import Placed, ScenePoint, Unknown, coordinates, keys_of, moved
from kfgen.gap.scene.screen import Screened, _claims, _own, basis, new_columns, orthogonal_part, screen

Array = NDArray[np.float64]
LENGTHS = (8, 4)
RNG = np.random.default_rng(8)
A, B = RNG.standard_normal((2, 12))
BESIDE = np.r_[np.ones(8), np.zeros(4)]
TIME = np.arange(12.0)


@dataclass(frozen=True)
class Few:
    """``y - a A - b B - exp(-t / tau) - c BESIDE``; c is an unknown of the scene."""

    y: Array
    sd: float = np.inf
    assumed: float = 0.0
    sizes: float = 1.0

    channels = ("one", "two")
    lengths = LENGTHS
    dt = 1.0
    span = (0.0, 11.0)

    @property
    def unknowns(self) -> tuple[Unknown, ...]:
        return (Unknown("c", "1", self.assumed, self.sd),)

    def residuals(self, points: Sequence[ScenePoint]) -> Array:
        out = []
        for point in points:
            left = self.y - point.unknowns[0] * BESIDE
            for p in point.placed:
                if p.effect.name == "sensor_lag":
                    left = left - self.sizes * np.exp(-TIME / p.effect.tau)  # type: ignore[attr-defined]
                else:
                    left = left - p.effect.coefficient * {"a": A, "b": B, "nothing": 0.0 * A}[p.where]  # type: ignore[attr-defined]
            out.append(left)
        return np.array(out).T

    def candidates(self, placed: Sequence[Placed]) -> list[list[Placed]]:
        return [[line("b")], [lag(0.5), lag(3.0)]]


class Loud(Few):
    noise_level_sd_of_log = 0.7


def line(where: str, value: float = 0.0) -> Placed:
    return Placed(make("scale_factor", coefficient=value), where)


def lag(tau: float) -> Placed:
    return Placed(make("sensor_lag", tau=tau), "two")


def at(*placed: Placed, c: float = 0.0) -> ScenePoint:
    return ScenePoint(placed, np.array([c]))


def test_times_are_fitted_in_their_logarithm_and_coefficients_as_they_are() -> None:
    point = at(line("a", -2.0), lag(4.0), c=7.0)
    assert keys_of(point.placed) == ((0, "coefficient"), (1, "tau"))
    assert coordinates(point) == pytest.approx([-2.0, math.log(4.0), 7.0])
    there = moved(point, np.array([3.0, 0.5, 9.0]))
    assert there.placed[0].effect.coefficient == 3.0  # type: ignore[attr-defined]
    assert there.placed[1].effect.tau == pytest.approx(math.exp(0.5))  # type: ignore[attr-defined]
    assert there.unknowns.tolist() == [9.0]
    assert moved(point, np.array([0.0, 1e4, 0.0])).placed[1].effect.tau == pytest.approx(math.exp(690.0))  # type: ignore[attr-defined]
    held = replace(point.placed[1], held=("tau",))
    assert keys_of((point.placed[0], held)) == ((0, "coefficient"),)


def test_first_differences_are_of_the_size_of_the_numbers() -> None:
    assert first_steps(at(line("a", -2.0), lag(1.0), c=500.0)) == pytest.approx([2e-5, 1e-8, 5e-3])


def test_levels_are_the_best_of_each_channel() -> None:
    """The root of ``n - p / s^2 + ln s / sd^2``, by bisection; a scene that knows nothing of its noise has its own sd."""
    r = np.r_[3.0 * np.ones(8), 0.2 * np.ones(4)]
    for scene, sd in ((Few(r), 0.1), (Loud(r), 0.7)):
        assert level_sd_of_log(scene) == sd
        for level, n, p in zip(levels_of(scene, r), LENGTHS, (72.0, 0.16), strict=True):
            lo, hi = 1e-3, 1e3
            for _ in range(200):
                s = math.sqrt(lo * hi)
                lo, hi = (lo, s) if n - p / s**2 + math.log(s) / sd**2 > 0.0 else (s, hi)
            assert level == pytest.approx(lo, rel=1e-12)


def test_levels_far_away_are_found_too() -> None:
    """From one to a thousand is seven steps of one in the logarithm, which are the longest."""
    r = np.r_[1e4 * np.ones(8), np.ones(4)]
    s = levels_of(Loud(r), r)[0]
    assert 8.0 - 8e8 / s**2 + math.log(s) / 0.49 == pytest.approx(0.0, abs=1e-6)


def test_the_posterior_in_full() -> None:
    scene = Few(A, sd=0.5, assumed=2.0)
    r = scene.residuals([at(c=1.0)])[:, 0]
    expected = -0.5 * (1.0 / 0.5) ** 2
    for part, n, s in zip(np.split(r, [8]), LENGTHS, levels_of(scene, r), strict=True):
        expected -= n * math.log(s) + 0.5 * part @ part / s**2 + 0.5 * (math.log(s) / 0.1) ** 2
    assert log_posterior(scene, r, np.array([1.0])) == pytest.approx(expected)
    free = Few(A)
    assert log_posterior(free, r, np.array([1.0])) == pytest.approx(expected + 2.0)


def test_residuals_over_their_levels() -> None:
    x = np.ones((12, 2))
    assert over_levels(Few(A), x, np.array([2.0, 4.0]))[:, 1] == pytest.approx([0.5] * 8 + [0.25] * 4)
    assert over_levels(Few(A), x[:, 0], np.array([2.0, 4.0])) == pytest.approx([0.5] * 8 + [0.25] * 4)


@pytest.mark.parametrize("begun", [1e-12, 1e-4, 0.02, 80.0])
def test_derivatives_and_the_steps_that_show_them(begun: float) -> None:
    """In a, in the logarithm of tau, in c; a step of a logarithm is a twentieth at most."""
    point = at(line("a", 1.0), lag(3.0), c=0.5)
    scene = Few(10.0 * A)
    J, steps = derivative(scene, point, scene.residuals([point])[:, 0], np.full(3, begun))
    assert J[:, 0] == pytest.approx(-A, rel=1e-4, abs=1e-5)
    assert J[:, 2] == pytest.approx(-BESIDE, rel=1e-4, abs=1e-5)
    slope = -np.exp(-TIME / 3.0) * TIME / 3.0
    # A step of eighty logarithms changes the residuals by no more than is allowed: it stays.
    assert begun == 80.0 or J[:, 1] == pytest.approx(slope, rel=0.09, abs=3e-3)
    change = np.linalg.norm(J, axis=0) * steps
    assert (change[[0, 2]] > 1e-3).all()
    assert (change[[0, 2]] < 15.0).all()
    if begun == 1e-12:
        assert change[[0, 2]] == pytest.approx([0.1, 0.1], rel=1e-2)
        assert steps[1] <= 0.05


def test_a_number_that_nothing_shows_has_a_long_step() -> None:
    """A lag of size zero: no step shows it, so it ends at a twentieth of a logarithm."""
    point = at(lag(3.0))
    scene = Few(A, sizes=0.0)
    J, steps = derivative(scene, point, scene.residuals([point])[:, 0], np.full(2, 1e-4))
    assert (J[:, 0] == 0.0).all()
    assert steps[0] == pytest.approx(0.05)


def test_a_number_that_nothing_shows_is_moved_no_further_than_a_bound() -> None:
    """Twice by ``1e8``, but no further than ``1e12`` of itself, or of one."""
    scene = Few(A)
    for value, longest in ((1.5, 1.5e12), (0.1, 1e12)):
        point = at(line("nothing", value))
        _, steps = derivative(scene, point, scene.residuals([point])[:, 0], np.full(2, 1e-3))
        assert steps[0] == pytest.approx(longest)


def test_steps_that_are_seen_are_kept() -> None:
    """Changes of a hundredth to a hundred times a tenth will do."""
    scene, point = Few(A), at(c=1.0)
    size = math.sqrt(8.0)
    for change, kept in ((0.002, True), (9.9, True), (0.0005, False), (11.0, False)):
        _, steps = derivative(scene, point, scene.residuals([point])[:, 0], np.array([change / size]))
        assert steps[0] == pytest.approx((change if kept else 0.1) / size)


def test_only_what_no_step_showed_is_differentiated_again() -> None:
    """Of two coordinates one moves the residuals visibly at once: the other alone, and the point, come again."""
    asked = []

    class Counted(Few):
        def residuals(self, points: Sequence[ScenePoint]) -> Array:
            asked.append(len(points))
            return super().residuals(points)

    scene, point = Counted(A), at(line("a", 1.0), c=0.5)
    J, steps = derivative(scene, point, scene.residuals([point])[:, 0], np.array([0.1, 1e-9]))
    assert asked == [1, 3, 2]
    assert steps[0] == 0.1
    assert pytest.approx(-np.column_stack([A, BESIDE]), rel=1e-4, abs=1e-5) == J


def test_without_numbers_there_is_no_derivative() -> None:
    class Bare(Few):
        unknowns = ()

        def residuals(self, points: Sequence[ScenePoint]) -> Array:
            return np.column_stack([self.y for _ in points])

    scene = Bare(A)
    none = ScenePoint((), np.zeros(0))
    J, steps = derivative(scene, none, A, np.zeros(0))
    assert (J.shape, steps.shape) == ((12, 0), (0,))
    fit = fitted(scene, none)
    assert fit.value == pytest.approx(log_posterior(scene, A, np.zeros(0)))
    assert fit.jacobian.shape == (12, 0)


def test_three_channels_have_three_levels() -> None:
    """Each by its own readings, whatever those of the others are."""
    parts = [np.full(n, v) for n, v in ((4, 3.0), (3, 0.2), (5, 1.5))]
    three: Any = SimpleNamespace(lengths=(4, 3, 5), unknowns=())
    alone = [levels_of(SimpleNamespace(lengths=(p.size,)), p)[0] for p in parts]  # type: ignore[arg-type]
    assert levels_of(three, np.concatenate(parts)) == pytest.approx(alone)
    values = [
        log_posterior(SimpleNamespace(lengths=(p.size,), unknowns=()), p, np.zeros(0))  # type: ignore[arg-type]
        for p in parts
    ]
    assert log_posterior(three, np.concatenate(parts), np.zeros(0)) == pytest.approx(sum(values))


def test_a_linear_scene_is_solved_with_its_prior() -> None:
    """Levels at one by a narrow prior of theirs: normal equations with ``1 / sd^2`` at the unknown."""

    class Exact(Few):
        noise_level_sd_of_log = 1e-6

    scene = Exact(3.0 * A - 2.0 * B + 1.5 * BESIDE, sd=0.5, assumed=1.0)
    fit = fitted(scene, at(line("a", 0.1), line("b", 0.1)))
    X = np.column_stack([A, B, BESIDE])
    H = X.T @ X + np.diag([0.0, 0.0, 4.0])
    best = np.linalg.solve(H, X.T @ scene.y + np.array([0.0, 0.0, 4.0 * 1.0]))
    assert coordinates(fit.point) == pytest.approx(best, rel=1e-6)
    assert fit.information == pytest.approx(H, rel=1e-4, abs=1e-6)
    assert fit.covariance == pytest.approx(np.linalg.inv(H), rel=1e-3, abs=1e-6)
    assert fit.keys == ((0, "coefficient"), (1, "coefficient"))
    assert fit.jacobian == pytest.approx(-X, abs=1e-4)
    assert fit.value == pytest.approx(log_posterior(scene, fit.residual, fit.point.unknowns))
    assert fit.levels == pytest.approx(levels_of(scene, fit.residual))


def test_a_time_is_found_from_far() -> None:
    scene = Few(100.0 * np.exp(-TIME / 3.0), sizes=100.0, sd=1e-9)
    for begun in (0.05, 60.0):
        fit = fitted(scene, at(lag(begun)))
        assert fit.point.placed[0].effect.tau == pytest.approx(3.0, rel=1e-5)  # type: ignore[attr-defined]


def test_what_nothing_says_is_very_wide() -> None:
    """Two directions that are one: along their difference there is no information, so a variance beyond 1e11."""
    information = np.array([[4.0, 4.0], [4.0, 4.0]])
    fit = SceneFit(at(), A, np.ones(2), 0.0, information, (), np.zeros(2), np.zeros((12, 2)))
    assert fit.covariance[0, 0] == pytest.approx(0.5 * (0.5 + 1e12) / 4.0, rel=1e-3)
    single = replace(fit, information=np.diag([4.0, 25.0]))
    assert single.covariance == pytest.approx(np.diag([0.25, 0.04]))
    nothing = replace(fit, information=np.diag([4.0, 0.0]))
    assert nothing.covariance[0, 0] == pytest.approx(0.25)
    assert nothing.covariance[1, 1] > 1e200


LOGS = np.array([True, False])


@pytest.mark.parametrize(
    ("step", "ways"),
    [
        ([0.05, 7.0], [[0.05, 7.0]]),
        ([0.1, 7.0], [[0.1, 7.0]]),
        ([-0.5, 7.0], [[-0.5, 7.0], [math.log(0.5), 7.0]]),
        ([4.0, 8.0], [[1.0, 2.0], [math.log(5.0), 8.0]]),
        ([-4.0, 8.0], [[-1.0, 2.0], [-2.0, 8.0]]),
    ],
)
def test_a_long_step_in_a_logarithm_goes_two_ways(step: list[float], ways: list[list[float]]) -> None:
    """Shortened to one in all coordinates alike, or ``ln(1 + d)`` in the logarithm, above -2, and all else in full."""
    found = newton._ways(np.array(step), LOGS)
    assert len(found) == len(ways)
    for a, b in zip(found, ways, strict=True):
        assert a == pytest.approx(b)


def stepped(
    scene: Few, at: tuple[ScenePoint, Array, float], g: Array, H: Array, damping: float
) -> newton._Climb:
    """One step from a point, of a residual and a value, down a slope."""
    point, residual, value = at
    tried = newton._tried(point, g, H, damping)
    climb = newton._Climb(point, residual, value, value, np.full(2, 1e-3), damping)
    return newton._stepped(scene, climb, tried, scene.residuals([p for points in tried for p in points]))


def test_a_step_keeps_to_what_is_better() -> None:
    """At the best point no step is taken and the damping grows a thousandfold, to one at most; else it falls tenfold."""
    scene = Few(3.0 * A + 1e-3 * RNG.standard_normal(12), sd=1.0)
    best = fitted(scene, at(line("a", 0.1)))
    g = best.jacobian.T @ over_levels(scene, best.residual, best.levels)
    here = (best.point, best.residual, best.value)
    there = stepped(scene, here, -g, best.information, 1e-5)
    assert (there.gain, there.value) == (0.0, best.value) or there.gain < 1e-6
    assert there.point is best.point or there.gain > 0.0
    assert there.damping in (pytest.approx(1e-2), pytest.approx(1e-6))
    away = replace(best, point=at(line("a", 2.0)))
    residual = scene.residuals([away.point])[:, 0]
    J, _ = derivative(scene, away.point, residual, best.steps)
    levels = levels_of(scene, residual)
    J = over_levels(scene, J, levels)
    start = log_posterior(scene, residual, away.point.unknowns)
    g = J.T @ over_levels(scene, residual, levels)
    there = stepped(scene, (away.point, residual, start), g, J.T @ J, 1e-6)
    assert there.gain > 0.0
    assert there.value == pytest.approx(start + there.gain)
    assert there.damping == pytest.approx(1e-7)
    assert there.point.placed[0].effect.coefficient == pytest.approx(3.0, abs=0.1)  # type: ignore[attr-defined]
    assert there.residual == pytest.approx(scene.residuals([there.point])[:, 0])


def test_no_better_point_is_none() -> None:
    """With the opposite slope every step is worse."""
    scene = Few(3.0 * A)
    point = at(line("a", 2.0))
    residual = scene.residuals([point])[:, 0]
    value = log_posterior(scene, residual, point.unknowns)
    J, _ = derivative(scene, point, residual, np.full(2, 1e-3))
    down, H = -J.T @ residual, J.T @ J + np.eye(2)
    found = stepped(scene, (point, residual, value), down, H, 1e-6)
    assert (found.gain, found.value) == (0.0, value)
    assert found.point is point
    assert found.damping == pytest.approx(1e-3)
    assert stepped(scene, (point, residual, value), down, H, 0.5).damping == 1.0


class Winding(Few):
    """The same with ``y - sin(3 a) A`` in place of ``y - a A``: every third of a turn is another maximum."""

    has_several_maxima = True

    def residuals(self, points: Sequence[ScenePoint]) -> Array:
        """With what the coefficient makes of a smooth hill on top, so that one of the maxima is the highest."""
        a = np.array([p.placed[0].effect.coefficient for p in points])  # type: ignore[attr-defined]
        left = (self.y[:, None] - np.outer(A, np.sin(3.0 * a))) + np.outer(B, a)
        return np.asarray(left - np.outer(BESIDE, [p.unknowns[0] for p in points]))


class OfOneMaximum(Winding):
    """The same, which is not known to have several."""

    has_several_maxima = False


def test_a_fit_from_several_starts_is_the_highest_of_their_fits() -> None:
    """As high as the best of the fits from each, whatever the order; a scene of one maximum begins at the likeliest."""
    scene = Winding(A + 1e-3 * B)
    starts = [at(line("a", v)) for v in (4.0, 2.2, -1.8, 0.1)]
    alone = [fitted(scene, s) for s in starts]
    assert max(f.value for f in alone) - min(f.value for f in alone) > 1.0
    for order in (starts, starts[::-1]):
        found = fitted_from(scene, order, alone[0])
        assert found.value == pytest.approx(max(f.value for f in alone), abs=1e-3)
    highest = at(line("a", -0.4))  # at its foot
    lower = min(alone, key=lambda f: f.value).point
    other = OfOneMaximum(scene.y)
    for order in ([lower, highest], [highest, lower]):
        found = fitted_from(other, order, fitted(other, highest))
        assert found.value == pytest.approx(fitted(other, lower).value, abs=1e-3)
        assert found.value < fitted(other, highest).value - 1.0


def test_a_trial_ends_where_it_cannot_come_high_enough() -> None:
    """What would have to be far higher than it may become ends after two steps; what may ends near its maximum."""
    scene = Few(np.r_[np.zeros(8), np.exp(-TIME[8:] / 3.0)])
    far, near = at(lag(300.0)), fitted(scene, at())
    there = fitted_from(scene, [far], near).value
    assert fitted_from(scene, [far], near, least=there - 1.0).value == pytest.approx(there, abs=0.05)
    assert fitted_from(scene, [far], near, least=there + 1e6).value < there - 1e-3


def test_fits_at_the_same_place_are_one(monkeypatch: pytest.MonkeyPatch) -> None:
    """Residuals that differ by less than a third of a standard deviation in all: whatever the numbers are."""
    scene = Winding(A + 1e-3 * B)
    climbs = [
        newton._begun(scene, p, scene.residuals([p])[:, 0])
        for p in map(at, map(line, "aaa", (0.1, 0.12, 2.2)))
    ]
    size = float(np.linalg.norm(climbs[0].residual - climbs[1].residual))
    assert size > 0.0
    for limit, kept in ((0.9 * size, 3), (1.1 * size, 2)):
        monkeypatch.setattr(newton, "SAME_PLACE_SD", limit)
        assert len(newton._promising(climbs, 0)) == kept


# The screen.


def test_bases_are_orthonormal_and_leave_out_what_is_twice_there() -> None:
    J = np.column_stack([A, 2.0 * A, 1e-8 * B, np.zeros(12)])
    Q = basis(J)
    assert Q.shape == (12, 2)
    assert pytest.approx(np.eye(2), abs=1e-12) == Q.T @ Q
    assert orthogonal_part(A + B, Q) == pytest.approx(np.zeros(12), abs=1e-9)
    assert basis(np.zeros((12, 0))).shape == (12, 0)
    assert orthogonal_part(A, basis(np.zeros((12, 0)))) == pytest.approx(A)


def test_the_screen_is_least_squares() -> None:
    """Half of the fall of the sum of squares, beside a line that is there and the unknown, for the better start."""
    scene = Few(3.0 * A + 0.8 * B + np.exp(-TIME / 3.0))
    base = fitted(scene, at(line("a", 0.1)))
    found = {s.start.effect.name: s for s in screen(scene, base)}
    r = over_levels(scene, base.residual, base.levels)
    weight = over_levels(scene, np.ones(12), base.levels)
    Q = np.linalg.qr(np.column_stack([A, BESIDE]) * weight[:, None])[0]
    left = r - Q @ (Q.T @ r)
    direction = B * weight - Q @ (Q.T @ (B * weight))
    gain = 0.5 * (direction @ left) ** 2 / (direction @ direction)
    assert found["scale_factor"].gain == pytest.approx(gain, rel=1e-4)
    cosine = found["scale_factor"].direction @ direction
    assert abs(cosine) == pytest.approx(
        np.linalg.norm(found["scale_factor"].direction) * np.linalg.norm(direction)
    )
    gains = []
    for tau in (0.5, 3.0):
        there = (scene.residuals([at(line("a", 0.0), lag(tau))])[:, 0]) * weight
        slope = np.exp(-TIME / tau) * TIME / tau * weight
        slope = slope - Q @ (Q.T @ slope)
        there = there - Q @ (Q.T @ there)
        after = there - slope * (slope @ there) / (slope @ slope)
        gains.append(0.5 * (left @ left - after @ after))
    assert found["sensor_lag"].gain == pytest.approx(max(gains), rel=0.02)
    assert found["sensor_lag"].start.effect.tau == (0.5, 3.0)[int(np.argmax(gains))]  # type: ignore[attr-defined]
    order = [s.gain for s in screen(scene, base)]
    assert order == sorted(order, reverse=True)


def test_claims_are_squared_cosines() -> None:
    """Of a direction of three parts in an effect to four parts of its own: 9 / 25; of nothing none."""
    own = [np.eye(12)[:, :1], np.eye(12)[:, 1:3]]
    columns = np.zeros((12, 2))
    columns[0, 0], columns[1, 1] = 3.0, 1.0
    assert _claims(columns, np.array([4.0, 0.0]), own) == pytest.approx([9.0 / 25.0, 1.0])
    assert _claims(columns, np.array([4.0, 1.0]), own) == pytest.approx([9.0 / 25.0, 0.5])
    assert _claims(np.zeros((12, 1)), np.zeros(1), own) == pytest.approx([0.0, 0.0])
    assert _claims(columns, np.array([4.0, 1.0]), []).shape == (0,)


def test_claims_do_not_depend_on_units() -> None:
    """Of a thousandth of the same columns they are the same."""
    own = [np.eye(12)[:, :1], np.eye(12)[:, 1:3]]
    columns = np.zeros((12, 2))
    columns[0, 0], columns[1, 1] = 3e-3, 1e-3
    assert _claims(columns, np.array([4e-3, 1e-3]), own) == pytest.approx([9.0 / 25.0, 0.5])


def test_a_direction_counts_by_its_own_share_whatever_its_size() -> None:
    """One that is another but for a hundredth of it gains nothing; a small one gains what a large one does."""

    @dataclass(frozen=True)
    class Scaled(Few):
        """The place b has another sensitivity."""

        of_b: tuple[float, float] = (0.0, 1.0)

        def residuals(self, points: Sequence[ScenePoint]) -> Array:
            mixed = self.of_b[0] * A + self.of_b[1] * B
            sizes = [sum(p.effect.coefficient for p in q.placed if p.where == "b") for q in points]  # type: ignore[attr-defined]
            return super().residuals(points) + np.outer(B - mixed, sizes)

        def candidates(self, placed: Sequence[Placed]) -> list[list[Placed]]:
            return [[line("b")]]

    gains = {}
    for of_b in ((0.0, 1.0), (0.0, 1e-4), (1.0, 0.01), (1e3, 10.0)):
        scene = Scaled(3.0 * A + 0.8 * B, of_b=of_b)
        (found,) = screen(scene, fitted(scene, at(line("a", 0.1))))
        gains[of_b] = found.gain
    assert gains[0.0, 1.0] > 1.0
    assert gains[0.0, 1e-4] == pytest.approx(gains[0.0, 1.0], rel=1e-6)
    assert gains[1.0, 0.01] == pytest.approx(0.0, abs=1e-9)
    assert gains[1e3, 10.0] == pytest.approx(0.0, abs=1e-9)


def test_each_effect_has_directions_of_its_own() -> None:
    scene = Few(3.0 * A - B)
    base = fitted(scene, at(line("a", 0.1), line("b", 0.1)))
    first, second = _own(base)
    weight = over_levels(scene, np.ones(12), base.levels)
    for mine, other, found in ((A, B, first), (B, A, second)):
        Q = np.linalg.qr(np.column_stack([other, BESIDE]) * weight[:, None])[0]
        rest = mine * weight - Q @ (Q.T @ (mine * weight))
        assert abs(found[:, 0] @ rest) == pytest.approx(np.linalg.norm(rest), rel=1e-6)


def test_what_cannot_be_computed_is_no_start() -> None:
    class Broken(Few):
        def residuals(self, points: Sequence[ScenePoint]) -> Array:
            out = super().residuals(points)
            for k, p in enumerate(points):
                if any(q.effect.name == "sensor_lag" for q in p.placed):
                    out[3, k] = np.nan
            return out

    scene = Broken(3.0 * A)
    base = fitted(scene, at(line("a", 0.1)))
    found = {s.start.effect.name: s for s in screen(scene, base)}
    assert found["sensor_lag"].gain == -np.inf
    assert (found["sensor_lag"].direction == 0.0).all()
    assert isinstance(found["scale_factor"], Screened)


def test_columns_of_the_last_effect_alone() -> None:
    scene = Few(3.0 * A)
    base = replace(fitted(scene, at(line("a", 0.1))), levels=np.array([2.0, 4.0]))
    point = at(line("a", 1.0), line("b", 2.0))
    found = new_columns(scene, base, point, scene.residuals([point])[:, 0])
    assert found.shape == (12, 1)
    assert found[:, 0] == pytest.approx(-B / np.r_[np.full(8, 2.0), np.full(4, 4.0)], rel=1e-5)
