"""Random errors in flight: states of the filter, found, and named where their course is as random as they claim.

Flights come from `benchmarks/flight`, plain numpy that shares no code with kfgen. Seeds are fixed; a random error by chance
needs 5 nats, and a random course is called none with a rate of one in a hundred.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from in_part import in_part

import kfgen as kf
from kfgen.core.units import parse_unit
from kfgen.effects import make
from kfgen.effects.noise_model import ChannelNoise, NoiseModel, Term
from kfgen.gap.core.search import Chosen
from kfgen.gap.flight.flight_scene import flight_scene
from kfgen.gap.flight.linear.linear_flight import BYTES_AT_ONCE, COLUMNS_AT_ONCE
from kfgen.gap.flight.noise.noise_sizes import NoiseSizes
from kfgen.gap.flight.scene import FlightScene
from kfgen.gap.scene.explanation import SceneExplanation, evidence_of_all
from kfgen.gap.scene.newton import fitted
from kfgen.gap.scene.scene import Placed, ScenePoint, start_of
from kfgen.log.log import Log
from kfgen.model.filter import FilterModel
from kfgen.model.filter_file import FilterFile

sys.path.insert(0, str(Path(__file__).parents[1] / "benchmarks" / "flight"))
flight = pytest.importorskip("flight")
trial = pytest.importorskip("trial")

pytest.importorskip("numba")

SENSORS = ["gnss_position", "gnss_velocity", "mag", "barometer"]
STEP = ("bias_step", "gyro_y", {"size": 4.5e-4, "time": 25.0})
DRIFT = make("gauss_markov", sigma=1.0, tau=6.0)


@lru_cache
def model() -> FilterModel:
    return kf.build("ins15", options={"left_out": "false"}, sensors=SENSORS)


def log_of(*effects: Any, seed: int = 1, duration: float = 60.0, unlisted: str = "") -> Log:
    made = [flight.Effect(name, where, values) for name, where, values in effects]
    found = trial.log_of(trial.Case("quadrotor", seed, duration, unlisted=unlisted), made)
    assert isinstance(found, Log)
    return found


def scene_of(log: Log, of: FilterModel | None = None) -> FlightScene:
    found = flight_scene(log, of or model())
    assert found is not None
    return found


@lru_cache
def clean() -> FlightScene:
    return scene_of(log_of(duration=40.0))


@pytest.mark.parametrize(
    "effect", in_part([make("gauss_markov", sigma=0.8, tau=5.0), make("rate_random_walk", K=0.2)])
)
def test_a_random_error_is_the_state_that_build_gives_a_filter(effect: Any) -> None:
    """The likelihood of a flight is that of a filter whose file has the term, to what the two paths differ."""
    log = log_of(duration=40.0)
    noise = NoiseModel({"gnss_p_N": ChannelNoise("m", (Term(make("sample_noise", sd=1.5)), Term(effect)))})
    built = kf.build("ins15", options={"left_out": "false"}, sensors=SENSORS, noise=noise)
    assert parse_unit("m").same_dimension(parse_unit(built.channel_units["gnss_p_N"]))
    bare = kf.build(
        "ins15", options={"left_out": "false"}, sensors=SENSORS,
        noise=NoiseModel({"gnss_p_N": ChannelNoise("m", (Term(make("sample_noise", sd=1.5)),))}),
    )  # fmt: skip
    random_error = scene_of(log, bare).with_random_error(Placed(effect, "gnss_p_N"))
    expected = scene_of(log, built).path.linear.log_likelihood
    assert random_error.path.linear.log_likelihood == pytest.approx(expected, abs=0.05)
    assert abs(expected - scene_of(log, bare).path.linear.log_likelihood) > 1.0


def test_a_random_error_of_size_zero_changes_nothing() -> None:
    path = clean().path
    for channel in ("gyro_z", "accel_x", "mag_y", "baro"):
        none = replace(path, random_errors=(Placed(make("gauss_markov", sigma=1e-12, tau=3.0), channel),))
        assert none.linear.log_likelihood == pytest.approx(path.linear.log_likelihood, abs=1e-5)


def test_a_flight_in_blocks_of_steps_has_the_numbers_of_one_block(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every pass over the filter's steps, with random errors of an input and of a reading, and sizes of noises."""
    sizes = NoiseSizes({"gyro": 1.3, "accel": 0.8})
    errors = tuple(Placed(DRIFT, c) for c in ("gyro_z", "baro"))
    path = clean().path
    rng = np.random.default_rng(0)
    du, dz = (rng.standard_normal((*a.shape, 3)) for a in (path.log.u, path.rows.z))

    def numbers() -> list[Any]:
        linear = replace(path, sizes=sizes, random_errors=errors).linear
        passes = linear.smoothed(), linear.columns(du, dz), *linear.products(linear.e)
        return [linear.e, linear.S, linear.K, *passes, *linear.scores(sizes.inputs)]

    whole = numbers()
    monkeypatch.setattr("kfgen.gap.flight.linear.step_matrices.KEPT_STEPS", 0)
    monkeypatch.setattr("kfgen.gap.flight.linear.step_matrices.STEPS_AT_ONCE", 777)
    for found, wanted in zip(numbers(), whole):
        np.testing.assert_allclose(found, wanted, rtol=0.0, atol=1e-9 * np.abs(wanted).max())


