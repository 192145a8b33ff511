"""Proves that a scene is explained as its likelihood says: evidence, intervals, what is alike, nothing where nothing is.

The scene is this file's: two channels that are straight lines and decays in white noise, so that every integral and
every standard deviation is known. Rates: without an effect an addition is named at e^-1.5 over the number of
candidates at most (its evidence is asked to be above that), so of 20 seeds more than 3 happen in less than 4 % of
the choices of seeds; numbers are held to 2.5 half-widths of their 95 % intervals (1e-6). Seeds are fixed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pytest
from numpy.typing import NDArray

from kfgen.effects import Effect, make
from kfgen.effects.noise_model import ChannelNoise, NoiseModel, Term
from kfgen.effects.series import OF_A_COEFFICIENT
from kfgen.gap.core.search import Distinguishability
from kfgen.gap.core.thresholds import MIN_EVIDENCE_NATS
from kfgen.gap.core.whitener import Whitener
from kfgen.gap.motion.motion_scene import motion_scene
from kfgen.gap.scene.addition import ranked
from kfgen.gap.scene.evidence import evidence
from kfgen.gap.scene.explanation import explained
from kfgen.gap.scene.newton import derivative, fitted
from kfgen.gap.scene.posterior import NOISE_LEVEL_SD_OF_LOG, levels_of, log_posterior
from kfgen.gap.scene.scene import Placed, ScenePoint, Unknown, coordinates, moved
from kfgen.gap.scene.scene_gap import scene_gap
from kfgen.gap.scene.screen import screen
from kfgen.log.log import Channel, Log

Array = NDArray[np.float64]

N = 2000
T = np.arange(N) * 0.01
WAVE = np.sqrt(2.0 / N) * np.cos(np.pi * (np.arange(N) + 0.5) * 3 / N)
OTHER = np.sqrt(2.0 / N) * np.cos(np.pi * (np.arange(N) + 0.5) * 7 / N)
ANGLE = 0.4
SHAPES = {"a": WAVE, "a2": np.cos(ANGLE) * WAVE + np.sin(ANGLE) * OTHER, "b": OTHER}
"""Unit directions of what is linear: by where it is placed, in the channel of its letter."""


@dataclass(frozen=True)
class Lines:
    """Channels ``a`` and ``b``; a scale is a line along `SHAPES`, a lag a decay of ten in channel ``b``."""

    y: Array
    known: bool = False
    t: tuple[float, float] = (0.0, 20.0)

    channels = ("a", "b")
    dt = 0.01
    span = property(lambda self: self.t)

    @property
    def lengths(self) -> tuple[int, ...]:
        return (self.y.shape[1], self.y.shape[1])

    @property
    def unknowns(self) -> tuple[Unknown, ...]:
        return (Unknown("offset", "1", 0.0, np.inf),) if self.known else ()

    def residuals(self, points: Sequence[ScenePoint]) -> Array:
        i = round(self.t[0] / self.dt)
        keep = slice(i, i + self.y.shape[1])
        out = []
        for point in points:
            left = {"a": self.y[0].copy(), "b": self.y[1].copy()}
            for p in point.placed:
                if p.effect.name == "scale_factor":
                    left[p.where[0]] -= p.effect.coefficient * SHAPES[p.where][keep]  # type: ignore[attr-defined]
                else:
                    left["b"] -= 3.0 * np.exp(-T[keep] / p.effect.tau)  # type: ignore[attr-defined]
            if self.known:
                left["a"] = left["a"] - point.unknowns[0]
            out.append(np.concatenate([left["a"], left["b"]]))
        return np.array(out).T

    def candidates(self, placed: Sequence[Placed]) -> list[list[Placed]]:
        every = [[Placed(make("scale_factor", coefficient=0.0), w)] for w in SHAPES]
        every.append([Placed(make("sensor_lag", tau=tau), "b") for tau in (0.1, 1.0, 5.0)])
        here = [(p.effect.name, p.where) for p in placed]
        return [g for g in every if (g[0].effect.name, g[0].where) not in here]

    def part(self, start: float, stop: float) -> Lines:
        i, j = (round(s / self.dt) for s in (start, stop))
        return replace(self, y=self.y[:, i : min(j, N)], t=(start, stop))


def noise(seed: int) -> Array:
    return np.random.default_rng([seed, 31]).standard_normal((2, N))


def hidden(seed: int, size: float = 8.0, tau: float = 0.0, where: str = "a") -> Lines:
    y = noise(seed)
    y["ab".index(where[0])] += size * SHAPES[where]
    y[1] += 3.0 * np.exp(-T / tau) if tau else 0.0
    return Lines(y)


def scale(where: str, value: float = 0.0) -> Placed:
    return Placed(make("scale_factor", coefficient=value), where)


NONE = ScenePoint((), np.zeros(0))


def test_the_level_of_the_noise_is_the_most_likely_one() -> None:
    """Of ``n ln s + p / 2 s^2 + (ln s)^2 / 2 NOISE_LEVEL_SD_OF_LOG^2``, by a fine grid."""
    scene = Lines(noise(1) * np.array([[1.3], [0.7]]))
    r = scene.residuals([NONE])[:, 0]
    s = np.exp(np.linspace(-1.0, 1.0, 200_001))
    for part, level in zip(np.split(r, 2), levels_of(scene, r)):
        cost = N * np.log(s) + 0.5 * (part @ part) / s**2 + 0.5 * (np.log(s) / NOISE_LEVEL_SD_OF_LOG) ** 2
        assert level == pytest.approx(s[np.argmin(cost)], rel=1e-4)


def test_a_linear_effect_is_least_squares() -> None:
    """Value, standard deviation and gain in closed form."""
    scene = hidden(2)
    fit = fitted(scene, ScenePoint((scale("a"),), np.zeros(0)))
    found = float(coordinates(fit.point)[0])
    assert found == pytest.approx(float(WAVE @ scene.y[0]), rel=1e-6)
    sd = float(np.sqrt(fit.covariance[0, 0]))
    assert sd == pytest.approx(float(fit.levels[0]), rel=1e-6)
    assert moved(fit.point, coordinates(fit.point)).placed == fit.point.placed


def numerical(scene: Lines, placed: Placed, name: str, grid: Array, weight: Array) -> float:
    """Logarithm of the integral of the posterior over one parameter."""
    points = [
        ScenePoint((replace(placed, effect=replace(placed.effect, **{name: float(v)})),), np.zeros(0))
        for v in grid
    ]
    R = scene.residuals(points)
    value = np.array([log_posterior(scene, R[:, k], np.zeros(0)) for k in range(grid.size)])
    return float(value.max() + np.log(np.trapezoid(np.exp(value - value.max()), weight)))


def test_the_evidence_is_the_integral_of_the_likelihood() -> None:
    """Of a line over a coefficient (its prior at the best value), of a decay over the logarithm of its time.

    The line is normal but for the level: to 1e-3. The decay is skew: to 0.05.
    """
    scene = hidden(3)
    fit = fitted(scene, ScenePoint((scale("a"),), np.zeros(0)))
    best = float(coordinates(fit.point)[0])
    grid = best + np.linspace(-8.0, 8.0, 401)
    expected = numerical(scene, scale("a"), "coefficient", grid, grid) - np.log(OF_A_COEFFICIENT * best)
    assert evidence(scene, fit) == pytest.approx(expected, abs=0.01)
    scene = hidden(3, 0.0, tau=1.0)
    lag = Placed(make("sensor_lag", tau=0.8), "b")
    fit = fitted(scene, ScenePoint((lag,), np.zeros(0)))
    grid = np.exp(np.linspace(-1.0, 1.0, 401))
    expected = numerical(scene, lag, "tau", grid, np.log(grid)) - np.log(np.log(N))
    assert evidence(scene, fit) == pytest.approx(expected, abs=0.05)
    assert evidence(scene, fitted(scene, NONE)) == log_posterior(
        scene, scene.residuals([NONE])[:, 0], np.zeros(0)
    )


def test_a_free_number_of_the_world_is_fitted_and_costs_no_effect() -> None:
    """An unknown offset: its least squares, and the gain of a line beside it is that without its mean."""
    scene = replace(hidden(4), known=True)
    y = scene.y.copy()
    y[0] += 7.0
    scene = replace(scene, y=y)
    fit = fitted(scene, ScenePoint((scale("a"),), np.zeros(1)))
    A = np.column_stack([WAVE, np.ones(N)])
    np.testing.assert_allclose(coordinates(fit.point), np.linalg.lstsq(A, y[0], rcond=None)[0], rtol=1e-5)


@pytest.mark.parametrize("seed", range(3))
def test_two_effects_are_found_with_their_intervals(seed: int) -> None:
    scene = hidden(seed, 9.0, 1.5)
    found = scene_gap(scene)
    assert found.verdict == "effects_found"
    placed = {(f.effect.name, f.where): f for f in found.findings}
    assert set(placed) == {("scale_factor", "a"), ("sensor_lag", "b")}
    line, lag = placed["scale_factor", "a"], placed["sensor_lag", "b"]
    lo, hi = line.ci95["coefficient"]
    assert abs(9.0 - 0.5 * (lo + hi)) < 2.5 * 0.5 * (hi - lo)
    assert 0.5 * (hi - lo) == pytest.approx(1.96, rel=0.05)
    lo, hi = np.log(lag.ci95["tau"])
    assert abs(np.log(1.5) - 0.5 * (lo + hi)) < 2.5 * 0.5 * (hi - lo)
    slope = 3.0 * T / 1.5 * np.exp(-T / 1.5)  # derivative in ln tau
    assert 0.5 * (hi - lo) == pytest.approx(1.96 / np.sqrt(slope @ slope), rel=0.15)
    before = {c: b for c, b, _ in found.rms}
    assert before["b"] > 1.1
    assert all(abs(a - 1.0) < 4.5 * np.sqrt(0.5 / N) for _, _, a in found.rms)


def test_what_is_alike_has_its_angle() -> None:
    """cos^2 of the directions that the scene was made of, whatever the noise; across channels none."""
    scene = hidden(5, 12.0)
    (added, *_) = explained(scene).added
    assert added.label == ("scale_factor", "a")
    cos2 = {(o.effect, o.where): o.cos2 for o in added.others}
    assert cos2["scale_factor", "a2"] == pytest.approx(np.cos(ANGLE) ** 2, rel=1e-3)
    assert cos2.get(("scale_factor", "b"), 0.0) < 1e-6
    assert sum(added.probabilities.values()) == pytest.approx(1.0)


def test_directions_that_are_the_same_cannot_be_distinguished() -> None:
    """Two names for one line share what is probable; the rival stands among what is not ruled out."""

    class Twice(Lines):
        def candidates(self, placed: Sequence[Placed]) -> list[list[Placed]]:
            if placed:
                return []
            return [[scale("a")], [Placed(make("scale_factor", coefficient=0.0), "a ")]]

        def residuals(self, points: Sequence[ScenePoint]) -> Array:
            bare = [
                ScenePoint(tuple(replace(p, where=p.where.strip()) for p in q.placed), q.unknowns)
                for q in points
            ]
            return super().residuals(bare)

    scene, base = Twice(hidden(6).y), fitted(Lines(hidden(6).y), NONE)
    trials = ranked(scene, base, screen(scene, base))
    assert trials[0].gain == pytest.approx(trials[1].gain, abs=1e-6)


def test_nothing_is_found_where_there_is_nothing() -> None:
    found = [scene_gap(Lines(noise(100 + seed))) for seed in range(20)]
    assert sum(bool(f.findings) for f in found) <= 3
    assert sum(f.verdict == "unknown_effect" for f in found) <= 1
    assert all(f.gap.before < 0.02 for f in found)


def test_what_no_candidate_explains_is_unknown() -> None:
    y = noise(7)
    y[0] += np.linspace(-2.0, 2.0, N) ** 2
    found = scene_gap(Lines(y))
    assert found.verdict == "unknown_effect"
    assert {t.channel for t in found.after if t.significant} == {"a"}


def off(p: Placed) -> Placed:
    """With every signed parameter at zero."""
    signed = {q.name: 0.0 for q in p.effect.parameters() if q.kind == "signed"}
    effect: Effect = replace(p.effect, **signed)
    return replace(p, effect=effect)


def test_at_zero_an_effect_leaves_the_residuals_as_they_are() -> None:
    """Every candidate of a rate table that has a zero."""
    t, rng = np.arange(600) * 0.02, np.random.default_rng(1)
    channels = {}
    for k, a in enumerate("xyz"):
        w = np.sin((1.0 + 0.3 * k) * t) + 0.3 * np.cos((4.0 + k) * t)
        channels[f"ref_gyro_{a}"] = Channel.of(w, "rad/s")
        channels[f"gyro_{a}"] = Channel.of(w + 1e-3 * rng.standard_normal(t.size), "rad/s")
    white = ChannelNoise("rad/s", (Term(make("white_noise", N=1e-3 * np.sqrt(0.02))),))
    scene = motion_scene(Log(t, channels), NoiseModel({f"gyro_{a}": white for a in "xyz"}))
    assert scene is not None
    u = np.array([x.value for x in scene.unknowns])
    starts = [g[0] for g in scene.candidates([]) if any(q.kind == "signed" for q in g[0].effect.parameters())]
    assert len(starts) > 10
    R = scene.residuals([ScenePoint((), u), *(ScenePoint((off(p),), u) for p in starts)])
    for k, p in enumerate(starts):
        np.testing.assert_allclose(R[:, k + 1], R[:, 0], atol=1e-9, err_msg=str(p))


# The parts of a fit, each by its formula.


def test_the_posterior_is_that_of_gaussians() -> None:
    """Of the residuals at their level, of the level, and of an unknown that is assumed to be 2 +- 0.5 and is 1."""

    @dataclass(frozen=True)
    class Assumed(Lines):
        @property
        def unknowns(self) -> tuple[Unknown, ...]:
            return (Unknown("offset", "1", 2.0, 0.5),)

    scene = Assumed(noise(2), known=True)
    r = scene.residuals([ScenePoint((), np.array([1.0]))])[:, 0]
    s, value = levels_of(scene, r), 0.0
    for part, level in zip(np.split(r, 2), s):
        value -= N * np.log(level) + 0.5 * (part @ part) / level**2
        value -= 0.5 * (np.log(level) / NOISE_LEVEL_SD_OF_LOG) ** 2
    assert log_posterior(scene, r, np.array([1.0])) == pytest.approx(value - 0.5 * (1.0 / 0.5) ** 2, abs=1e-9)


@pytest.mark.parametrize("begun", [1e-9, 1e-3, 1e3])
def test_differences_are_as_large_as_can_be_seen(begun: float) -> None:
    """Of a line of unit length a step of 0.1 changes the residuals by 0.1; a hundredth to a hundred times that will do."""
    scene = hidden(3)
    point = ScenePoint((scale("a", 1.0),), np.zeros(0))
    J, steps = derivative(scene, point, scene.residuals([point])[:, 0], np.array([begun]))
    assert 1e-3 < steps[0] < 10.0
    assert J[:N, 0] == pytest.approx(-WAVE, abs=1e-9)
    assert (J[N:, 0] == 0.0).all()
    assert begun != 1e-3 or steps[0] == pytest.approx(0.1)


def test_steps_that_are_seen_stay() -> None:
    scene = hidden(3)
    point = ScenePoint((scale("a", 1.0), scale("b", 1.0)), np.zeros(0))
    _, steps = derivative(scene, point, scene.residuals([point])[:, 0], np.array([0.5, 1e-6]))
    assert steps == pytest.approx([0.5, 0.1])


def test_a_fit_gives_derivatives_at_its_point() -> None:
    """The decay's derivative in the logarithm of its time, at the time that was found."""
    scene = hidden(4, 0.0, 2.0)
    fit = fitted(scene, ScenePoint((Placed(make("sensor_lag", tau=1.0), "b"),), np.zeros(0)))
    tau = fit.point.placed[0].effect.tau  # type: ignore[attr-defined]
    assert tau == pytest.approx(2.0, rel=0.1)
    expected = -3.0 * np.exp(-T / tau) * T / tau / levels_of(scene, fit.residual)[1]
    assert fit.jacobian[N:, 0] == pytest.approx(expected, abs=0.02 * np.abs(expected).max())
    assert fit.information[0, 0] == pytest.approx(expected @ expected, rel=0.02)
    assert fit.value == pytest.approx(log_posterior(scene, fit.residual, np.zeros(0)))


def test_a_record_that_distinguishes_at_once_is_long_enough() -> None:
    twice = Distinguishability("bias", "a", 0.9, 0.5 * MIN_EVIDENCE_NATS)
    assert twice.record_factor == pytest.approx(2.0)
    assert replace(twice, nats=1e6).record_factor == 1.0
    assert replace(twice, nats=None).record_factor is None


def test_the_weight_of_a_constant() -> None:
    """Of white noise of 0.1 in 100 samples a second every ordinate has 1 / (0.1^2 100), the constant none unless it counts."""
    white = [make("white_noise", N=0.1)]
    assert Whitener.of(white, 64, 0.01).weight == pytest.approx(np.r_[0.0, np.full(63, 1.0)])
    assert Whitener.of(white, 64, 0.01, constant=True).weight == pytest.approx(np.ones(64))
