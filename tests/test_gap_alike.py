"""Proves that effects that look alike in motion are distinguished where they can be, and said to be alike where not.

Data are made here in plain numpy; expected values are those that were put in, or follow from theory as stated.
"""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pytest
from in_part import in_part
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from kfgen.core.units import STANDARD_GRAVITY as G
from kfgen.effects import make
from kfgen.effects.inertial.felt import Signals
from kfgen.effects.noise_model import ChannelNoise, NoiseModel, Term
from kfgen.gap.core.result import Finding
from kfgen.gap.motion.motion_scene import motion_scene
from kfgen.gap.motion.wiener import noiseless
from kfgen.gap.scene.scene_gap import SceneGap, scene_gap
from kfgen.gap.words import finding_sentence
from kfgen.log.log import Channel, Log

Array = NDArray[np.float64]

DT, N = 0.01, 8000
T = np.arange(N) * DT
AXES = "xyz"


def assumed(sensor: str, unit: str, sd: float) -> NoiseModel:
    term = Term(make("white_noise", N=sd * DT**0.5))
    return NoiseModel({f"{sensor}_{a}": ChannelNoise(unit, (term,)) for a in AXES})


def compared(channels: dict[str, tuple[Array, str]], noise: NoiseModel) -> SceneGap:
    scene = motion_scene(Log(T, {k: Channel.of(v, u) for k, (v, u) in channels.items()}), noise)
    assert scene is not None
    return scene_gap(scene)


def found_in(channels: dict[str, tuple[Array, str]], noise: NoiseModel) -> tuple[Finding, ...]:
    return compared(channels, noise).findings


def triad(name: str, x: Array, unit: str) -> dict[str, tuple[Array, str]]:
    return {f"{name}_{a}": (x[:, i], unit) for i, a in enumerate(AXES)}


def test_what_is_left_of_a_driver_is_not_attenuated() -> None:
    """Least squares on a driver with noise finds var / (var + noise) of a slope [Fuller 1987, eq. (1.1.7)]: 0.5 here.

    Nine ordinates in 8000 about each of two lines keep their noise: a slope within 1 %.
    """
    true = np.sin(2 * np.pi * 0.31 * T) + np.sin(2 * np.pi * 1.7 * T + 1.0)
    driver = true + np.random.default_rng(3).standard_normal(N)
    left = noiseless(driver[:, None])[:, 0]
    assert abs(true @ driver / (driver @ driver) - 0.5) < 0.02
    assert abs(true @ left / (left @ left) - 1.0) < 0.01


def test_of_noise_alone_the_mean_is_left() -> None:
    """An average of nine squares is above four in 4e-5 of all cases: in 8000, less than 1 % of the power is kept."""
    x = np.random.default_rng(4).standard_normal((N, 3)) + 5.0
    assert noiseless(x).var() < 0.01
    assert np.allclose(noiseless(x).mean(axis=0), x.mean(axis=0))


@pytest.mark.parametrize("seed", in_part(range(4)))
def test_g_sensitivity_beside_a_shaken_accelerometer(seed: int) -> None:
    """A table that swings by a sine: gravity in the body and the rate's derivative have nearly one shape.

    The accelerometer's noise of a third of gravity's swing must not decide for the delay. The interval is taken at
    4.5 of its standard deviations (7e-6 a check), not at 95 %.
    """
    rng = np.random.default_rng(seed)
    sd, g = np.radians(0.1), 2e-4
    w = 2 * np.pi * 0.5
    rate = np.zeros((N, 3))
    rate[:, 0] = np.sin(w * T)
    lean = Rotation.from_euler("xy", [0.3, 0.4])
    body = lean * Rotation.from_rotvec(np.outer((1.0 - np.cos(w * T)) / w, [1.0, 0.0, 0.0]))
    force = body.inv().apply([0.0, 0.0, -G])
    read = rate + sd * rng.standard_normal((N, 3)) + 0.01
    read[:, 0] += g * force[:, 1]
    channels = triad("gyro", read, "rad/s") | triad("ref_gyro", rate, "rad/s")
    channels |= triad("accel", force + 1.0 * rng.standard_normal((N, 3)), "m/s^2")
    first = found_in(channels, assumed("gyro", "rad/s", sd))[0]
    assert "g_sensitivity" in (first.effect.name, *first.indistinguishable)
    if first.effect.name == "g_sensitivity" and first.effect.xz == 0.0:
        lo, hi = first.ci95["xy"]
        assert abs(0.5 * (lo + hi) - g) < 4.5 / 1.96 * 0.5 * (hi - lo)


@pytest.mark.long
@pytest.mark.parametrize("seed", [0, 1, *(pytest.param(k, marks=pytest.mark.long) for k in range(2, 6))])
def test_a_hard_iron_along_one_axis_is_no_warm_up(seed: int) -> None:
    """A constant on one axis is a settling that takes longer than the log, which is none."""
    rng = np.random.default_rng(seed)
    sd = 0.4e-6
    body = Rotation.from_euler("xyz", 0.8 * np.sin(2 * np.pi * np.array([0.11, 0.17, 0.07]) * T[:, None]))
    m = body.inv().apply([21e-6, 1e-6, 43e-6]) + sd * rng.standard_normal((N, 3))
    m[:, 1] += 5.5e-8
    q = body.as_quat(scalar_first=True)
    channels = triad("mag", m, "T") | {f"ref_q_{c}": (q[:, i], "") for i, c in enumerate("wxyz")}
    names = [f.effect.name for f in found_in(channels, assumed("mag", "T", sd))]
    assert "warm_up" not in names


