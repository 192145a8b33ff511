"""Biases that follow another channel: of a declared driver they are named, of any other they are pointed at."""

from __future__ import annotations

import numpy as np
import pytest
from in_part import in_part
from numpy.typing import NDArray

from kfgen.core.errors import InputError
from kfgen.effects import make
from kfgen.effects.driven.proportional import DRIVERS
from kfgen.effects.noise_model import ChannelNoise, NoiseModel, Term, noise_text, parse_noise
from kfgen.gap.core.drivers import drivers_of
from kfgen.gap.rest.channel_gap import channel_gap
from kfgen.gap.rest.comparison import ChannelGap
from kfgen.gap.rest.even_record import regular
from kfgen.log.log import Channel, Log

Array = NDArray[np.float64]

N, DT, SD = 8000, 0.1, 0.5
T = np.arange(N) * DT
COURSE = np.sin(2.0 * np.pi * T / 300.0) + 0.5 * np.sin(2.0 * np.pi * T / 190.0 + 1.0)
"""Of a driver; neither a ramp nor an exponential."""
CHANNELS = {
    "voltage": ("supply_voltage", "V"),
    "current": ("supply_current", "A"),
    "pressure": ("air_pressure", "Pa"),
    "humidity": ("humidity", ""),
}


def gap_beside(channel: str | list[str], unit: str, coefficient: float, seed: int) -> ChannelGap:
    """White noise and a share of a driver, whose own noise is a twentieth of its swing."""
    rng = np.random.default_rng(seed)
    y = SD * rng.standard_normal(N) + coefficient * COURSE
    driver = 3.0 + COURSE + 0.05 * rng.standard_normal(N)
    columns = [channel] if isinstance(channel, str) else channel
    log = Log(T, {"gyro_x": Channel.of(y, "rad/s"), **{c: Channel.of(driver, unit) for c in columns}})
    record, stamps, _ = regular(log, "gyro_x", drive=drivers_of(log)[0])
    assumed = ChannelNoise("rad/s", (Term(make("white_noise", N=SD * np.sqrt(DT))),))
    return channel_gap("gyro_x", record, assumed, stamps)


@pytest.mark.long
@pytest.mark.parametrize("channel", in_part(CHANNELS))
def test_a_bias_that_follows_a_driver_is_named(channel: str) -> None:
    """The gain is 0.5 sum (c x / sd)^2 = 100 nats; the interval is held to 2.5 of its half-widths."""
    effect, unit = CHANNELS[channel]
    c = float(np.sqrt(200.0 / np.sum((COURSE - COURSE.mean()) ** 2))) * SD
    gap = gap_beside(channel, unit, c, seed=11)
    assert [f.effect.name for f in gap.findings] == [effect]
    assert gap.verdict == "effects_found"
    lo, hi = gap.findings[0].ci95["coefficient"]
    assert abs(c - 0.5 * (lo + hi)) < 2.5 * 0.5 * (hi - lo)
    assert 0.5 * (hi - lo) == pytest.approx(1.96 * c / np.sqrt(200.0), rel=0.1)


@pytest.mark.long
def test_a_channel_of_no_known_effect_is_pointed_at() -> None:
    """Regression on it is among the tests that fail before anything is added: z = sqrt(2 * 100) = 14."""
    c = float(np.sqrt(200.0 / np.sum((COURSE - COURSE.mean()) ** 2))) * SD
    gap = gap_beside("fuel_level", "m", c, seed=12)
    test = next(t for t in gap.before if t.name == "regression on fuel_level")
    assert test.significant
    assert np.sqrt(test.ratio - 1.0) == pytest.approx(np.sqrt(200.0), abs=4.0)


def test_a_channel_that_has_nothing_to_do_with_it_is_not() -> None:
    """Family-wise rate 0.1 %."""
    gap = gap_beside("fuel_level", "m", 0.0, seed=13)
    assert gap.verdict == "no_gap"
    assert next(t for t in gap.before if t.name == "regression on fuel_level").p > 0.01


def test_a_course_starts_at_its_level_and_settles() -> None:
    """Of every driver, in its unit: within its rise and swing."""
    for driver in DRIVERS.values():
        x = driver.course(T)
        assert x[0] == pytest.approx(driver.level)
        assert np.ptp(x) > 0.0
        assert np.abs(x - driver.level).max() <= abs(driver.rise) + abs(driver.swing)


def test_a_bias_that_follows_any_channel_is_coupled_to_it() -> None:
    """As of a declared driver; the file that names it is read again."""
    c = float(np.sqrt(200.0 / np.sum((COURSE - COURSE.mean()) ** 2))) * SD
    gap = gap_beside("fuel_level", "m", c, seed=14)
    assert [f.effect.name for f in gap.findings] == ["coupling:fuel_level"]
    lo, hi = gap.findings[0].ci95["coefficient"]
    assert abs(c - 0.5 * (lo + hi)) < 2.5 * 0.5 * (hi - lo)
    again = parse_noise(noise_text(NoiseModel({"gyro_x": gap.updated}, {})), "updated.toml")
    effect = again.channels["gyro_x"].effects[-1]
    assert (effect.name, effect.driver) == ("coupling:fuel_level", "fuel_level")
    assert effect.values[0] == pytest.approx(gap.findings[0].effect.values[0], rel=1e-6)


@pytest.mark.long
def test_another_sensor_is_no_driver() -> None:
    """Two gyros drift alike where the thermometer is missing: neither is the cause."""
    c = float(np.sqrt(200.0 / np.sum((COURSE - COURSE.mean()) ** 2))) * SD
    gap = gap_beside("gyro_y", "rad/s", c, seed=15)
    assert not any(f.effect.name.startswith("coupling") for f in gap.findings)
    assert next(t for t in gap.before if t.other == "gyro_y").significant


COULD_BE_CODE = ["a b", "x */ int evil; /*", 'x"""', "x;y", "1x"]


@pytest.mark.parametrize("name", COULD_BE_CODE)
def test_a_name_that_could_be_code_is_refused(name: str) -> None:
    """It would stand in emitted code."""
    text = f"""format = "kfgen-noise-1"
[gyro_x]
unit = "deg/s"
effects = [ {{ effect = '{"coupling:" + name}', coefficient = "0.1 deg/s" }} ]
"""
    with pytest.raises(InputError, match="letters"):
        parse_noise(text, "hostile.toml")


@pytest.mark.long
def test_a_column_whose_name_could_be_code_drives_nothing() -> None:
    """All of them at once beside a channel that follows them; of a name that is one see the test above."""
    c = float(np.sqrt(200.0 / np.sum((COURSE - COURSE.mean()) ** 2))) * SD
    assert not any("coupling" in f.effect.name for f in gap_beside(COULD_BE_CODE, "m", c, seed=16).findings)
