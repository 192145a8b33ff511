"""Proves that a board that is turned to the vehicle is named in a flight, with its angles, and becomes part of the filter.

Flights come from `benchmarks/flight`, plain numpy that shares no code with kfgen; scipy turns their readings. An angle lies
outside of its 95 % interval once in twenty, so that what is asked is twice as wide: once in ten thousand.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import kfgen as kf
from kfgen.effects import make
from kfgen.effects.inertial.felt import Felt
from kfgen.gap.core.result import Finding
from kfgen.log.log import Channel, Log

sys.path.insert(0, str(Path(__file__).parents[1] / "benchmarks" / "flight"))
trial = pytest.importorskip("trial")

pytest.importorskip("numba")

SENSORS = ["gnss_position", "gnss_velocity", "mag", "barometer"]
ANGLES = np.radians([1.0, -2.0, 3.0])


def turned(log: Log, sensor: str, angles: np.ndarray) -> Log:
    """A triad of which every reading is that of a sensor that is turned to the vehicle."""
    names, channels = [f"{sensor}_{a}" for a in "xyz"], dict(log.channels)
    y = np.column_stack([channels[n].values for n in names])
    there = np.isfinite(y).all(axis=1)
    y[there] = Rotation.from_rotvec(angles).inv().apply(y[there])
    channels |= {n: Channel(y[:, k], channels[n].unit) for k, n in enumerate(names)}
    return replace(log, channels=channels)


def assert_angles(found: Finding, wanted: np.ndarray) -> None:
    """Within twice the half-width of their intervals."""
    for name, angle in zip("xyz", wanted, strict=True):
        lo, hi = found.ci95[name]
        assert abs(0.5 * (lo + hi) - angle) < hi - lo, name


@pytest.mark.long
@pytest.mark.parametrize("vehicle", ["wing", "quadrotor"])
def test_a_turned_magnetometer_is_named_with_its_angles(vehicle: str) -> None:
    """Three angles and not nine entries of soft iron, whose evidence is as good but for what it pays for."""
    log = turned(trial.log_of(trial.Case(vehicle, 112_611, 60.0), []), "mag", ANGLES)
    model = kf.build("ins15", options={"left_out": "false"}, sensors=SENSORS)
    gap = kf.find_gap(log, model)
    (found,) = gap.findings
    assert (found.name, found.where) == ("mounting", "mag")
    assert_angles(found, ANGLES)


@pytest.mark.long
def test_a_turned_board_of_a_car_shows_beside_its_wheels() -> None:
    """Without a magnetometer; a car does not slide sideways and does not lift off."""
    log = trial.log_of(trial.Case("car", 112_612, 90.0), [])
    angles = np.radians([0.0, 1.0, -1.5])
    for sensor in ("gyro", "accel"):
        log = turned(log, sensor, angles)
    zeros = Channel(np.where(np.arange(log.n) % 10 == 0, 0.0, np.nan), "m/s")
    log = replace(log, channels=dict(log.channels) | {"nhc_y": zeros, "nhc_z": zeros})
    sensors = ["gnss_position", "gnss_velocity", "non_holonomic"]
    gap = kf.find_gap(log, kf.build("ins15", options={"left_out": "false"}, sensors=sensors))
    assert ("mounting", "imu") in {(f.name, f.where) for f in gap.findings}


def test_the_turn_is_exact() -> None:
    """By scipy's rotations: a vector of twice the tangent of half the angle."""
    rotation = Rotation.from_rotvec(np.radians([10.0, -20.0, 30.0]))
    angle = rotation.magnitude()
    delta = rotation.as_rotvec() / angle * 2.0 * np.tan(angle / 2.0)
    u = np.array([0.3, -0.2, 0.9])
    effect = make("mounting", **dict(zip("xyz", delta.tolist(), strict=True)))
    read = [u[k] + effect.error(Felt(tuple(u)), k) for k in range(3)]  # type: ignore[attr-defined]
    assert read == pytest.approx(rotation.inv().apply(u), abs=1e-15)
