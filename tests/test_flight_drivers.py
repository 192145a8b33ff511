"""Recorded drivers whose sensors have clocks of their own, as in logs of autopilots: in flights, in runs, and in words.

Flights come from `benchmarks/flight`, where current has 5 Hz and throttle 20 Hz beside inertial sensors of 100 Hz. Seeds
are fixed; a name by chance has a rate of about one in a hundred flights.
"""

from __future__ import annotations

import sys
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest

import kfgen as kf
from kfgen.core.errors import InputError
from kfgen.gap.core.drivers import recorded, silent
from kfgen.gap.flight.flight_scene import flight_scene
from kfgen.log.course import MAX_SILENT_SHARE, course
from kfgen.log.log import Channel, Log
from kfgen.model.filter import FilterModel
from kfgen.model.filter_file import FilterFile

sys.path.insert(0, str(Path(__file__).parents[1] / "benchmarks" / "flight"))
flight = pytest.importorskip("flight")
trial = pytest.importorskip("trial")

pytest.importorskip("numba")

T = np.arange(2001) / 100.0
"""Times of a log of 20 s."""


@lru_cache
def model() -> FilterModel:
    sensors = ["gnss_position", "gnss_velocity", "mag", "barometer"]
    return kf.build("ins15", options={"left_out": "false"}, sensors=sensors)


def sampled(every: int, values: np.ndarray, name: str = "current", unit: str = "A") -> Log:
    """A log whose channel has a sample in every so many rows, beside another that has all."""
    there = np.where(np.arange(T.size) % every == 0, values, np.nan)
    return Log(T, {name: Channel.of(there, unit), "gyro_x": Channel.of(0.0 * T, "rad/s")})


def test_a_course_is_straight_between_its_own_samples() -> None:
    """A ramp is itself; of a sine, a chord is off by (w h)^2 / 8 of its size at most."""
    assert course(sampled(20, 3.0 + 0.5 * T), "current") == pytest.approx(3.0 + 0.5 * T, abs=1e-12)
    w, h = 2.0 * np.pi / 5.0, 0.2
    error = np.abs(course(sampled(20, np.sin(w * T)), "current") - np.sin(w * T))
    assert 0.5 * (w * h) ** 2 / 8.0 < error.max() <= (w * h) ** 2 / 8.0


def test_a_driver_without_its_own_noise() -> None:
    """Smoothed over its own samples: a constant with white noise is nearer to it than any sample is on the mean."""
    noise = np.random.default_rng(3).standard_normal(T.size)
    found = recorded(sampled(5, 2.0 + 0.1 * noise))["current"]
    assert np.sqrt(np.mean((found - 2.0) ** 2)) < 0.05


@pytest.mark.parametrize(
    ("share", "is_said"), [(0.9 * MAX_SILENT_SHARE, False), (1.2 * MAX_SILENT_SHARE, True)]
)
@pytest.mark.parametrize("where", ["start", "midst", "end"])
def test_a_driver_that_is_silent_is_said(share: float, is_said: bool, where: str) -> None:
    first = {"start": 0.0, "midst": 0.4, "end": 1.0 - share}[where] * T[-1]
    values = np.where((first - 1e-9 < T) & (first + share * T[-1] + 1e-9 > T), np.nan, 1.0 + T)
    log = Log(T, {"throttle": Channel.of(values, ""), "gyro_x": Channel.of(0.0 * T, "rad/s")})
    assert (recorded(log) == {}) is is_said
    assert [w.startswith("channel throttle has no sample for") for w in silent(log)] == [True] * is_said
    if is_said:
        with pytest.raises(InputError, match=r"throttle has no sample for 2\.\d+ s"):
            course(log, "throttle")


def test_a_driver_without_a_number_is_said() -> None:
    log = Log(T, {"current": Channel.of(np.nan * T, "A"), "gyro_x": Channel.of(0.0 * T, "rad/s")})
    assert silent(log) == ["channel current holds no number: no effect of it is looked for"]
    with pytest.raises(InputError, match="current holds no number"):
        course(log, "current")


@lru_cache
def log_of(name: str = "", where: str = "", size: float = 0.0) -> Log:
    effects = [flight.Effect(name, where, {"coefficient": size})] if name else []
    found: Log = trial.log_of(trial.Case("quadrotor", 5, 60.0), effects)
    return found


@pytest.mark.long
def test_what_a_flight_records_competes_on_every_channel() -> None:
    """Current, temperature and throttle; a pressure not, which is what the barometer itself reads."""
    log = log_of()
    pressure = Channel.of(101325.0 - 12.0 * np.nan_to_num(log.channels["baro"].values), "Pa")
    scene = flight_scene(Log(log.t, {**log.channels, "pressure": pressure}), model())
    assert scene is not None
    offered = {(s.effect.name, s.where) for starts in scene.candidates(()) for s in starts}
    for name in ("supply_current", "temperature", "coupling:throttle"):
        assert {(name, c) for c in ("mag_x", "baro", "gyro_z", "accel_x")} <= offered
    assert not [o for o in offered if o[0] == "air_pressure"]


@pytest.mark.parametrize(
    ("name", "where", "size"),
    [
        pytest.param("supply_current", "mag_z", -8e-8, marks=pytest.mark.long),
        pytest.param("coupling:throttle", "baro", 4.0, marks=pytest.mark.long),
    ],
)
def test_what_follows_a_motor_is_named_and_the_filter_takes_it(name: str, where: str, size: float) -> None:
    """With its coefficient in its interval; over the updated filter the log has no gap.

    The mean squared innovation of a run is that of the same flight, with the same noise, without the effect.
    """
    log = log_of(name, where, size)
    found = kf.find_gap(log, model())
    assert [(f.name, f.where) for f in found.findings] == [(name, where)]
    low, high = found.findings[0].ci95["coefficient"]
    assert low < size < high
    assert isinstance(found.updated, FilterFile)
    better = kf.build(found.updated)
    assert kf.find_gap(log, better).verdict == "no_gap"
    sensor = {"mag_z": "mag", "baro": "barometer"}[where]
    pairs = ((model(), log), (better, log), (model(), log_of()))
    before, after, clean = (float(kf.run(m, over).sensors[sensor].nis.mean()) for m, over in pairs)
    assert before > 1.1 * clean
    assert after == pytest.approx(clean, rel=0.03)
    half = log.channels[driver := {"mag_z": "current", "baro": "throttle"}[where]]
    cut = Channel(np.where(log.t < 0.5 * log.t[-1], half.values, np.nan), half.unit)
    with pytest.raises(InputError, match=f"channel {driver} has no sample for"):
        kf.run(better, Log(log.t, {**log.channels, driver: cut}))
