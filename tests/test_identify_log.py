"""`kfgen.identify.identify_log`: which channels are identified, what drives them, and what the result says.

Sizes: white noise of N in n samples is known to 1 / sqrt(2 n); each comparison with the truth allows five of these
standard deviations or the interval's own.
"""

from __future__ import annotations

import json
import pickle
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from in_part import in_part
from numpy.typing import NDArray
from typer.testing import Result

from kfgen.core.errors import InputError
from kfgen.effects.driven.proportional import DRIVERS
from kfgen.effects.noise_model import noise_text
from kfgen.fleet.fleet import fleet
from kfgen.identify.identify_log import identify, identify_samples
from kfgen.log.log import Channel, Log

Array = NDArray[np.float64]
Cli = Callable[..., Result]
RATE = 20.0
EFFECT_OF_DRIVER = {name: driver.effect for name, driver in DRIVERS.items() if driver.effect}


def white(seed: int, n: int = 4000, size: float = 0.01) -> Array:
    return np.asarray(size * np.random.default_rng(seed).standard_normal(n))


def log_of(**channels: tuple[Array, str]) -> Log:
    n = next(iter(channels.values()))[0].size
    return Log(np.arange(n) / RATE, {k: Channel.of(v, u) for k, (v, u) in channels.items()}, "bench.csv")


@pytest.fixture(scope="module")
def gyro() -> Log:
    return log_of(gyro_x=(white(1), "deg/s"), gyro_y=(white(2, size=0.02), "deg/s"))


# The channels.


def test_a_channel_that_cannot_be_identified_costs_the_others_nothing(gyro: Log) -> None:
    stuck = replace(gyro, channels={**gyro.channels, "accel_x": Channel.of(np.ones(gyro.n), "m/s^2")})
    answer = identify(stuck)
    assert list(answer.channels) == ["gyro_x", "gyro_y"]
    assert any(
        "not identified: bench.csv: channel accel_x: the channel never changes" in w for w in answer.warnings
    )
    for asked in (["accel_x"], ["gyro_x", "accel_x"]):
        with pytest.raises(InputError, match="accel_x"):
            identify(stuck, channels=asked)


def test_a_slow_sensor_beside_a_fast_one_lacks_no_samples() -> None:
    """Every twentieth row of the log, or a row beside it: 95 % of its cells are empty."""
    rng, n = np.random.default_rng(6), 20_000
    rows = np.arange(5, n - 5, 20) + rng.integers(-1, 2, 1000)[: len(range(5, n - 5, 20))]
    y = np.full(n, np.nan)
    y[rows] = 0.3 * rng.standard_normal(rows.size)
    log = Log(np.arange(n) / 200.0, {"baro_height": Channel.of(y, "m")}, "flight.ulg")
    answer = identify(log, effects=["white_noise"])
    lo, hi = answer.channels["baro_height"].effects[0].ci95["N"]
    assert lo < 0.3 / np.sqrt(10.0) < hi
    assert not any("not a number" in w for w in answer.warnings)


def test_drivers_beside_gaps() -> None:
    """Pieces of different lengths, the longer one last."""
    rng, n = np.random.default_rng(8), 8000
    t = np.arange(n) / RATE + np.where(np.arange(n) < 2000, 0.0, 50.0)
    warm = 300.0 + 5.0 * np.sin(2.0 * np.pi * t / 150.0)
    y = 0.01 * rng.standard_normal(n) + 3e-3 * (warm - 300.0)
    log = Log(t, {"gyro_x": Channel.of(y, "rad/s"), "temperature": Channel.of(warm, "K")}, "bench.csv")
    effects = {e.name: e for e in identify(log).channels["gyro_x"].effects}
    lo, hi = effects["temperature"].ci95["coefficient"]
    assert lo < 3e-3 < hi


# The result.


def test_result_makes_its_noise_model(gyro: Log, tmp_path: Path) -> None:
    found = identify(gyro)
    assert list(found.channels) == ["gyro_x", "gyro_y"]
    (term,) = found.noise.channel("gyro_x").terms
    (effect,) = found.channels["gyro_x"].effects
    assert term.effect == effect.effect
    assert term.ci95 == effect.ci95
    assert found.noise.channel("gyro_x").covariance is not None
    assert found.noise.provenance["method"] == "ml"
    found.save(tmp_path / "noise.toml")
    assert (tmp_path / "noise.toml").read_text() == noise_text(found.noise)
    lo, hi = effect.ci95["N"]
    assert lo < np.radians(0.01 / np.sqrt(RATE)) < hi
    assert effect.crlb_rel["N"] == pytest.approx(1 / np.sqrt(2 * 4000), rel=0.01)


def test_repr_is_short_and_says_what_was_found(gyro: Log) -> None:
    said = repr(identify(gyro))
    assert len(said) < 200
    assert "gyro_x: N = 0.002" in said
    assert "deg/s/sqrt(Hz)" in said


