"""Proves that drivers in a log compete: a thermal sweep names the temperature, and chance names nothing.

Records are made by numpy and scipy; a coefficient lies within twice its 95 % interval in all but 9e-5.
"""

from __future__ import annotations

import numpy as np
import pytest
from in_part import in_part
from numpy.typing import NDArray
from scipy.signal import lfilter

from kfgen.effects.driven.proportional import DRIVERS
from kfgen.identify.identify_log import Identification, identify, identify_samples
from kfgen.log.log import Channel, Log

Array = NDArray[np.float64]
RATE, SECONDS = 10.0, 3600.0
T = np.arange(int(RATE * SECONDS)) / RATE


def noise(seed: int, K: float = 1e-5) -> Array:
    rng = np.random.default_rng(seed)
    return 3e-3 * np.sqrt(RATE) * rng.standard_normal(T.size) + np.cumsum(
        K / np.sqrt(RATE) * rng.standard_normal(T.size)
    )


def chamber() -> Array:
    """A sweep from 20 to 60 degC and back, with self-heating [K]."""
    sweep = 40.0 * np.interp(T, [0, 600, 1800, 3000, 3600], [0, 0.05, 1, 0.5, 0.25])
    return np.asarray(293.15 + sweep + 3.0 * (1.0 - np.exp(-T / 200.0)))


def found(y: Array, **drivers: Array) -> Identification:
    return identify_samples({"gyro_x": y, **drivers}, rate=RATE, unit="rad/s")


def names(answer: Identification) -> list[str]:
    return [e.name for e in answer.channels["gyro_x"].effects]


@pytest.mark.parametrize(("square", "lag"), in_part([(3e-5, 60.0), (0.0, 0.01), (0.0, 60.0), (1e-4, 20.0)]))
def test_a_thermal_sweep_names_the_temperature(square: float, lag: float) -> None:
    """The sensor inside its housing lags behind the thermometer, and its curve is bent."""
    warm = chamber()
    a = np.exp(-1.0 / (RATE * lag))
    inside = lfilter([1.0 - a], [1.0, -a], warm - warm[0]) + warm[0]
    away = inside - 313.15
    thermometer = warm + 0.02 * np.random.default_rng(9).standard_normal(T.size)
    answer = found(2e-3 * away + square * away**2 + noise(1), temperature=thermometer)
    assert "temperature" in names(answer)
    assert "warm_up" not in names(answer)
    (effect,) = [e for e in answer.channels["gyro_x"].effects if e.name == "temperature"]
    slope = 2e-3 + 2.0 * square * (float(thermometer.mean()) - 313.15)
    assert effect.values["coefficient"] == pytest.approx(slope, rel=0.3)


def test_a_bent_curve_has_its_square() -> None:
    away = chamber() - 313.15
    answer = found(1e-4 * away**2 + noise(2), temperature=chamber())
    (effect,) = [e for e in answer.channels["gyro_x"].effects if e.name == "temperature_squared"]
    lo, hi = effect.ci95["coefficient"]
    assert abs(effect.values["coefficient"] - 1e-4) < hi - lo


@pytest.mark.parametrize("driver", in_part(n for n, d in DRIVERS.items() if not d.effect))
def test_a_driver_without_an_effect_of_its_own_couples(driver: str) -> None:
    course = DRIVERS[driver].course(T)
    answer = found(0.02 * course + noise(3), **{driver: course})
    (effect,) = [e for e in answer.channels["gyro_x"].effects if e.name == f"coupling:{driver}"]
    lo, hi = effect.ci95["coefficient"]
    assert abs(effect.values["coefficient"] - 0.02) < hi - lo
    assert answer.noise.channel("gyro_x").terms


def test_a_thermometer_is_known_by_its_unit() -> None:
    warm = chamber()
    channels = {
        "gyro_x": Channel.of(2e-3 * (warm - 313.15) + noise(5), "rad/s"),
        "imu_temp": Channel.of(warm - 273.15, "degC"),
    }
    answer = identify(Log(T, channels, "sweep.csv"), channels="gyro_x")
    assert "temperature" in names(answer)


def test_two_drivers_at_once() -> None:
    warm, current = chamber(), 1.0 + 0.5 * np.sin(2 * np.pi * T / 700.0)
    answer = found(2e-3 * (warm - 313.15) + 0.01 * current + noise(4), temperature=warm, current=current)
    assert {"temperature", "supply_current"} <= set(names(answer))


@pytest.mark.long
def test_a_driver_that_drives_nothing_is_not_named() -> None:
    """Twenty records with two idle drivers: each is named by chance in less than one of ten thousand."""
    warm, current = chamber(), 1.0 + 0.5 * np.sin(2 * np.pi * T / 700.0)
    for seed in range(10):
        got = names(found(noise(10 + seed, K=3e-4), temperature=warm, current=current))
        assert not {"temperature", "temperature_squared", "temperature_rate", "supply_current"} & set(got)


def test_a_thermometer_that_is_noisy_still_wins_over_a_warm_up_curve() -> None:
    """Both fit as well, and the curve has one number more; with the thermometer's noise in it the temperature lost."""
    warm = 293.15 + 15.0 * (1.0 - np.exp(-T / 600.0))
    thermometer = warm + 0.5 * np.random.default_rng(12).standard_normal(T.size)
    assert names(found(1e-3 * (warm - warm[0]) + noise(13, K=1e-9), temperature=thermometer)) == [
        "white_noise",
        "temperature",
    ]


@pytest.mark.long
def test_a_small_bend_is_looked_for_beside_the_slope() -> None:
    """Beside nothing a walk takes the whole sweep, and hides the bend; its interval is held to twice its width (9e-5)."""
    away = 20.0 * np.sin(2 * np.pi * T / 3600.0 - 1.5)
    answer = found(2e-2 * away + 2e-4 * away**2 + noise(14, K=1e-9), temperature=293.15 + away)
    bent = [e for e in answer.channels["gyro_x"].effects if e.name == "temperature_squared"]
    assert "rate_random_walk" not in names(answer)
    (lo, hi) = bent[0].ci95["coefficient"]
    assert abs(bent[0].values["coefficient"] - 2e-4) < hi - lo
