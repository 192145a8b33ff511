"""Disturbances that the catalogue does not hold and that drift; and all disturbances together."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from noise import Array, smooth_wander
from scipy.signal import lfilter
from strange import SWINGS, Numbers, Strange


def _times(least: float, most: float) -> Callable[[np.random.Generator, int, float], Numbers]:
    """A time, between so many in the record."""

    def numbers(rng: np.random.Generator, n: int, dt: float) -> Numbers:
        return {"time": n * dt / rng.uniform(least, most)}

    return numbers


def _gauss_markov(rng: np.random.Generator, n: int, dt: float, v: Numbers) -> Array:
    a = np.exp(-dt / v["time"])
    return np.asarray(lfilter([np.sqrt(1.0 - a * a)], [1.0, -a], rng.standard_normal(n)))


def _relaxations(rng: np.random.Generator, n: int, dt: float, v: Numbers) -> Array:
    """A door that opens now and then: what comes in fades."""
    kicks = (rng.random(n) < 0.3 * dt / v["time"]) * np.exp(0.5 * rng.standard_normal(n))
    return np.asarray(lfilter([1.0], [1.0, -np.exp(-dt / v["time"])], kicks))


def _levels(rng: np.random.Generator, n: int, dt: float, v: Numbers) -> Array:
    """A bias that jumps to any level, and stays there for a while."""
    jumps = np.cumsum(rng.random(n) < dt / v["time"])
    return np.asarray(rng.standard_normal(int(jumps[-1]) + 1)[jumps])


def _staircase(rng: np.random.Generator, n: int, dt: float, v: Numbers) -> Array:
    """A bias that takes some steps of any size."""
    return np.asarray(np.cumsum((rng.random(n) < dt / v["time"]) * rng.standard_normal(n)))


def _gusts(rng: np.random.Generator, n: int, dt: float, v: Numbers) -> Array:
    """Wind: noise that is stronger at times."""
    return np.asarray(
        _gauss_markov(rng, n, dt, v) * np.exp(1.2 * smooth_wander(rng, n, dt, 1.0, 8.0 * v["time"]))
    )


def _rectified(rng: np.random.Generator, n: int, dt: float, v: Numbers) -> Array:
    """The square of what wanders."""
    return np.asarray(_gauss_markov(rng, n, dt, v) ** 2)


STRANGE: Mapping[str, Strange] = {
    **SWINGS,
    "relaxations": Strange(_times(100.0, 300.0), _relaxations),
    "levels": Strange(_times(30.0, 80.0), _levels),
    "staircase": Strange(_times(8.0, 20.0), _staircase),
    "gusts": Strange(_times(60.0, 200.0), _gusts),
    "rectified": Strange(_times(60.0, 200.0), _rectified),
}
