"""Late samples are fused at their own times: a filter that knows a sensor's delay is as consistent as one without any.

The truth is a rotation vector's course integrated at 2 kHz, independent of kfgen's simulation; readings are of the attitude a
delay ago, exactly. The mean NIS of m samples of three rows has the standard deviation ``sqrt(6 / m)``.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from in_part import in_part
from scipy.spatial.transform import Rotation

from kfgen.emit.routines import Program
from kfgen.log.log import Channel, Log
from kfgen.model.discretise import DiscreteModel
from kfgen.model.filter import FilterModel
from kfgen.model.library import build
from kfgen.run.filter_calls import FilterCalls
from kfgen.run.own_times import OwnTimes
from kfgen.run.run import run
from kfgen.verify.replay import replay

RATE, FINE, LENGTH, REST = 100.0, 20, 16.0, 3.0
FIELD, G = np.array([20e-6, 0.0, 44e-6]), 9.80665
SD_MAG, SD_ACCEL, N_GYRO = 2e-7, 0.02, 1.5e-4
ALARM_SIGMAS = 4.0
"""Two-sided: 6e-5 of false alarms for each mean."""


@cache
def course() -> tuple[np.ndarray, np.ndarray]:
    """Mean rates over each step of the log, and quaternions, scalar last, at 2 kHz: 3 rad/s and 25 rad/s^2 after a rest."""
    t = np.arange(round(LENGTH * RATE) * FINE) / (RATE * FINE)
    later = np.clip(t - REST, 0.0, None)
    w = np.column_stack(
        [
            a * np.sin(2 * np.pi * f * later + p) - a * np.sin(p)
            for a, f, p in ((2.4, 1.1, 0.0), (1.9, 0.7, 0.4), (3.0, 1.3, 0.2))
        ]
    )
    q = np.empty((t.size, 4))
    now = Rotation.from_rotvec([0.1, -0.2, 0.7])
    half = Rotation.from_rotvec(0.5 * (w[:-1] + w[1:]) / (RATE * FINE)).as_quat()
    q[0] = now.as_quat()
    for k in range(t.size - 1):
        x, y, z, s = q[k]
        a, b, c, d = half[k]
        q[k + 1] = (
            s * a + x * d + y * c - z * b,
            s * b - x * c + y * d + z * a,
            s * c + x * b - y * a + z * d,
            s * d - x * a - y * b - z * c,
        )
    q /= np.linalg.norm(q, axis=1)[:, None]
    n = round(LENGTH * RATE)
    step = Rotation.from_quat(q[:-FINE:FINE]).inv() * Rotation.from_quat(q[FINE::FINE])
    means = 0.5 * (w[:-FINE:FINE] + w[FINE::FINE])
    turned = step.as_rotvec() * RATE
    assert np.abs(means - turned).max() < 0.2
    return np.vstack([turned, turned[-1:]])[:n], q


def late_log(delay: float, seed: int) -> Log:
    """Gyros, accelerometers, and a magnetometer whose samples are of a delay ago."""
    rng = np.random.default_rng(seed)
    w, q = course()
    n = len(w)
    at = np.arange(n) * FINE
    then = np.clip(at - round(delay * RATE * FINE), 0, None)
    mag = Rotation.from_quat(q[then]).inv().apply(FIELD) + SD_MAG * rng.standard_normal((n, 3))
    accel = Rotation.from_quat(q[at]).inv().apply([0.0, 0.0, -G]) + SD_ACCEL * rng.standard_normal((n, 3))
    gyro = w + N_GYRO * RATE**0.5 * rng.standard_normal((n, 3))
    columns = {"gyro": (gyro, "rad/s"), "accel": (accel, "m/s^2"), "mag": (mag, "T")}
    channels = {
        f"{name}_{a}": Channel(v[:, k], unit)
        for name, (v, unit) in columns.items()
        for k, a in enumerate("xyz")
    }
    return Log(np.arange(n) / RATE, channels, source="late.csv")


@cache
def attitude_filter(delay: float) -> FilterModel:
    chosen = {"left_out": "false", "mag_delay": f"{delay} s"}
    return build("ahrs6", None, chosen)


def mean_nis(delay: float, known: float, seed: int = 5) -> dict[str, tuple[float, int]]:
    """Mean NIS of each sensor and its updates, of those after the rest: the first attitude is not what is proven."""
    found = run(attitude_filter(known), late_log(delay, seed)).sensors
    return {
        n: (float(s.nis[s.t > REST + 1.0].mean()), int((s.t > REST + 1.0).sum())) for n, s in found.items()
    }


@pytest.mark.parametrize("delay", in_part([0.0, 0.03, pytest.param(0.055, marks=pytest.mark.long), 0.06]))
def test_mean_nis_is_that_of_a_sensor_on_time(delay: float) -> None:
    """Whole periods, and half of one; accelerometers, which are not late, are not disturbed either."""
    for name, (nis, updates) in mean_nis(delay, delay).items():
        assert abs(nis - 3.0) < ALARM_SIGMAS * (6.0 / updates) ** 0.5, (name, nis)


def test_samples_outside_of_the_log_are_left_out() -> None:
    """Three of a delay of 2.5 periods are from before the log; the others lie in the middle of its steps, in order."""
    t, z = np.arange(6.0), np.zeros((6, 1))
    times = OwnTimes.of(t, 1.0, {"mag": z, "gnss": z}, {"mag": 2.5, "gnss": -1.0})
    assert [[(s.name, s.row) for s in times.at(k)] for k in range(6)] == [
        [],
        *([("gnss", k - 1)] for k in range(1, 6)),
    ]
    assert [[(length, [s.row for s in late]) for length, late in times.between(k)] for k in range(6)] == [
        *([(0.5, [k + 3]), (0.5, [])] for k in range(3)),
        [(1.0, [])],
        [(1.0, [])],
        [],
    ]


def test_the_proof_makes_the_same_calls() -> None:
    """A replay through the emitted module has as many fusions, each at its own time, with the delay over."""
    program = Program(DiscreteModel(attitude_filter(0.055)), "ud", "double")
    log = late_log(0.055, 5)
    part = Log(
        log.t[:20], {n: Channel(c.values[:20], c.unit) for n, c in log.channels.items()}, source="part.csv"
    )
    played = replay(FilterCalls(program, part))
    names = [c.routine for c in played.calls]
    assert names.count("update_mag") == 20 - 6
    assert names.count("predict") == 19 + 14
    first = names.index("update_mag")
    around = [c.inputs[-1] for c in played.calls[first - 1 : first + 2] if c.routine == "predict"]
    assert around == pytest.approx([0.005, 0.005])


def test_an_unknown_delay_shows() -> None:
    """The check can fail: what the filter does not know is far out of the band."""
    assert mean_nis(0.03, 0.0)["mag"][0] > 10.0
