"""What no sensor of a flight can be: an error beyond what there is to read, of squares where the log's reading was largest.

The height of air that weighs as much as its dynamic pressure at speed v is v^2 / (2 g), by Bernoulli's equation: with g of
9.80665 m/s^2, 0.0510 m over (m/s)^2.
"""

from __future__ import annotations

from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from kfgen.effects import make
from kfgen.gap.flight.path import FlownPath
from kfgen.gap.flight.reach import EXCEEDS_PRESSURE, EXCEEDS_SIGNAL, unreached
from kfgen.gap.motion.truth import Truth
from kfgen.gap.scene.scene import Placed

HEIGHTS = np.linspace(-2.0, 20.0, 50)


def said(name: str, where: str, **values: float) -> str:
    """Of a barometer that climbed from -2 m to 20 m, and a gyro that turned up to 2 rad/s."""
    read = {
        "baro": np.column_stack([HEIGHTS, np.zeros((50, 2))]),
        "gyro": np.tile([0.0, 2.0, 0.0], (50, 1)),
    }
    truth = Truth(np.arange(50.0), read, {"baro": (0,), "gyro": (0, 1, 2)}, np.ones(50, dtype=bool))
    path = SimpleNamespace(equations=SimpleNamespace(channels=("gyro_y",)), log=SimpleNamespace(aiding=()))
    return unreached(Placed(make(name, **values), where), cast(FlownPath, path), truth, cautious=True)


@pytest.mark.parametrize(
    ("name", "where", "values", "why"),
    [
        ("static_pressure_error", "baro", {"coefficient": 0.0509}, ""),
        ("static_pressure_error", "baro", {"coefficient": -0.0511}, EXCEEDS_PRESSURE),
        ("nonlinearity", "baro", {"k2": -0.049}, ""),
        ("nonlinearity", "baro", {"k2": -0.051}, EXCEEDS_SIGNAL),
        ("nonlinearity", "gyro_y", {"k3": 0.24}, ""),
        ("nonlinearity", "gyro_y", {"k3": -0.26}, EXCEEDS_SIGNAL),
        ("scale_factor", "gyro_y", {"coefficient": 1.1}, EXCEEDS_SIGNAL),
        ("scale_factor", "gyro_y", {"coefficient": -0.9}, ""),
    ],
)
def test_no_error_exceeds_what_there_is_to_read(
    name: str, where: str, values: dict[str, float], why: str
) -> None:
    assert said(name, where, **values) == why
