"""Proves that poses at rest and turns in a field tell what is wrong with a sensor, without a reference.

Readings are made in plain numpy from known errors; the recordings are compared with what others published of
them. A fit is good within 4.5 of its standard deviations; seeds are fixed.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import least_squares

from kfgen.core.units import STANDARD_GRAVITY as G
from kfgen.effects import make
from kfgen.effects.inertial.inertial_error import free
from kfgen.effects.noise_model import ChannelNoise, NoiseModel, Term
from kfgen.gap.motion.known_length import NormScene, norm_scene
from kfgen.gap.scene.scene import Placed, ScenePoint
from kfgen.identify.screening.rests import rests
from kfgen.log.log import Channel, Log

Array = NDArray[np.float64]
Find = Callable[[str], Path]

LIMIT = 4.5
AXES = "xyz"


def noise_of(unit: str, N: float, sensor: str) -> NoiseModel:
    return NoiseModel({f"{sensor}_{a}": ChannelNoise(unit, (Term(make("white_noise", N=N)),)) for a in AXES})


def triad(values: Array, unit: str, dt: float, sensor: str = "accel") -> Log:
    channels = {f"{sensor}_{a}": Channel.of(values[:, i], unit) for i, a in enumerate(AXES)}
    return Log(np.arange(len(values)) * dt, channels)


NINE = tuple(
    [Placed(make("bias", value=1e-3), f"accel_{a}") for a in AXES]
    + [Placed(make("scale_factor", coefficient=1e-3), f"accel_{a}") for a in AXES]
    + [Placed(make("misalignment", **{e: 1e-3}), f"accel_{e[0]}") for e in ("xy", "xz", "yz")]
)
IRON = (
    Placed(make("hard_iron", x=1e-9, y=1e-9, z=1e-9), "mag"),
    Placed(make("soft_iron", xx=1e-9, yy=1e-9, xy=1e-9, xz=1e-9, yz=1e-9), "mag"),
)


def fit(scene: NormScene, placed: tuple[Placed, ...], x0: Array | None = None) -> tuple[Array, Array, float]:
    """Values (the unknown length last), standard deviations, half the sum of squares left, by scipy."""
    keys = [(i, p.name) for i, one in enumerate(placed) for p in free(one.effect)]

    def residual(x: Array) -> Array:
        effects = [dict[str, float]() for _ in placed]
        for (i, name), value in zip(keys, x):
            effects[i][name] = float(value)
        point = [Placed(make(p.effect.name, **v), p.where) for p, v in zip(placed, effects)]
        return scene.residuals([ScenePoint(tuple(point), x[len(keys) :])])[:, 0]

    u = [one.value for one in scene.unknowns]
    start = np.concatenate([np.zeros(len(keys)) if x0 is None else x0, u])
    found = least_squares(residual, start, x_scale="jac", method="trf")
    return found.x, np.sqrt(np.diag(np.linalg.pinv(found.jac.T @ found.jac))), float(found.cost)


def directions(m: int, seed: int) -> Array:
    u = np.random.default_rng(seed).standard_normal((m, 3))
    return u / np.linalg.norm(u, axis=1)[:, None]


A = np.array([[1.01, 0.004, -0.002], [0.0, 0.99, 0.003], [0.0, 0.0, 1.02]])
B = np.array([0.1, -0.2, 0.3])


@pytest.fixture(scope="module")
def posed() -> Log:
    """Eighteen rests of 4 s and shaking for 2 s between them, at 100 Hz, N = 0.003 m/s^2/sqrt(Hz)."""
    rng = np.random.default_rng(1)
    pieces = []
    for u in directions(18, 2):
        pieces += [np.tile(u * G, (400, 1)), u * G + 5.0 * rng.standard_normal((200, 3))]
    f = np.vstack(pieces)
    return triad(f @ A.T + B + 0.03 * rng.standard_normal(f.shape), "m/s^2", 0.01)


def test_the_rests_are_found(posed: Log) -> None:
    found = rests(posed)
    assert len(found) == 18
    for k, (i, j) in enumerate(found):
        assert 600 * k - 30 <= i < j <= 600 * k + 430


def test_poses_give_biases_scales_and_one_triangle(posed: Log) -> None:
    scene = norm_scene(posed, noise_of("m/s^2", 0.003, "accel"))
    assert scene is not None
    x, sd, left = fit(scene, NINE)
    expected = [*B, *(np.diag(A) - 1.0), A[0, 1], A[0, 2], A[1, 2]]
    assert (np.abs(x - expected) < LIMIT * sd).all()
    assert 2.0 * left < 9 + LIMIT * np.sqrt(18)


def test_its_candidates_lose_what_is_placed(posed: Log) -> None:
    scene = norm_scene(posed, noise_of("m/s^2", 0.003, "accel"))
    assert scene is not None
    assert len(scene.candidates([])) == 9
    assert len(scene.candidates(NINE)) == 0
    names = {(c[0].effect.name, c[0].where) for c in scene.candidates(NINE[:1])}
    assert ("bias", "accel_x") not in names
    assert ("bias", "accel_y") in names


def test_a_turned_magnetometer_gives_iron() -> None:
    rng = np.random.default_rng(3)
    t = np.arange(3000) * 0.02
    turn = np.column_stack(
        [np.sin(0.7 * t) * np.cos(2 * t), np.sin(0.7 * t) * np.sin(2 * t), np.cos(0.7 * t)]
    )
    S = np.array([[1.05, 0.02, -0.01], [0.0, 0.97, 0.03], [0.0, 0.0, 1.0]])
    h = np.array([5.0, -8.0, 12.0])
    m = 48.0 * turn @ S.T + h + 0.2 * rng.standard_normal((3000, 3))
    scene = norm_scene(triad(m, "uT", 0.02, "mag"), noise_of("uT", 0.2e-6 * np.sqrt(0.02), "mag"), "mag")
    assert scene is not None
    x, sd, left = fit(scene, IRON)
    expected = [*(h * 1e-6), 0.05, 0.02, -0.01, -0.03, 0.03, 48e-6]
    assert (np.abs(x - expected) < LIMIT * sd + 1e-4 * np.abs(expected)).all()
    assert abs(2.0 * left / 2991 - 1.0) < LIMIT * np.sqrt(2 / 2991)


def test_what_was_never_turned_is_no_world() -> None:
    rng = np.random.default_rng(4)
    still = np.array([0.0, 0.0, G]) + 0.03 * rng.standard_normal((3000, 3))
    assert norm_scene(triad(still, "m/s^2", 0.01), noise_of("m/s^2", 0.003, "accel")) is None
    assert norm_scene(triad(still, "uT", 0.01, "mag"), noise_of("uT", 0.003e-6, "mag"), "mag") is None
    assert norm_scene(triad(still, "uT", 0.01, "mag"), noise_of("m/s^2", 0.003, "accel")) is None


# Recordings.


def test_the_accelerometer_of_a_recording(recording: Find) -> None:
    """imu0: published 0.36/0.32/0.62 % and 0.103/0.097/0.345 m/s^2, with a gravity of 9.81 m/s^2."""
    with np.load(recording("effects/mpu9150_calib_imu0.npz")) as data:
        log = triad(data["acc"].astype(float), "m/s^2", 1.0 / float(data["fs"]))
    scene = norm_scene(log, noise_of("m/s^2", 0.004, "accel"))
    assert scene is not None
    assert scene.t.size > 15
    x, _, left = fit(scene, NINE)
    np.testing.assert_allclose(x[:3], [0.103, 0.097, 0.345], atol=0.002)
    np.testing.assert_allclose(x[3:6] + 1 - 9.81 / G, [0.0036, 0.0032, 0.0062], atol=0.0003)
    assert 2.0 * left < 60.0


def test_poses_of_a_recording(recording: Find) -> None:
    """Ten poses: raw lengths of 8.9 to 11.1 m/s^2; after nine parameters 0.4 mm/s^2 rms are left."""
    with np.load(recording("effects/mpu6050_multipose_calib.npz")) as data:
        log = triad(data["acc_counts"].astype(float), "g/16384", 0.01)
    scene = norm_scene(log, noise_of("g/16384", 0.003, "accel"))
    assert scene is not None
    assert scene.t.size == 10
    size = np.linalg.norm(scene.y, axis=1)
    assert (size.min(), size.max()) == (pytest.approx(8.9, abs=0.05), pytest.approx(11.1, abs=0.05))
    x, _, left = fit(scene, NINE)
    assert np.sqrt(2.0 * left / 10 * scene.variance.mean()) < 0.001
    published = np.array([0.00060200834, 0.0005968449489, 0.0005859241382]) * 16384 / G
    np.testing.assert_allclose(1.0 / (1.0 + x[3:6]), published, rtol=0.002)


def test_the_iron_of_a_recording(recording: Find) -> None:
    """Centre about (6170, 252, 3450) counts, axes in a ratio of 2.2."""
    with np.load(recording("effects/qmc5883l_mag_calib_filtered.npz")) as data:
        log = triad(data["mag_counts"].astype(float), "count", 0.02, "mag")
    scene = norm_scene(log, noise_of("count", 20.0 * np.sqrt(0.02), "mag"), "mag")
    assert scene is not None
    x, _, _ = fit(scene, IRON, np.array([6000.0, 400.0, 3500.0, 0, 0, 0, 0, 0]))
    np.testing.assert_allclose(x[:3], [6170, 252, 3450], atol=40)
    assert 1.0 / (1.0 + x[3:8]).min() == pytest.approx(2.2, abs=0.1)
