"""Logs that meet a filter: names of its sensors, motion that nothing aids."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import kfgen as kf
from kfgen.core.errors import InputError
from kfgen.core.units import STANDARD_GRAVITY
from kfgen.identify.screening.motion import motion_in
from kfgen.log.log import Channel, Log
from kfgen.run.filter_log import as_named_by

GYROS = ("gyro_x", "gyro_y", "gyro_z")
RATE_HZ, SECONDS = 50.0, 60.0


def log_of(turn_deg: float, rate_deg_s: float = 0.0) -> Log:
    """A body that pitches from level to an angle and back, and turns about the vertical for a third of the time."""
    rng = np.random.default_rng(5)
    t = np.arange(int(SECONDS * RATE_HZ)) / RATE_HZ
    angle = np.radians(turn_deg) * np.sin(np.pi * t / SECONDS)
    f = STANDARD_GRAVITY * np.column_stack([np.sin(angle), np.zeros(t.size), -np.cos(angle)])
    w = np.zeros((t.size, 3))
    w[t > 2.0 * SECONDS / 3.0, 2] = np.radians(rate_deg_s)
    values = {
        "accel": ("m/s^2", f + 0.1 * rng.standard_normal(f.shape)),
        "gyro": ("rad/s", w + 0.01 * rng.standard_normal(w.shape)),
    }
    channels = {
        f"{s}_{a}": Channel.of(v[:, k], unit) for s, (unit, v) in values.items() for k, a in enumerate("xyz")
    }
    return Log(t, channels, source="log.csv")


def test_a_sensor_of_one_channel_reads_what_the_log_calls_it() -> None:
    model = kf.build("ins15", sensors=["barometer"])
    log = log_of(0.0)
    height = Channel.of(np.zeros(log.n), "m")
    named = as_named_by(model, replace(log, channels={**log.channels, "baro_height": height}))
    assert "baro" in named.channels
    assert "baro_height" not in named.channels
    pressure = Channel.of(np.full(log.n, 1e5), "Pa")
    other = replace(log, channels={**log.channels, "baro_pressure": pressure})
    assert as_named_by(model, other) is other


@pytest.mark.parametrize(
    ("turn_deg", "rate_deg_s", "said"),
    [(0.0, 0.0, ""), (1.0, 0.5, ""), (20.0, 0.0, "gravity turns by"), (0.0, 4.0, "gyro_z turns at")],
)
def test_motion_is_seen_where_no_drift_is_as_large(turn_deg: float, rate_deg_s: float, said: str) -> None:
    found = motion_in(log_of(turn_deg, rate_deg_s), GYROS)
    assert found.startswith(said)
    assert bool(found) == bool(said)


@pytest.mark.parametrize(("lasting_s", "moved"), [(0.3, False), (3.0, True)])
def test_a_hop_after_a_minute_of_rest_is_motion_and_a_knock_is_none(lasting_s: float, moved: bool) -> None:
    """Three seconds of sixty; a knock is over within one."""
    log = log_of(0.0)
    y = np.array(log.channels["gyro_z"].values)
    y[(log.t >= 50.0) & (log.t < 50.0 + lasting_s)] += np.radians(20.0)
    channels = {**log.channels, "gyro_z": Channel.of(y, "rad/s")}
    assert bool(motion_in(replace(log, channels=channels), GYROS)) == moved


def test_a_flight_of_a_few_seconds_is_no_rest(recording: Callable[[str], Path]) -> None:
    """A multicopter that stands for a minute and hops."""
    log = kf.read_log(recording("native/px4_auav_x21.ulg"))
    assert motion_in(log, GYROS).startswith("gravity turns by")


def test_rows_of_years_are_looked_at_at_once() -> None:
    """Seconds in which there is no row take neither time nor memory; those that have one are one by one."""
    rng, t = np.random.default_rng(1), 1e6 * np.arange(300.0)
    log = Log(t, {"gyro_x": Channel.of(0.2 * rng.standard_normal(t.size), "rad/s")}, "years.csv")
    begun = time.process_time()
    assert motion_in(log, GYROS).startswith("gyro_x turns at")
    assert time.process_time() - begun < 1.0


def test_a_channel_of_another_kind_shows_no_motion() -> None:
    assert not motion_in(log_of(20.0), ["temperature"])


def test_a_filter_over_a_moving_log_without_an_aiding_sensor_is_refused() -> None:
    """Where the filter has nothing to compare with, its motion would count as noise."""
    with pytest.raises(InputError, match="the sensors moved") as refused:
        kf.find_gap(log_of(20.0, 10.0), kf.build("ins15"))
    assert "no sensor that aids" in str(refused.value)
    assert "use what the log has" not in str(refused.value)


def test_the_refusal_names_the_sensors_that_the_filter_could_use() -> None:
    log = log_of(20.0, 10.0)
    height, field = (Channel.of(np.zeros(log.n), unit) for unit in ("m", "uT"))
    magnets = {f"mag_{a}": field for a in "xyz"}
    log = replace(log, channels={**log.channels, "baro_height": height, "fan": height, **magnets})
    for model, named in (("ins15", "have barometer, mag too"), ("ins23", "have barometer too")):
        with pytest.raises(InputError, match=named):
            kf.find_gap(log, kf.build(model))


def test_identify_says_that_the_sensors_moved() -> None:
    found = kf.identify(log_of(20.0), channels=["gyro_x"], effects=["white_noise"])
    assert any("the sensors moved" in w for w in found.warnings)
    still = kf.identify(log_of(0.0), channels=["gyro_x"], effects=["white_noise"])
    assert not any("moved" in w for w in still.warnings)
