"""What a model's states, inputs and sensors are along a wanted motion.

A motion gives rates of its blocks from its inputs; here that is turned around: from the wanted body rate and
acceleration follow the inputs that make them, whatever frame, Earth rate or sensor error the model has. Rates of
inertial models are affine in what their triads show, so that is one linear system a sample.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import sympy as sp
from numpy.typing import NDArray

from kfgen.core import linear
from kfgen.model.filter import FilterModel
from kfgen.model.symbols.blocks import Attitude, Vector

Array = NDArray[np.float64]


@dataclass(frozen=True)
class MotionProfile:
    """A motion to be made.

    Parameters
    ----------
    t : ndarray, shape (n,)
        Even times [s].
    omega_b : ndarray, shape (n, 3)
        Rate of the body against the navigation frame [rad/s].
    a_l : ndarray, shape (n, 3)
        Rate of velocity in north, east and down at the origin [m/s^2].
    R_lb : ndarray, shape (3, 3)
        Attitude at the start, body to north-east-down.
    v_l : ndarray, shape (3,)
        Velocity at the start [m/s].
    """

    t: Array
    omega_b: Array
    a_l: Array
    R_lb: Array
    v_l: Array


def along(model: FilterModel, wanted: MotionProfile, constants: Mapping[str, float]) -> dict[str, Array]:
    """Values over time of the symbols of a model: blocks, rotation matrix, inputs without effects.

    Parameters
    ----------
    model : FilterModel
    wanted : Wanted
    constants : mapping of str to float
        Truth of its constant states by name [SI]; their start where left out.

    Returns
    -------
    dict of str to ndarray, shape (n,)
        The input channels show what they would without effects.
    """
    n = wanted.t.size
    values: dict[str, Any] = {c.name: c.value for c in model.constants}
    values |= {s.name: 0.0 for s in model.states} | dict.fromkeys(model.drivers, 0.0)
    for b in model.motion.blocks:
        if isinstance(b, Vector):
            values |= dict(zip(b.nominal_names, b.start))
    for b in model.blocks[len(model.motion.blocks) :]:
        values |= dict(zip(b.nominal_names, b.start))
    values |= constants
    to_frame = level_at(model, values).T
    dt = float(wanted.t[1] - wanted.t[0]) if n > 1 else 1.0
    if model.attitude is not None:
        R = attitudes(to_frame @ wanted.R_lb, wanted.omega_b, dt)
        values |= {s.name: R[:, i // 3, i % 3] for i, s in enumerate(model.attitude.nominal)}
    names = {b.name: b for b in model.motion.blocks}
    if "v" in names:
        a = wanted.a_l @ to_frame.T
        v = to_frame @ wanted.v_l + np.vstack([np.zeros(3), np.cumsum(a[:-1] * dt, axis=0)])
        values |= {name: v[:, k] for k, name in enumerate(names["v"].nominal_names)}
        p = _travelled(model, values, a, dt)
        values |= {name: p[:, k] for k, name in enumerate(names["p"].nominal_names)}
        values |= _shown(model, values, {"v": a, "phi": wanted.omega_b})
    elif model.attitude is not None:
        values |= _shown(model, values, {"phi": wanted.omega_b})
    return {k: np.broadcast_to(np.asarray(v, float), n) for k, v in values.items()}


def level_at(model: FilterModel, values: Mapping[str, Any]) -> Array:
    """Navigation axes to north-east-down, shape (3, 3), where symbols have these values."""
    level = model.motion.offers({b.name: b.value for b in model.motion.blocks}, {})["level"]
    return np.asarray(level.subs({s: float(values[s.name]) for s in level.free_symbols}), dtype=np.float64)


def numeric(expressions: Sequence[sp.Expr], values: Mapping[str, Any]) -> list[Array]:
    """Expressions where their symbols have these values."""
    symbols = sorted(set().union(*(e.free_symbols for e in expressions)), key=str)
    function: Callable[..., list[Any]] = sp.lambdify(symbols, list(expressions), "numpy", cse=True)
    return [np.asarray(v, float) for v in function(*(values[s.name] for s in symbols))]


def attitudes(R: Array, omega_b: Array, dt: float) -> Array:
    """Attitudes from a start at body rates that are held, shape (n, 3, 3)."""
    from scipy.spatial.transform import Rotation

    q, out = Rotation.from_matrix(R), np.empty((len(omega_b), 3, 3))
    for k, step in enumerate(Rotation.from_rotvec(omega_b * dt)):
        out[k] = q.as_matrix()
        q = q * step
    return out


def _travelled(model: FilterModel, values: Mapping[str, Any], a: Array, dt: float) -> Array:
    """``p`` from the start by its own rate, midpoint by midpoint, shape (n, 3)."""
    block = next(b for b in model.motion.blocks if b.name == "p")
    rate = list(model.rates(False)["p"])
    v_names = [s.name for b in model.motion.blocks if b.name == "v" for s in b.nominal]
    v = np.column_stack([values[n] for n in v_names])
    start = np.array([float(values[n]) for n in block.nominal_names])
    free = set().union(*(e.free_symbols for e in rate)) & set(block.nominal)
    halfway = v + 0.5 * a * dt
    if not free:
        steps = np.column_stack(numeric(rate, dict(values) | dict(zip(v_names, halfway.T))))
        return np.asarray(start + np.vstack([np.zeros(3), np.cumsum(steps[:-1] * dt, axis=0)]))
    symbols = [sp.Symbol(n, real=True) for n in (*block.nominal_names, *v_names)]
    known = {s: values[s.name] for e in rate for s in e.free_symbols if s not in symbols}
    function = sp.lambdify(symbols, [e.subs(known) for e in rate], "math", cse=True)
    p = np.empty_like(v)
    p[0] = start
    for k in range(len(v) - 1):
        middle = p[k] + 0.5 * dt * np.array(function(*p[k], *v[k]))
        p[k + 1] = p[k] + dt * np.array(function(*middle, *halfway[k]))
    return p


def _shown(model: FilterModel, values: Mapping[str, Any], wanted: Mapping[str, Array]) -> dict[str, Array]:
    """What the input channels show so that blocks move as wanted."""
    channels = [c for i in model.motion.inputs for c in i.channels]
    symbols = [sp.Symbol(c, real=True) for c in channels]
    rates = [e for name in wanted for e in model.rates(False)[name]]
    A = [e.diff(s) for e in rates for s in symbols]
    at_zero = dict(values) | dict.fromkeys(channels, 0.0)
    n = len(next(iter(wanted.values())))
    found = [np.broadcast_to(v, n) for v in numeric([*rates, *A], at_zero)]
    m = len(rates)
    free = np.column_stack(found[:m])
    matrix = np.stack(found[m:], axis=1).reshape(n, m, len(channels))
    right = np.column_stack([wanted[name] for name in wanted]) - free
    u: Array = np.asarray(np.linalg.solve(matrix, right[:, :, None])[:, :, 0], dtype=np.float64)
    return {c: u[:, k] for k, c in enumerate(channels)}


def wandered(model: FilterModel, t: Array, rng: np.random.Generator) -> dict[str, Array]:
    """Random courses of the blocks that noise alone moves, from a draw of their priors on, each of shape (n,)."""
    blocks, A, W = model.noise_driven_blocks
    if not blocks:
        return {}
    names = [n for b in blocks for n in b.nominal_names]
    start = np.array([b.prior for b in blocks for _ in b.nominal_names]) * rng.standard_normal(len(names))
    dt = float(t[1] - t[0]) if t.size > 1 else 1.0
    Phi, Qd = linear.van_loan(np.array(A, dtype=np.float64), np.array(W, dtype=np.float64), dt)
    x = linear.simulate(Phi, Qd, start, t.size, rng)
    return {n: x[:, k] for k, n in enumerate(names)}


def drawn(model: FilterModel, rng: np.random.Generator) -> dict[str, float]:
    """A truth of the constant states, drawn from their priors [SI]."""
    still = [
        b
        for b in model.blocks
        if not isinstance(b, Attitude) and all(e == 0 for e in model.rates(False)[b.name])
    ]
    return {
        name: start + sd * float(rng.standard_normal())
        for b in still
        if isinstance(b, Vector)
        for name, start, sd in zip(b.nominal_names, b.start, b.deviations)
    }