@pytest.mark.long
def test_lags_that_are_one_are_said_to_be() -> None:
    """A delay of 2e-4 s turns motion of 1 / (2 pi 2e-4 s) = 796 Hz by a radian; a third of that is 265 Hz."""
    rng = np.random.default_rng(0)
    sd, delay = np.radians(0.1), 2e-4
    f, p = rng.uniform(0.1, 2.0, (3, 4)), rng.uniform(0, 6, (3, 4))
    rate, late = (0.4 * np.sin(2 * np.pi * f * (T - d)[:, None, None] + p).sum(axis=2) for d in (0.0, delay))
    channels = triad("gyro", late + sd * rng.standard_normal((N, 3)), "rad/s")
    gap = compared(channels | triad("ref_gyro", rate, "rad/s"), assumed("gyro", "rad/s", sd))
    first = gap.findings[0]
    assert {first.effect.name, *first.indistinguishable} == {"time_delay", "bandwidth"}
    words = finding_sentence(gap, first)
    assert "(cos2 1.00," in words
    said = re.search(r"motion at (\S+) Hz", words)
    assert said is not None
    assert float(said.group(1)) == pytest.approx(265.0, rel=0.2)


@pytest.mark.long
def test_a_reading_that_is_early_is_rarer_and_found_where_it_is() -> None:
    """One delay in ten is of the reference: log 9 = 2.2 nats; a millisecond early is worth some 1,000 here."""
    early, late = (make("time_delay", delay=d).rarer_by_nats() for d in (-1e-3, 1e-3))
    assert early - late == pytest.approx(np.log(9.0), abs=0.01)
    rng = np.random.default_rng(1)
    sd = np.radians(0.1)
    f, p = rng.uniform(0.1, 2.0, (3, 4)), rng.uniform(0, 6, (3, 4))
    rate, read = (0.4 * np.sin(2 * np.pi * f * (T + d)[:, None, None] + p).sum(axis=2) for d in (0.0, 1e-3))
    channels = triad("gyro", read + sd * rng.standard_normal((N, 3)), "rad/s")
    first = found_in(channels | triad("ref_gyro", rate, "rad/s"), assumed("gyro", "rad/s", sd))[0]
    assert first.effect.name == "time_delay"
    lo, hi = first.ci95["delay"]
    assert abs(0.5 * (lo + hi) + 1e-3) < 4.5 / 1.96 * 0.5 * (hi - lo)


@pytest.mark.parametrize("corner", [0.5, 20.0, 100.0])
def test_a_pole_is_exact_to_the_last_sample(corner: float) -> None:
    """Of a sine: 1 / (1 + i f / corner). A spline of 2 Hz at 100 Hz errs by some (2 pi f dt)^4 / 384 = 6e-7.

    After ten time constants exp(-10) = 4.5e-5 of what was guessed before the first sample is left.
    """
    f = 2.0
    gain = 1.0 / (1.0 + 1j * f / corner)
    x = np.sin(2 * np.pi * f * T + 1.0)
    settled = np.imag(gain * np.exp(1j * (2 * np.pi * f * T + 1.0)))
    lag = make("bandwidth", corner=corner)
    start = int(10.0 / (2 * np.pi * corner) / DT) + 10
    read = lag.passed(x, DT)  # type: ignore[attr-defined]
    assert np.abs(read - settled)[start:].max() < 1e-4
    assert np.abs(read - settled)[-50:].max() < 1e-5


@pytest.mark.parametrize(
    "lag",
    [make("time_delay", delay=0.03), make("bandwidth", corner=5.0), make("clock_drift", rate=1e-3)],
)
def test_signals_keep_their_splines(lag: Any) -> None:
    """Late signals are the same with splines that are kept, of each array its own."""
    x = np.sin(2 * np.pi * 2.0 * T[:, None] + np.arange(3))
    signals = Signals(T, x, omega_b=np.cos(x))
    for value in (x, signals.omega_b, x):
        assert np.array_equal(lag.passed(value, DT, signals.spline), lag.passed(value, DT))
    assert signals.spline(x, 3) is signals.spline(x, 3)
    assert signals.spline(x, 3) is not signals.spline(x, 2)
    assert signals.spline(x, 3)(np.arange(4.0))[::-1] == pytest.approx(2.0 * x[0] - np.r_[x[:1], x[1:4]])


def test_a_hump_is_no_resonance() -> None:
    """At a damping ratio of 0.25 the peak rises to 1 / (2 * 0.25) = 2 times the level below it."""
    for damping, is_peak in ((0.24, True), (0.26, False)):
        assert make("resonance", frequency=1.0, damping=damping, rms=1.0).is_itself(1000.0) == is_peak
