"""Proves that coordinates become the metres that an independent geodesy has."""

from __future__ import annotations

import numpy as np
import pytest

from kfgen.core.wgs84 import local_metres


def test_metres_are_those_of_earth_fixed_axes() -> None:
    """Against a rotation of Earth-fixed vectors, written here; down against the difference of heights."""
    rng = np.random.default_rng(2)
    a, b = 6378137.0, 6356752.314245
    latitude, longitude = 0.8 + rng.uniform(-1e-3, 1e-3, 50), -2.0 + rng.uniform(-1e-3, 1e-3, 50)
    height = rng.uniform(0.0, 3000.0, 50)
    n = a**2 / np.hypot(a * np.cos(latitude), b * np.sin(latitude))
    r = np.stack(
        [
            (n + height) * np.cos(latitude) * np.cos(longitude),
            (n + height) * np.cos(latitude) * np.sin(longitude),
            (n * (b / a) ** 2 + height) * np.sin(latitude),
        ]
    )
    s, c, sl, cl = np.sin(latitude[0]), np.cos(latitude[0]), np.sin(longitude[0]), np.cos(longitude[0])
    axes = np.array([[-s * cl, -s * sl, c], [-sl, cl, 0.0]])
    north, east, down = local_metres(latitude, longitude, height)
    assert np.stack([north, east]) == pytest.approx(axes @ (r - r[:, :1]), abs=1e-6)
    assert np.array_equal(down, height[0] - height)


def test_a_minute_of_latitude_is_a_nautical_mile() -> None:
    north, east, _ = local_metres(np.deg2rad([45.0, 45.0 + 1 / 60]), np.zeros(2), np.zeros(2))
    assert north[1] == pytest.approx(1852.2, abs=0.3)
    assert east[1] == 0.0


def test_it_is_that_of_pymap3d() -> None:
    pymap3d = pytest.importorskip("pymap3d")
    latitude, longitude, height = np.array([47.0, 47.01]), np.array([8.0, 8.02]), np.array([400.0, 400.0])
    north, east, _ = pymap3d.geodetic2ned(latitude, longitude, height, 47.0, 8.0, 400.0)[:3]
    own = local_metres(np.deg2rad(latitude), np.deg2rad(longitude), height)
    assert own[0] == pytest.approx(north, abs=1e-6)
    assert own[1] == pytest.approx(east, abs=1e-6)