def test_command_writes_what_the_result_says(kfgen: Cli, tmp_path: Path, gyro: Log) -> None:
    rows = np.column_stack([gyro.t, np.degrees(gyro.values("gyro_x"))])
    path = tmp_path / "a.csv"
    np.savetxt(path, rows, delimiter=",", header="t [s],gyro_x [deg/s]", comments="", fmt="%.12g")
    done = kfgen("identify", path, "--json", tmp_path / "a.json", "-o", tmp_path / "a.toml")
    assert done.exit_code == 0, done.output
    found = identify(path)
    assert json.loads((tmp_path / "a.json").read_text()) == json.loads(json.dumps(found.to_dict()))
    assert (tmp_path / "a.toml").read_text() == noise_text(found.noise)


def test_samples_are_a_log(gyro: Log) -> None:
    y = np.degrees(gyro.values("gyro_x"))
    found = identify_samples(y, rate=RATE, unit="deg/s")
    expected = identify(gyro, channels=["gyro_x"]).channels["gyro_x"].effects[0]
    assert found.channels["y"].effects[0].values["N"] == pytest.approx(expected.values["N"], rel=1e-9)
    named = identify_samples(
        {"gyro_x": y, "temperature": np.linspace(290, 300, y.size)}, rate=RATE, unit="deg/s"
    )
    assert list(named.channels) == ["gyro_x"]


@pytest.mark.parametrize(
    ("y", "rate", "match"),
    [
        (np.zeros((4, 4)), 1.0, "no row"),
        (np.zeros(100), 0.0, "must be positive"),
        (np.zeros(100), 1.0, "never changes"),
    ],
)
def test_samples_that_cannot_be_identified(y: Array, rate: float, match: str) -> None:
    with pytest.raises(InputError, match=match):
        identify_samples(y, rate=rate, unit="deg/s")


@pytest.mark.long
def test_logs_in_memory_are_fitted_together_and_pooled() -> None:
    logs = [log_of(gyro_x=(white(k), "deg/s")) for k in range(3)]
    both = identify(logs[:2])
    assert both.channels["gyro_x"].to_dict()["duration_s"] == pytest.approx(2 * 4000 / RATE)
    found = fleet(logs, jobs=1)
    assert found.effects[0].kind == "common"
    assert pickle.loads(pickle.dumps(found.done)) == found.done
    assert found.noise.channel("gyro_x").effects[0].name == "white_noise"
    assert "3 logs" in repr(found)


def test_what_is_unknown_is_refused_with_what_is_known(gyro: Log) -> None:
    with pytest.raises(InputError, match="no effect 'mains_hum'") as refused:
        identify(gyro, effects="white_noise,mains_hum")
    assert "gauss_markov" in refused.value.remedy
    with pytest.raises(InputError, match="no method"):
        identify(gyro, method="magic")
    with pytest.raises(InputError, match="missing"):
        identify(gyro, channels="gyro_w")


# Drivers and channels.


@pytest.mark.parametrize("driver", in_part(EFFECT_OF_DRIVER))
def test_every_recorded_driver_is_seen(driver: str) -> None:
    """A coefficient of ten standard deviations or more, found by name and, where it is large, by itself."""
    n = 4000
    course = DRIVERS[driver].course(np.arange(n) / RATE)
    swing = float(np.ptp(course))
    y = white(3, n) + 0.03 / swing * (course - course.mean())
    log = log_of(gyro_x=(y, "rad/s"), **{driver: (course, DRIVERS[driver].unit)})
    name = EFFECT_OF_DRIVER[driver]
    found = identify(log, effects=["white_noise", name]).channels["gyro_x"].effects[1]
    lo, hi = found.ci95["coefficient"]
    assert lo < 0.03 / swing < hi
    assert name in [e.name for e in identify(log).channels["gyro_x"].effects]


def test_sensor_channels_by_name() -> None:
    n = 4000
    log = log_of(
        gyro_x=(white(1), "deg/s"),
        baro_height=(white(2), "m"),
        baro=(white(3), "Pa"),
        ref_gyro_x=(white(4), "deg/s"),
        temperature=(white(5) + 300.0, "K"),
        throttle=(white(6), "1"),
        Time=(np.arange(n, dtype=float), "1"),
        stamp=(np.arange(n) // 2 * 1.0, "1"),
        clock=(white(7), "ms"),
    )
    found = identify(log)
    assert list(found.channels) == ["gyro_x", "baro_height"]
    left = [w for w in found.warnings if "not identified" in w]
    assert left == [
        "Time, stamp, clock: a time or a counter, not identified",
        "baro: not identified beside the sensor channels; ask for it with --channels baro",
    ]
    assert list(identify(log, channels="baro").channels) == ["baro"]


def test_other_names_are_identified_where_no_sensor_is_named() -> None:
    log = log_of(distance=(white(1), "m"), voltage=(white(2) + 5.0, "V"), index=(np.arange(4000.0), "1"))
    assert list(identify(log).channels) == ["distance"]
    with pytest.raises(InputError, match="nothing to identify"):
        identify(log_of(voltage=(white(2) + 5.0, "V"), index=(np.arange(4000.0), "1")))


def test_a_driver_that_is_asked_for_does_not_drive_itself() -> None:
    log = log_of(voltage=(white(2) + 5.0, "V"), temperature=(np.linspace(290.0, 300.0, 4000), "K"))
    found = identify(log, channels="voltage").channels["voltage"]
    assert [e.name for e in found.effects] == ["white_noise"]
