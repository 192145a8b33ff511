"""Proves what is said of samples that no fit saw: none where nothing is missing, the likelihood ratio where something is.

What a known signal ``s`` is worth in ``m`` samples of noise of standard deviation ``d`` is ``|s|^2 / 2 d^2`` nats,
which chance moves by its root times the root of two. Expected values are from plain numpy.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from click.testing import Result
from numpy.typing import NDArray
from scipy.linalg import expm
from scipy.stats import chi2

from kfgen.effects import make
from kfgen.effects.noise_model import ChannelNoise, NoiseModel, Term
from kfgen.gap.motion.motion_scene import motion_scene
from kfgen.gap.scene.holdout import band_edges, every_other, gap_of, tail
from kfgen.gap.scene.noise_scale import scaled
from kfgen.gap.scene.scene_gap import SceneGap, scene_gap
from kfgen.log.log import Channel, Log

Array = NDArray[np.float64]
Cli = Callable[..., Result]

DT, N, SD = 0.02, 2500, 0.1
"""Period [s], samples, standard deviation of the noise [rad/s]."""
LIMIT = 4.0
"""Standard deviations; false-alarm rate 6e-5."""


def motion() -> Array:
    """The rates of a table [rad/s], three columns of six sines each."""
    rng = np.random.default_rng(8)
    f, phase = rng.uniform(0.1, 2.0, (6, 3)), rng.uniform(0, 2 * np.pi, (6, 3))
    return 0.4 * np.sin(2 * np.pi * f * (DT * np.arange(N))[:, None, None] + phase).sum(axis=1)


def answer(wrong: Array, seed: int, loud: tuple[float, ...] = (1.0, 1.0, 1.0)) -> SceneGap:
    """The gap of a gyro of unknown bias on a rate table, in whose readings is something `wrong`."""
    w, rng = motion(), np.random.default_rng(seed)
    y = w + [0.3, -0.2, 0.1] + wrong + np.array(loud) * SD * rng.standard_normal((N, 3))
    channels = {f"gyro_{a}": Channel.of(y[:, i], "rad/s") for i, a in enumerate("xyz")}
    channels |= {f"ref_gyro_{a}": Channel.of(w[:, i], "rad/s") for i, a in enumerate("xyz")}
    noise = ChannelNoise("rad/s", (Term(make("white_noise", N=SD * np.sqrt(DT))),))
    scene = motion_scene(Log(DT * np.arange(N), channels), NoiseModel({f"gyro_{a}": noise for a in "xyz"}))
    assert scene is not None
    return scene_gap(scene)


@pytest.mark.parametrize("seed", range(4))
def test_nothing_is_lost_where_nothing_is_missing(seed: int) -> None:
    """An unknown bias is no gap; false-alarm rate 1e-3 of each."""
    g = answer(np.zeros((N, 3)), seed)
    assert (g.verdict, g.gap.before, g.gap.after) == ("no_gap", 0.0, 0.0)


def test_the_gap_of_a_scale_is_its_likelihood_ratio_on_the_tail() -> None:
    wrong, w = np.zeros((N, 3)), motion()
    wrong[:, 0] = 0.012 * w[:, 0]
    g = answer(wrong, 4)
    s, k = wrong[:, 0], int(0.7 * N)
    nats = (
        0.5 * float(np.sum((s[k:] - s[:k].mean()) ** 2)) / SD**2
    )  # a bias takes up the mean of what is seen
    assert g.gap.held_out == "the last 30 % of the log"
    assert g.gap.before * 0.9 * N == pytest.approx(nats, abs=LIMIT * np.sqrt(2.0 * nats))
    assert g.gap.after == 0.0
    assert g.gap.closed == 1.0
    assert g.gap.ci95[0] > 0.2


def test_a_drift_goes_on_in_the_tail() -> None:
    """The constant bias that the assumed model has seen is not that of the tail."""
    wrong = np.zeros((N, 3))
    wrong[:, 2] = 0.0012 * DT * np.arange(N)
    g = answer(wrong, 9)
    (found,) = g.findings
    assert found.effect.name == "rate_ramp"
    s, k = wrong[:, 2], int(0.7 * N)
    nats = 0.5 * float(np.sum((s[k:] - s[:k].mean()) ** 2)) / SD**2
    # What is seen says where the mean of the tail is, to a standard deviation of sqrt(1 + 3/7) of its own.
    assert g.gap.before * 0.9 * N == pytest.approx(nats, abs=LIMIT * np.sqrt(2.0 * nats * (1.0 + 3.0 / 7.0)))
    assert g.gap.closed == 1.0


def test_what_is_over_before_the_tail_is_judged_on_every_other_block() -> None:
    """A warm-up of a tenth of the record."""
    t, wrong = DT * np.arange(N), np.zeros((N, 3))
    wrong[:, 1] = 0.15 * np.exp(-t / 2.0)
    g = answer(wrong, 6)
    (found,) = g.findings
    assert found.effect.name == "warm_up"
    assert g.gap.held_out == "every other block of the log"
    unseen = every_other((N,)).unseen[0]
    s = wrong[:, 1]
    nats = 0.5 * float(np.sum((s[unseen] - s[~unseen].mean()) ** 2)) / SD**2
    assert g.gap.before * 3 * unseen.sum() == pytest.approx(nats, abs=LIMIT * np.sqrt(2.0 * nats))


@pytest.mark.long
def test_chance_is_seldom_more_than_chance() -> None:
    """Of 2000 records of noise about two are above the rate of 1e-3; eight or more have a chance of 1e-3."""
    rng, edges = np.random.default_rng(1), band_edges(600)
    m = np.diff(edges).astype(float)
    found = [gap_of(rng.chisquare(m) / m, m, 0.0, 0.0, "").after > 0.0 for _ in range(2000)]
    assert sum(found) < 8


def test_an_effect_that_makes_it_worse_opens_the_gap() -> None:
    m = np.full(20, 30.0)
    g = gap_of(np.ones(20), m, -6.0, 2.0, "")
    assert (g.before, g.after) == (0.0, pytest.approx(6.0 / 600.0))


def test_held_out_samples_are_no_others() -> None:
    """Three tenths, and half of the blocks; never one twice."""
    assert [m.sum() for m in tail((1000, 50)).unseen] == [300, 15]
    cut = every_other((1000, 640))
    assert [m.sum() for m in cut.unseen] == [16 * 31, 16 * 20]
    for mask, stretches in zip(cut.unseen, cut.stretches):
        assert mask.sum() == sum(b - a for a, b in stretches)


MODEL = """format = "kfgen-model-1"
name = "motor"
[parameters]
tau = "0.4 s"
gain = "15 rad/s/V"
[states]
omega = "rad/s"
[inputs]
u = "V"
[dynamics]
omega = "(gain*u - omega)/tau"
[measurements.speed]
unit = "rad/s"
expression = "omega"
effects = [ { effect = "white_noise", N = "0.04 rad/s/sqrt(Hz)" } ]
"""


@pytest.mark.long
def test_an_actuator_is_still_on_its_way_where_the_tail_begins(kfgen: Cli, tmp_path: Path) -> None:
    """Its state is carried over: nothing is left after, and before is the power of what the model without it leaves.

    Motor and actuator are one linear system, integrated by its matrix exponential.
    """
    n, sd = 2000, 0.4
    A = np.array([[-1 / 0.4, 15.0 / 0.4, 0.0], [0.0, -1 / 0.05, 1 / 0.05], [0.0, 0.0, 0.0]])
    bare = np.array([[-1 / 0.4, 15.0 / 0.4], [0.0, 0.0]])
    full, less = expm(0.01 * A), expm(0.01 * bare)
    rng = np.random.default_rng(3)
    u = np.repeat(rng.uniform(-6.0, 6.0, 22), 100)[3 : n + 3]  # the tail begins three samples after a step
    u[:97] = 0.0  # and the log at rest
    x, assumed, true = np.zeros(2), 0.0, np.empty((n, 2))
    for k in range(n):
        true[k] = x[0], assumed
        x, assumed = (full @ [*x, u[k]])[:2], float((less @ [assumed, u[k]])[0])
    y = true[:, 0] + sd * rng.standard_normal(n)
    path, model, out = tmp_path / "log.csv", tmp_path / "model.toml", tmp_path / "out.json"
    table = np.column_stack([0.01 * np.arange(n), u, y])
    np.savetxt(path, table, delimiter=",", header="t [s],u [V],speed [rad/s]", comments="", fmt="%.12g")
    model.write_text(MODEL, encoding="utf-8")
    done = kfgen("gap", path, "--model", model, "--json", out)
    assert done.exit_code == 0, done.output
    gap = json.loads(out.read_text(encoding="utf-8"))["gap"]
    left = (y - true[:, 1])[int(0.7 * n) :] / sd
    assert gap["held_out"] == "the last 30 % of the log"
    assert gap["after"] < 0.02
    assert gap["before"] == pytest.approx(0.5 * float(np.mean(left**2) - 1.0), rel=0.02)
    assert gap["closed_fraction"] > 0.99


def test_noise_of_another_size_is_said_with_its_number() -> None:
    """Three channels of 2500 samples, the second 1.2 times as loud; the interval by its chi-square."""
    g = answer(np.zeros((N, 3)), 13, (1.0, 1.2, 1.0))
    assert g.verdict == "effects_found"
    assert not g.findings
    (found,) = g.noise_scales
    e = 1.2 * np.random.default_rng(13).standard_normal((N, 3))[:, 1]
    power = float(np.sum((e - e.mean()) ** 2))
    assert found.channel == "gyro_y"
    assert found.times == pytest.approx(np.sqrt(power / (N - 1)), rel=1e-6)
    assert found.ci95 == pytest.approx(
        [np.sqrt(power / chi2.isf(p, N - 1)) for p in (0.025, 0.975)], rel=1e-6
    )
    assert found.times == pytest.approx(1.2, abs=LIMIT * 1.2 / np.sqrt(2 * N))
    before = 0.5 * (1.2**2 - 1.0) - np.log(
        1.2
    )  # of one channel of three, of a normal deviate against another
    assert g.gap.before == pytest.approx(before / 3, rel=0.5)
    assert g.gap.after == 0.0


def test_the_updated_model_holds_the_noise_that_was_found() -> None:
    """Sizes are scaled, correlation times and deterministic effects stay."""
    walk = scaled(make("gauss_markov", sigma=2.0, tau=7.0), 1.5)
    assert (walk.sigma, walk.tau) == (3.0, 7.0)  # type: ignore[attr-defined]
    ramp = make("rate_ramp", R=2.0)
    assert scaled(ramp, 1.5) == ramp
