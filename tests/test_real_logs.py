"""Proves that what real logs bring ends in an answer: filters that stop the upper band, rates that burst, raw counts.

Each of these once ended in a traceback on a recording of a real sensor. Seeds are fixed; nothing here is left to chance.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from kfgen.effects import effect_named, make
from kfgen.effects.noise_model import ChannelNoise, NoiseModel, Term
from kfgen.effects.process.population_monte_carlo import integral
from kfgen.effects.series import WhiteSeries
from kfgen.gap.find_gap import find_gap
from kfgen.gap.motion.known_length import MAX_RESIDUAL, NormScene, norm_scene
from kfgen.gap.scene.scene import Placed, ScenePoint
from kfgen.identify.evidence.sampling import evidence
from kfgen.identify.identify_log import identify as identify_log
from kfgen.log.log import Channel, Log
from kfgen.log.readers import read_log

Array = NDArray[np.float64]
TERMS = ["white_noise", "rate_random_walk"]


@pytest.mark.parametrize("passed", [0.1, 0.4, 0.7, 1.0])
def test_white_noise_behind_a_low_pass_has_its_size(passed: float) -> None:
    """The weights of what a filter stops are zero: they say nothing of the noise that it leaves."""
    n, sd = 1000, 0.3
    weight = np.where(np.arange(n) < passed * n, 1.0 / sd, 0.0)
    empty = np.zeros((n, 0))
    series = WhiteSeries(np.arange(n) * 0.1, np.zeros(n), 0.1, weight, np.zeros(n), empty, (0.0, 0.7), {})
    assert series.sd == pytest.approx(sd)


def test_no_line_is_seen_beyond_the_band_of_the_noise() -> None:
    """A low-pass that stops all above: where nothing is known of the noise no line has a size."""
    n = 1000
    weight = np.where(np.arange(n) < 0.5 * n, 1.0, 0.0)
    t = np.arange(n) * 0.1
    beyond = np.sin(2.0 * np.pi * 4.0 * t)
    empty = np.zeros((n, 0))
    series = WhiteSeries(t, np.zeros(n), 0.1, weight, np.zeros(n), empty, (0.0, 0.7), {})
    series.__dict__["z"] = beyond  # what a faulty record can make of it
    assert effect_named("sinusoid").detect(series) == []


def test_an_integral_over_coordinates_of_very_different_sizes() -> None:
    """A Gaussian whose sizes differ by 1e9, of known integral, to the accuracy of the draws (1 % for right programs)."""
    size = np.array([1e6, 1e-3])

    def log_f(x: Array) -> Array:
        return np.asarray(-0.5 * np.sum((x / size) ** 2, axis=1))

    first = size * np.random.default_rng(3).standard_normal((200, 2))
    found = integral(log_f, first, -50.0, 4)
    assert found is not None
    assert found.log == pytest.approx(np.log(2.0 * np.pi) + np.log(size).sum(), abs=0.1)


def bursts() -> Log:
    """Ten minutes of a sensor that is moved, whose samples come in bursts."""
    rng = np.random.default_rng(17)
    t = np.sort(np.concatenate([k * 1.0 + 0.011 * np.arange(18) for k in range(60)]))
    t = t + rng.uniform(0.0, 2e-3, t.size)
    return Log(t, {"gyro_x": Channel.of(20.0 * np.cumsum(rng.standard_normal(t.size)) * 0.05, "deg/s")})


def test_noise_that_rounding_swallows_is_impossible_and_no_error() -> None:
    """A white noise of 1e-12 of the bias beside it has a likelihood, or minus infinity, and never ends in LinAlgError."""
    log = bursts()
    data = evidence(np.asarray(log.t), log.values("gyro_x"))[0].likelihood(())
    values = [
        data.log_likelihood([make("white_noise", N=1e-9), make("gauss_markov", sigma=sigma, tau=tau)]).value
        for sigma in (1.0, 1e6, 1e12)
        for tau in (0.1, 1e5)
    ]
    assert all(np.isfinite(v) or v == -np.inf for v in values)
    assert np.isfinite(values[0])


def raw_counts(scale: float = 16384.0) -> tuple[Log, NoiseModel]:
    """An accelerometer in ten poses, in counts of an ADC that nobody told it of; its bias and scales are wrong."""
    rng = np.random.default_rng(5)
    towards = rng.standard_normal((10, 3))
    towards /= np.linalg.norm(towards, axis=1)[:, None]
    each = np.repeat(scale * towards * [1.01, 0.99, 1.02] + 0.01 * scale, 300, axis=0)
    moves = np.arange(3000) % 300 < 60
    y = each + 40.0 * rng.standard_normal(each.shape) * np.where(moves, 40.0, 1.0)[:, None]
    channels = {f"accel_{a}": Channel.of(y[:, k].round(), "1") for k, a in enumerate("xyz")}
    noise = ChannelNoise("1", (Term(make("white_noise", N=4.0)),))
    return Log(np.arange(3000) * 0.01, channels), NoiseModel(dict.fromkeys(channels, noise))


def test_raw_counts_in_poses_have_no_known_length() -> None:
    """Gravity is a number of metres a second squared, and none of counts."""
    log, noise = raw_counts()
    scene = norm_scene(log, noise)
    assert scene is not None
    assert scene.length == 0.0
    assert find_gap(log, noise).verdict in ("effects_found", "unknown_effect")


def test_a_triad_that_is_blind_in_a_direction_is_far_off() -> None:
    y = np.random.default_rng(1).standard_normal((20, 3))
    scene = NormScene("accel", "m/s^2", np.arange(20.0), y, np.ones((20, 3)), 9.8)
    blind = Placed(make("scale_factor", coefficient=-1.0), "accel_x")
    assert (scene.residuals([ScenePoint((blind,), np.zeros(0))]) == MAX_RESIDUAL).all()


@pytest.mark.long
def test_a_sensor_that_moved_through_gaps_is_identified(recording: Callable[[str], Path]) -> None:
    """Ten gaps within 135 s, and motion in place of rest: bad evidence for noise, and no reason to end in an error."""
    log = read_log(recording("dynamic/xio_fusion_sensor_data.npz"))
    part = log.cut(1500, 3000)
    assert np.diff(part.t).max() > 1.5 * part.dt
    found = identify_log(part, channels=["gyro_z", "accel_y"], effects=TERMS)
    for channel in found.channels.values():
        assert all(np.isfinite(v) and v >= 0.0 for e in channel.effects for v in e.values.values())
    assert any("missing" in w for w in found.warnings)


@pytest.mark.long
def test_all_channels_of_that_log(recording: Callable[[str], Path]) -> None:
    found = identify_log(read_log(recording("dynamic/xio_fusion_sensor_data.npz")))
    assert len(found.channels) == 9
