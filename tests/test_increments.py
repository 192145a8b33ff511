"""Proves the integration of a fast IMU: velocity on a rolling body, coning against its closed form, increments gathered.

Truth is written down here: a body that rolls at a constant rate while it accelerates forward, and the coning motion
``q = (cos a/2, sin a/2 cos Wt, sin a/2 sin Wt, 0)`` of half angle a at W, whose exact changes of angle follow from its
quaternions and whose sums of angle alone drift about the third axis by ``(1 - cos a)(W - sin(W T) / T)`` [Savage 1998,
for small a], T being the step of the prediction.
"""

from __future__ import annotations

import math
from functools import cache
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from kfgen.core.errors import InputError
from kfgen.emit.gather import GATHER_SAMPLES
from kfgen.emit.routines import Program
from kfgen.emit.targets import filterpy, plain
from kfgen.emit.targets.loaded import loaded
from kfgen.model.discretise import DiscreteModel
from kfgen.model.library import build

INCREMENTS = {"samples": "increments", "biases": "false"}
ROLL, FORWARD, GRAVITY = math.radians(115.0), 2.0, 9.80665
N = round(GATHER_SAMPLES.value)


@cache
def module(name: str, target: Any, **options: str) -> Any:
    program = Program(DiscreteModel(build(name, None, options), max_step=0.1), "p", "double")
    return loaded(target.module(program)), filterpy.class_name(program)


def started(name: str, target: Any = plain, **options: str) -> Any:
    found, klass = module(name, target, **options)
    return getattr(found, klass)()


def rolling(t: float, dt: float) -> tuple[Any, Any]:
    """Changes of angle and velocity in body axes from t on, exact: of a force that turns about the forward axis."""
    a, b = ROLL * t, ROLL * (t + dt)
    side = -GRAVITY * (math.cos(a) - math.cos(b)) / ROLL  # of -g sin and -g cos
    down = -GRAVITY * (math.sin(b) - math.sin(a)) / ROLL
    return np.array([ROLL * dt, 0.0, 0.0]), np.array([FORWARD * dt, side, down])


def test_velocity_on_a_rolling_body_at_100_hz() -> None:
    """60 s at 115 deg/s with forward acceleration: below 0.05 m/s, and what the third order leaves, theta^2 g t / 12."""
    kf, dt = started("ins15", biases="false"), 0.01
    for k in range(6000):
        angle, velocity = rolling(k * dt, dt)
        assert kf.predict(velocity / dt, angle / dt, dt).name == "OK"
    off = kf.x[3:6] - np.array([60.0 * FORWARD, 0.0, 0.0])
    assert np.linalg.norm(off) < 0.05
    assert np.linalg.norm(off) == pytest.approx((ROLL * dt) ** 2 / 12.0 * GRAVITY * 60.0, rel=0.05)


@pytest.mark.parametrize("target", [plain, filterpy])
def test_increments_at_1_khz_and_the_covariance_at_100_hz(target: Any) -> None:
    """The same flight, gathered: nine tenths of that error are gone."""
    kf, dt, seconds = started("ins15", target, **INCREMENTS), 0.001, 12
    for k in range(1000 * seconds):
        said = kf.gather(*rolling(k * dt, dt), dt).name
        assert said == ("OK" if k % N == N - 1 else "GATHERING")
        if said == "OK":
            assert kf.predict(kf.gathered_accel, kf.gathered_gyro, kf.gathered_dt[0]).name == "OK"
    x = kf.x if target is plain else np.array(kf.nominal)
    off = x[3:6] - np.array([seconds * FORWARD, 0.0, 0.0])
    assert np.linalg.norm(off) < 0.1 * (ROLL * N * dt) ** 2 / 12.0 * GRAVITY * seconds


HALF_ANGLE, RATE = math.radians(1.0), 2.0 * math.pi * 10.0


def attitude(t: float) -> Rotation:
    s = math.sin(HALF_ANGLE / 2.0)
    q = [math.cos(HALF_ANGLE / 2.0), s * math.cos(RATE * t), s * math.sin(RATE * t), 0.0]
    return Rotation.from_quat(q, scalar_first=True)


def angles(t: float, dt: float, fine: int = 40) -> Any:
    """The integral of the body rate, by many small rotations: what a gyro that integrates gives."""
    at = [attitude(t + dt * i / fine) for i in range(fine + 1)]
    return sum((a.inv() * b).as_rotvec() for a, b in pairwise(at))


def coned(seconds: float, gathered: bool) -> float:
    """Drift about the third axis [rad/s] of `ahrs6` over whole turns of the cone."""
    dt = 0.001
    kf = started("ahrs6", **INCREMENTS)
    kf.x[:4] = attitude(0.0).as_quat(scalar_first=True)
    steps = round(seconds / dt)
    cycle = [angles(k * dt, dt) for k in range(100)]  # the cone turns once in 100 steps
    for first in range(0, steps, N):
        increments = [cycle[(first + k) % 100] for k in range(N)]
        if gathered:
            said = [kf.gather(d, dt).name for d in increments]
            assert said == ["GATHERING"] * (N - 1) + ["OK"]
            kf.predict(kf.gathered_gyro, kf.gathered_dt[0])
        else:
            kf.predict(np.sum(increments, axis=0) / (N * dt), N * dt)
    found = Rotation.from_quat(kf.x[:4], scalar_first=True)
    return float((found * attitude(seconds).inv()).as_rotvec()[2]) / seconds


def test_coning_drifts_as_its_closed_form_says_and_gathering_removes_it() -> None:
    T = 0.001 * N
    drift = (1.0 - math.cos(HALF_ANGLE)) * (RATE - math.sin(RATE * T) / T)
    assert coned(2.0, gathered=False) == pytest.approx(-drift, rel=0.02)
    assert abs(coned(2.0, gathered=True)) < 1e-3 * drift


def test_increments_beyond_a_sensor_are_refused_and_time_goes_by() -> None:
    kf = started("ins15", **INCREMENTS)
    before = kf.gathering.tobytes()
    limit = 100.0 * 0.001
    assert kf.gather([1.01 * limit, 0.0, 0.0], [0.0] * 3, 0.001).name == "BAD_INPUT"
    assert kf.gather([math.nan, 0.0, 0.0], [0.0] * 3, 0.001).name == "BAD_INPUT"
    assert kf.gather([0.0] * 3, [0.0] * 3, 0.0).name == "BAD_STEP"
    assert kf.gathering.tobytes() == before
    assert kf.supervise().name == "DEGRADED"
    assert kf.gather([0.99 * limit, 0.0, 0.0], [0.0] * 3, 0.001).name == "GATHERING"


def test_a_filter_of_rates_has_no_memory_for_increments() -> None:
    program = Program(DiscreteModel(build("ins15")))
    assert program.gather == ()
    assert not [a for a in program.arrays if a.startswith("gather")]


def test_a_model_without_inputs_has_no_such_option() -> None:
    with pytest.raises(InputError, match="samples"):
        build("gyro-static", None, {"samples": "increments"})
