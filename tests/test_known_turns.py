"""Proves the world of known turns that the example on such a recording uses: scales against what its authors' angles give."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from kfgen.calibrate.known_turns import Turn, TurnScene, turn_scene
from kfgen.core.errors import InputError
from kfgen.effects import make
from kfgen.effects.noise_model import ChannelNoise, NoiseModel, Term
from kfgen.gap.scene.scene import Placed, ScenePoint
from kfgen.log.log import Channel, Log

Array = NDArray[np.float64]
Find = Callable[[str], Path]
AXES = "xyz"


def noise_of(unit: str, N: float) -> NoiseModel:
    term = Term(make("white_noise", N=N))
    return NoiseModel({f"gyro_{a}": ChannelNoise(unit, (term,)) for a in AXES})


def triad(values: Array, unit: str, dt: float) -> Log:
    channels = {f"gyro_{a}": Channel.of(values[:, i], unit) for i, a in enumerate(AXES)}
    return Log(np.arange(len(values)) * dt, channels)


def turn_fit(scene: TurnScene) -> Array:
    """Scales of the axes x, y, z by weighted least squares; biases beside them."""
    x0, J = np.zeros(6), np.empty((len(scene.turns), 6))

    def residual(x: Array) -> Array:
        scales = tuple(
            Placed(make("scale_factor", coefficient=float(s)), f"gyro_{a}") for s, a in zip(x, AXES)
        )
        return scene.residuals([ScenePoint(scales, x[3:])])[:, 0]

    for k in range(6):
        J[:, k] = residual(np.eye(6)[k]) - residual(x0)
    return np.linalg.lstsq(J, -residual(x0), rcond=None)[0]


def test_the_turns_of_a_recording(recording: Find) -> None:
    """Three turns by 360 deg: integrals of 370.0, 353.7 and 359.4 deg, so scales of +2.8, -1.8 and -0.2 %."""
    with np.load(recording("effects/imu_ferraris_session.npz")) as data:
        rate, sections = float(data["fs"]), json.loads(str(data["meta"]))["sections"]
        gyro = data["gyr"].astype(float)
    log = triad(gyro, "deg/s", 1.0 / rate)
    spans = {k: (s["start"] / rate - 1e-6, s["end"] / rate - 1e-6) for k, s in sections.items()}
    turns = [Turn(*spans[f"{a}_rot"], i, 2 * np.pi) for i, a in enumerate(AXES)]
    turns += [Turn(*span, i, 0.0) for k, span in spans.items() if not k.endswith("rot") for i in range(3)]
    scene = turn_scene(log, noise_of("deg/s", np.deg2rad(0.01)), turns, np.deg2rad(0.5))
    np.testing.assert_allclose(turn_fit(scene)[:3], [0.0279, -0.0176, -0.0018], atol=0.0005)
    assert {c[0].where for c in scene.candidates([])} == {"gyro_x", "gyro_y", "gyro_z"}
    with pytest.raises(InputError, match="outside"):
        turn_scene(log, noise_of("deg/s", 1e-4), [Turn(1e4, 1e4 + 3, 0, 1.0)], 0.01)
