"""Proves that an attitude with too few digits is said to be rounded, and names no effect of the sensor."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from in_part import in_part
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from kfgen.effects import make
from kfgen.effects.noise_model import ChannelNoise, NoiseModel, Term
from kfgen.gap.motion.motion_scene import motion_scene
from kfgen.gap.motion.references.reference import heard
from kfgen.gap.motion.references.rounded_reference import step_of
from kfgen.gap.scene.scene_gap import SceneGap, scene_gap
from kfgen.log.log import Channel, Log

Array = NDArray[np.float64]

DT, N, FINE = 0.01, 5000, 10
SENSORS = {"gyro": ("rad/s", np.radians(0.1)), "accel": ("m/s^2", 0.05), "mag": ("T", 0.4e-6)}


def rates(t: Array, size: float) -> Array:
    rng = np.random.default_rng(5)
    f, p, a = rng.uniform(0.05, 1.5, (3, 4)), rng.uniform(0, 6, (3, 4)), rng.uniform(0.15, 0.5, (3, 4))
    return np.asarray(size * (a * np.sin(2 * np.pi * f * t[:, None, None] + p)).sum(axis=2))


def log_of(sensor: str, digits: int | None, size: float = 1.0) -> Log:
    """A sensor that turns, without any gap, and its attitude: small turns at ten times the rate, then rounded."""
    t = np.arange(N) * DT
    steps = Rotation.from_rotvec(rates((np.arange(N * FINE) + 0.5) * DT / FINE, size) * DT / FINE)
    nb, found = Rotation.from_rotvec([0.3, -0.4, 0.9]), []
    for k in range(N):
        found.append(nb.as_quat(scalar_first=True))
        for step in steps[k * FINE : (k + 1) * FINE]:
            nb = nb * step
    q = np.array(found)
    body = Rotation.from_quat(q, scalar_first=True).inv()
    fields = {"accel": [0.0, 0.0, -9.80665], "mag": [21e-6, 1e-6, 43e-6]}
    y = rates(t, size) if sensor == "gyro" else body.apply(fields[sensor])
    unit, sd = SENSORS[sensor]
    y = y + sd * np.random.default_rng(6).standard_normal(y.shape)
    written = q if digits is None else np.round(q, digits)
    channels = {f"{sensor}_{a}": Channel.of(y[:, i], unit) for i, a in enumerate("xyz")}
    channels |= {f"ref_q_{c}": Channel.of(written[:, i], "") for i, c in enumerate("wxyz")}
    return Log(t, channels)


def gap_of(sensor: str, log: Log) -> SceneGap:
    unit, sd = SENSORS[sensor]
    noise = ChannelNoise(unit, (Term(make("white_noise", N=sd * DT**0.5)),))
    scene = motion_scene(log, NoiseModel({f"{sensor}_{a}": noise for a in "xyz"}))
    assert scene is not None
    return scene_gap(scene)


def names(found: SceneGap) -> Sequence[str]:
    return [f.effect.name for f in found.findings]


@pytest.mark.long
@pytest.mark.parametrize("sensor", in_part(SENSORS))
def test_two_digits_are_too_few(sensor: str) -> None:
    """A step of 0.01 turns by 0.33 deg: 1.1 standard deviations of the accelerometer, 0.7 of the magnetometer."""
    found = gap_of(sensor, log_of(sensor, 2))
    assert found.verdict == "bad_data"
    assert names(found) == ["rounded_reference"]
    assert found.findings[0].effect.step == pytest.approx(0.01)


@pytest.mark.long
@pytest.mark.parametrize(("sensor", "digits"), in_part([("gyro", 4), ("accel", 3), ("mag", 3)]))
def test_digits_that_are_enough(sensor: str, digits: int) -> None:
    """A step of 0.001: 0.11 standard deviations of the accelerometer; of 1e-4: 0.2 of the gyro's at 1 Hz."""
    assert gap_of(sensor, log_of(sensor, digits)).verdict == "no_gap"


@pytest.mark.long
def test_a_slow_turn_does_not_stick() -> None:
    """At 0.15 rad/s a component of three digits moves by its step in a sample, and less as the rate passes zero: that is its rounding, and no stuck one."""
    log = log_of("gyro", 3, 0.3)
    assert [p.effect.name for p in heard(log).said] == []


@pytest.mark.long
def test_the_step_of_an_attitude() -> None:
    assert step_of(log_of("mag", 2)) == pytest.approx(0.01)
    assert step_of(log_of("mag", None)) == 0.0
