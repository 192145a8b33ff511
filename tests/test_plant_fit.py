"""Proves that a fit of a time reaches its maximum from every start, and that what the record cannot tell stays a tie.

Expected maxima are those of plain numpy: the motion of a cart is linear in where it starts, so that a grid of the
time and linear least squares at each know the best of all. No statistics: the same record on both sides.
"""

from __future__ import annotations

import numpy as np
import pytest
from in_part import in_part
from numpy.typing import NDArray

from kfgen.effects.plant.terms import InputDelay, InputLag
from kfgen.gap.plant.scene import PlantScene
from kfgen.gap.scene.newton import fitted
from kfgen.gap.scene.scene import Placed, ScenePoint
from kfgen.log.log import Channel, Log
from kfgen.model.plant.file import parse_model

Array = NDArray[np.float64]

CART = """format = "kfgen-model-1"
name = "cart"
[parameters]
m = "1 kg"
[states]
x = "m"
v = "m/s"
[inputs]
force = "N"
[dynamics]
x = "v"
v = "force/m"
[measurements.position]
unit = "m"
expression = "x"
effects = [ { effect = "white_noise", N = "0.005 m/sqrt(Hz)" } ]
[measurements.speed]
unit = "m/s"
expression = "v"
effects = [ { effect = "white_noise", N = "0.02 m/s/sqrt(Hz)" } ]
"""
N, DT, FINE = 3000, 0.01, 10
NOISE = {"position": 0.05, "speed": 0.2}


def driven(force: Array, effect: str, time: float) -> tuple[Array, Array]:
    """Position and speed from rest at zero, the held force late or behind a lag that began settled."""
    h = DT / FINE
    u = np.repeat(force, FINE)
    if effect == "input_delay":
        whole = round(time / h)
        u = np.concatenate([np.full(whole, force[0]), u])[: u.size]
    else:
        stay, acting, now = np.exp(-h / time), np.empty_like(u), force[0]
        for k, wanted in enumerate(u):
            after = wanted + (now - wanted) * stay
            acting[k] = wanted + (now - wanted) * (1.0 - stay) * time / h  # on average over the piece
            now = after
        u = acting
    v = np.concatenate([[0.0], np.cumsum(u) * h])[:-1]
    x = np.concatenate([[0.0], np.cumsum(v * h + 0.5 * u * h**2)])[:-1]
    return x[::FINE], v[::FINE]


def least(force: Array, data: dict[str, Array], effect: str, times: Array) -> Array:
    """Half the sum of squares that is left at best, for each time."""
    t, one = np.arange(N) * DT, np.ones(N)
    A = np.vstack([np.c_[one, t] / NOISE["position"], np.c_[0 * one, one] / NOISE["speed"]])
    out = []
    for time in times:
        x, v = driven(force, effect, float(time))
        y = np.concatenate([(data["position"] - x) / 0.05, (data["speed"] - v) / 0.2])
        out.append(0.5 * np.sum((y - A @ np.linalg.lstsq(A, y, rcond=None)[0]) ** 2))
    return np.array(out)


@pytest.mark.parametrize(
    "start", in_part([0.05, *(pytest.param(s, marks=pytest.mark.long) for s in (0.3, 1.0, 4.0)), 16.0])
)
@pytest.mark.parametrize("effect", in_part(["input_delay", "input_lag"]))
def test_a_time_is_found_from_far_below_and_above(effect: str, start: float) -> None:
    rng, t = np.random.default_rng(67), np.arange(N) * DT
    force = -np.cos(2.1 * t) * np.sign(np.cos(0.31 * t))
    x, v = driven(force, "input_lag", 0.02)
    data = {"position": x + 0.05 * rng.standard_normal(N), "speed": v + 0.2 * rng.standard_normal(N)}
    channels = {"force": Channel(force, "N"), "position": Channel(data["position"], "m")}
    log = Log(t, {**channels, "speed": Channel(data["speed"], "m/s")}, "log")
    scene = PlantScene.of(parse_model(CART, "cart.toml"), log)
    cls = InputDelay if effect == "input_delay" else InputLag
    placed = Placed(cls(start * DT), "force")
    fit = fitted(scene, ScenePoint((placed,), np.array([u.start for u in scene.unknowns])))
    found = 0.5 * float(np.sum(fit.residual**2))
    best = least(force, data, effect, np.arange(1, 61) * 1e-3).min()
    assert found < best + 0.2  # the levels of the noise are fitted as well, and a grid is coarse
