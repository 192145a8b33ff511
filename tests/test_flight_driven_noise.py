"""Proves that noise of inertial sensors that follows the log's vibration level, or its clipping, is named and emitted.

Flights come from `benchmarks/flight`, plain numpy that shares no code with kfgen; noise is added to their columns by a
vibration that comes and goes, and by an accelerometer that clips in bursts. Seeds are fixed.
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
from numpy.typing import NDArray

import kfgen as kf
from kfgen.effects import make
from kfgen.gap.core.result import NoiseScale
from kfgen.gap.flight.flight_scene import flight_scene
from kfgen.gap.flight.noise.noise_sizes import NoiseSizes
from kfgen.gap.scene.newton import fitted
from kfgen.gap.scene.scene import Placed, start_of
from kfgen.gap.scene.scene_gap import _not_followed
from kfgen.log.log import Channel, Log
from kfgen.model.build import filter_of

sys.path.insert(0, str(Path(__file__).parents[1] / "benchmarks" / "flight"))
trial = pytest.importorskip("trial")

pytest.importorskip("numba")

SENSORS = ["gnss_position", "gnss_velocity", "mag", "barometer"]
MODEL = kf.build("ins15", options={"left_out": "false", "biases": "constant"}, sensors=SENSORS)
DURATION_S = 120.0
ACCEL_SD, GYRO_SD = 2e-3 * 10.0, 1.5e-4 * 10.0
"""Of a sample at 100 Hz [m/s^2], [rad/s]: the densities of the flights over the root of the period."""
SLOPE = 0.8
"""Of the logarithm of the noise for 1 m/s^2 of vibration."""


@lru_cache
def flight(seed: int) -> Log:
    found = trial.log_of(trial.Case("quadrotor", 182_310 + seed, DURATION_S), [])
    assert isinstance(found, Log)
    return found


def vibration(log: Log, seed: int) -> NDArray[np.float64]:
    """A level that comes and goes [m/s^2], at every sample."""
    rng = np.random.default_rng([seed, 9])
    knots = np.arange(log.t[0], log.t[-1] + 8.0, 4.0)
    return np.interp(log.t, knots, rng.uniform(0.2, 4.0, knots.size))


def with_level(log: Log, level: NDArray[np.float64], name: str, unit: str) -> dict[str, Channel]:
    """A channel of it at 1 Hz."""
    values = np.full(log.n, np.nan)
    values[::100] = level[::100]
    return {**log.channels, name: Channel.of(values, unit)}


def shaken(seed: int, sensor: str = "", sd: float = 0.0) -> Log:
    """With the vibration in the log, and the noise of a sensor that grows with it by the exponential law."""
    log, rng = flight(seed), np.random.default_rng([seed, 10])
    level = vibration(log, seed)
    channels = with_level(log, level, "vibration", "m/s^2")
    for name in (n for n in log.channels if sensor and n.startswith(sensor)):
        more = sd * np.sqrt(np.exp(2.0 * SLOPE * level) - 1.0)
        y = log.channels[name].values + more * rng.standard_normal(log.n)
        channels[name] = Channel.of(y, log.channels[name].unit)
    return Log(log.t, channels, source="shaken")


def clipped(seed: int, size: float) -> Log:
    """An accelerometer that clips its peaks in bursts: the errors of the means have one sign, and differ."""
    log, rng = flight(seed), np.random.default_rng([seed, 11])
    bursts = np.repeat(rng.random(int(DURATION_S)) < 0.2, 100)[: log.n]
    hit = bursts & (rng.random(log.n) < 0.3)
    rate = np.convolve(hit, np.ones(100), "same")
    channels = with_level(log, rate, "clipping", "1/s")
    y = log.channels["accel_z"].values + hit * rng.exponential(size, log.n)
    channels["accel_z"] = Channel.of(y, "m/s^2")
    return Log(log.t, channels, source="clipped")


def driven(log: Log) -> tuple[Placed, ...]:
    scene = flight_scene(log, MODEL)
    assert scene is not None
    return scene.with_inertial_noise(fitted(scene, start_of(scene)).point).said


@pytest.mark.long
@pytest.mark.parametrize(
    ("sensor", "sd"), [("accel", ACCEL_SD), pytest.param("gyro", GYRO_SD, marks=pytest.mark.long)]
)
def test_noise_that_follows_the_vibration_is_named_with_its_slope(sensor: str, sd: float) -> None:
    (placed,) = driven(shaken(0, sensor, sd))
    assert (placed.effect.name, placed.where) == ("noise_level:vibration", sensor)
    assert placed.effect.slope == pytest.approx(SLOPE, rel=0.35)  # type: ignore[attr-defined]


@pytest.mark.parametrize("seed", in_part(range(3)))
def test_a_vibration_that_does_nothing_is_not_named(seed: int) -> None:
    """7 nats for one number: of the three pairs of a flight one in 5,000."""
    assert driven(shaken(seed)) == ()


def test_the_likelihood_of_other_sizes_is_that_of_the_path_with_them() -> None:
    scene = flight_scene(shaken(0), MODEL)
    assert scene is not None
    n, gauss_markov = scene.path.log.t.size, Placed(make("gauss_markov", sigma=0.1, tau=2.0), "accel_z")
    sizes = NoiseSizes(inputs={"accel": 2.0}, courses={"gyro": np.linspace(1.0, 2.0, n)})
    for path in (scene.path, scene.with_random_error(gauss_markov).path):
        wanted = replace(path, sizes=sizes).linear.log_likelihood
        assert path.log_likelihood_with(sizes) == pytest.approx(wanted, abs=1e-6)
        half = replace(path, sizes=NoiseSizes(inputs={"accel": 1.5, "gyro": 0.5}))
        assert half.log_likelihood_with(sizes) == pytest.approx(wanted, abs=1e-6)


@pytest.mark.long
def test_the_filter_knows_noise_that_follows_the_vibration() -> None:
    log = shaken(0, "accel", ACCEL_SD)
    found = kf.find_gap(log, MODEL)
    assert [(f.name, f.where) for f in found.findings] == [("noise_level:vibration", "accel")]
    improved: Any = found.improved
    again = kf.find_gap(log, filter_of(improved))
    assert again.findings == ()


@pytest.mark.long
def test_clipping_is_named_by_its_counter() -> None:
    """Its errors have a mean, which follows the shaking of the samples themselves as well, and a spread."""
    found = kf.find_gap(clipped(2, 2.0), MODEL)
    names = {f.name for f in found.findings}
    assert found.verdict == "effects_found"
    assert names & {"noise_level:clipping", "coupling:clipping"}
    assert names <= {"noise_level:clipping", "coupling:clipping", "vibration_rectification"}
    assert any(s.channel == "accel" and s.times > 3.0 for g in found.comparisons for s in g.noise_scales)


@pytest.mark.long
def test_an_accelerometer_that_clips_is_in_its_unit() -> None:
    """Its errors are as large as gravity; the median of its length is not."""
    assert kf.find_gap(clipped(2, 8.0), MODEL).verdict != "bad_data"


@pytest.mark.parametrize(("times", "is_followed"), [(49.0, True), (51.0, False)])
def test_a_channel_whose_noise_would_be_fifty_times_as_loud_is_not_followed(
    times: float, is_followed: bool
) -> None:
    sizes = [NoiseScale("mag_x", times, (0.9 * times, 1.1 * times), white=True)]
    assert (_not_followed([("mag_x", 1.0, 1.0)], sizes) == "") is is_followed
    assert _not_followed([("baro", 1.0, 1.0)], sizes) == ""  # noise of an input follows a shaken board


@pytest.mark.long
def test_louder_noise_of_an_accelerometer_is_said_by_its_size() -> None:
    """Four times as large in all: no misalignment and no random error, as was certain before."""
    log, rng = flight(5), np.random.default_rng(12)
    channels = dict(log.channels)
    for name in ("accel_x", "accel_y", "accel_z"):
        more = 15.0**0.5 * ACCEL_SD * rng.standard_normal(log.n)
        channels[name] = Channel.of(log.channels[name].values + more, "m/s^2")
    found = kf.find_gap(Log(log.t, channels, source="louder"), MODEL)
    assert found.findings == ()
    sizes = {s.channel: s for g in found.comparisons for s in g.noise_scales}
    lo, hi = sizes["accel"].ci95
    assert lo < 4.0 < hi
