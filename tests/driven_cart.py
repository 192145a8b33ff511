"""A cart on a spring under held inputs, by the closed solution of its equation, and what kfgen says of its log."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

import kfgen as kf

Array = NDArray[np.float64]
CART = """format = "kfgen-model-1"
name = "cart"
[parameters]
m = "1.5 kg"
k = "20 N/m"
c = "1 N s/m"
[states]
q = { unit = "m", initial = "0 m", sd = "0.01 m" }
v = { unit = "m/s", initial = "0 m/s", sd = "0.01 m/s" }
[inputs]
u = "N"
[dynamics]
q = "v"
v = "(u - k*q - c*v)/m"
[measurements.q_seen]
unit = "m"
expression = "q"
effects = [ { effect = "white_noise", N = "NOISE m/sqrt(Hz)" } ]
"""
RATE, N = 50.0, 2500


SIGMA = 0.005
"""Standard deviation of a measured place [m]."""


def driven(rng: np.random.Generator, damping: float = 1.0) -> tuple[Array, Array]:
    """Held input, and the place of the cart."""
    ends = np.cumsum(rng.exponential(30.0, N).astype(int) + 5)
    levels = rng.uniform(-6.0, 6.0, N)[np.searchsorted(ends, np.arange(N), side="right")]
    u = levels + 2.0 * np.sin(2.0 * np.pi * 0.9 * np.arange(N) / RATE)
    F = np.array([[0.0, 1.0, 0.0], [-20.0 / 1.5, -damping / 1.5, 1.0 / 1.5], [0.0, 0.0, 0.0]])
    step = expm(F / RATE)
    x, seen = np.zeros(2), np.empty(N)
    for k in range(N):
        seen[k] = x[0]
        x = step[:2, :2] @ x + step[:2, 2] * u[k]
    return u, seen


def cart(rng: np.random.Generator, damping: float = 1.0) -> tuple[Array, Array]:
    """Held input, and the noisy place of the cart."""
    u, place = driven(rng, damping)
    return u, place + SIGMA * rng.standard_normal(N)


def gap_of(
    folder: Path, u: Array, seen: Array, kept: NDArray[np.bool_] | None = None, rate: float = RATE
) -> kf.GapResult:
    """The gap of a log with some of the rows, of a sensor that has so many values a second."""
    table = np.column_stack([np.arange(N) / RATE, u, seen])[slice(None) if kept is None else kept]
    path, model = folder / "log.csv", folder / "cart.toml"
    np.savetxt(path, table, delimiter=",", header="t [s],u [N],q_seen [m]", comments="", fmt="%.10g")
    model.write_text(CART.replace("NOISE", f"{SIGMA / rate**0.5:.10g}"), encoding="utf-8")
    return kf.find_gap(path, model)