def test_many_columns_of_a_long_flight_are_not_held_at_once() -> None:
    linear = clean().path.linear
    assert linear.columns_at_once == COLUMNS_AT_ONCE
    longer = replace(linear, matrices=replace(linear.matrices, steps=400_000))
    at_once = longer.columns_at_once
    assert 8 * at_once * 400_000 * 6 < BYTES_AT_ONCE < 8 * (at_once + 1) * (400_000 * 6 + 4 * linear.y.size)


def test_a_random_error_of_an_input_is_that_error_in_all_readings() -> None:
    """Its smoothed course follows the error that was put into the readings of a gyro."""
    rng = np.random.default_rng(3)
    log = log_of(duration=60.0)
    K = 2e-3
    course = K * 0.1 * np.cumsum(rng.standard_normal(log.n))
    channels = dict(log.channels)
    channels["gyro_z"] = replace(channels["gyro_z"], values=log.values("gyro_z") + course)
    scene = scene_of(Log(log.t, channels, source="flight"))
    there = scene.with_random_error(Placed(make("rate_random_walk", K=K), "gyro_z"))
    found = there.path.linear.smoothed()[:, there.path.equations.n]
    bias = there.path.x[:, there.path.equations.names.index("bg_z")]
    both = found + bias
    assert np.corrcoef(both - both.mean(), course - course.mean())[0, 1] > 0.9


def test_nothing_random_is_found_in_a_clean_flight() -> None:
    scene = clean()
    fit = fitted(scene, ScenePoint((), np.array([u.value for u in scene.unknowns])))
    assert all(f.evidence < 5.0 for f in scene.likely_random_errors(fit.point))


@pytest.mark.long
def test_a_list_of_one_effect_is_worth_what_it_gained() -> None:
    """A step costs its time too, where a random error competes with it: the two are held against each other by this sum."""
    there = SceneExplanation(stepped := scene_of(log_of(STEP)), fitted(stepped, start_of(stepped)))
    step = next(a for a in there.ranked() if a.label == ("bias_step", "gyro_y"))
    whole = evidence_of_all(stepped, step.fit, [Chosen(step, {})])
    assert step.cost > np.log(10.0)
    assert whole - evidence_of_all(stepped, there.fit) == pytest.approx(step.gain, abs=1e-9)


@pytest.mark.long
def test_a_walk_that_looks_like_a_ramp_is_one_walk() -> None:
    """In this minute it went 9 mrad/s one way; a ramp and a smaller random error beside it describe that as well."""
    found = kf.find_gap(log_of(("rate_random_walk", "gyro_z", {"K": 6e-4}), seed=1), model())
    assert [(f.name, f.where) for f in found.findings] == [("rate_random_walk", "gyro_z")]
    assert found.findings[0].ci95["K"][0] < 6e-4 < found.findings[0].ci95["K"][1]


@pytest.mark.long
def test_a_random_walk_is_named() -> None:
    found = kf.find_gap(log_of(("rate_random_walk", "gyro_z", {"K": 3e-3}), duration=40.0), model())
    top = found.findings[0]
    assert found.verdict == "effects_found"
    assert (top.name, top.where) == ("rate_random_walk", "gyro_z")
    assert top.ci95["K"][0] < 3e-3 < top.ci95["K"][1]


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "where", "values"),
    [
        ("rate_random_walk", "gyro_z", {"K": 1.2e-3}),
        ("gauss_markov", "gnss_v_E", {"sigma": 0.1, "tau": 5.0}),
    ],
)
def test_a_random_error_is_named_and_the_updated_filter_has_no_gap(
    name: str, where: str, values: dict[str, float]
) -> None:
    log = log_of((name, where, values))
    found = kf.find_gap(log, model())
    top = found.findings[0]
    assert found.verdict == "effects_found"
    assert (top.name, top.where) == (name, where)
    assert all(top.ci95[n][0] < v < top.ci95[n][1] for n, v in values.items())
    assert isinstance(found.updated, FilterFile)
    assert kf.find_gap(log, kf.build(found.updated)).verdict == "no_gap"


@pytest.mark.long
def test_a_line_in_the_barometer_is_no_random_error() -> None:
    """A Gauss-Markov process explains a sine of 7 s without a trace; its course shows that it is none."""
    found = kf.find_gap(log_of(unlisted="sine_baro", duration=70.0), model())
    assert found.verdict == "unknown_effect"
    assert not found.findings
    said = [r for r in found.comparisons[0].refused if r.where == "baro"]
    assert [r.why for r in said] == ["it is a spectral line at 0.14 Hz"]
