"""What a model's states, inputs and sensors are along a wanted motion, in continuous time.

A motion gives rates of its blocks from its inputs; here that is turned around: from the wanted body rate and
acceleration follow the inputs that make them, whatever frame, Earth rate or sensor error the model has. Rates of
inertial models are affine in what their triads show, so that is one linear system a time.

The motion is integrated on a fine grid, broken where the motion is: attitudes by Magnus' series [1]_, velocity and
position by Gauss-Legendre quadrature of three nodes a step [2]_, both of sixth order in the step.

References
----------
.. [1] A. Iserles, H. Z. Munthe-Kaas, S. P. Nørsett, A. Zanna, Lie-group methods, Acta Numerica 9, 2000, sec. 5.
.. [2] E. Hairer, G. Wanner, Solving Ordinary Differential Equations II, table IV.5.2 (nodes and weights).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import sympy as sp
from numpy.typing import NDArray

from kfgen.core.tape import Tape, tape
from kfgen.manoeuvre.motion import Motion
from kfgen.manoeuvre.rotations import as_matrix, cumulative, exponential, product, rotated
from kfgen.model.filter import FilterModel
from kfgen.model.symbols.blocks import Vector

Array = NDArray[np.float64]

FINE_STEP_S = 5e-3
"""Longest step of a simulated truth [s]."""
LEAST_SUBSTEPS = 4
"""Steps of the truth in one sampling period, at least."""
MAX_ITERATIONS = 40
POSITION_TOLERANCE_M = 1e-10
"""Change of a position at which the iteration of its rate ends [m]."""

_ROOT = np.sqrt(15.0)
NODES = np.array([0.5 - _ROOT / 10, 0.5, 0.5 + _ROOT / 10])
WEIGHTS = np.array([5.0, 8.0, 5.0]) / 18.0
PARTIAL = np.array(
    [
        [5 / 36, 2 / 9 - _ROOT / 15, 5 / 36 - _ROOT / 30],
        [5 / 36 + _ROOT / 24, 2 / 9, 5 / 36 - _ROOT / 24],
        [5 / 36 + _ROOT / 30, 2 / 9 + _ROOT / 15, 5 / 36],
    ]
)
"""Weights of the integrals from the beginning of a step to each of its nodes."""


def fine_times(t: Array, until: float, step: float = FINE_STEP_S) -> Array:
    """A fine even grid that has all of some even times in it.

    Parameters
    ----------
    t : ndarray, shape (n,)
        Even times [s].
    until : float
        Where the grid ends [s].
    step : float
        Its longest step [s].

    Returns
    -------
    ndarray, shape (m,)
    """
    dt = float(t[1] - t[0]) if t.size > 1 else max(until - float(t[0]), step)
    parts = max(LEAST_SUBSTEPS, int(np.ceil(dt / step * (1.0 - 1e-9))))
    last = round((until - float(t[0])) / dt) * parts
    return np.asarray(t[0] + np.arange(last + 1) * (dt / parts))


def along(
    model: FilterModel, wanted: Motion, constants: Mapping[str, float], step: float = FINE_STEP_S
) -> dict[str, Array]:
    """Values over time of the symbols of a model: blocks, rotation matrix, inputs without effects.

    Parameters
    ----------
    model : FilterModel
    wanted : Motion
    constants : mapping of str to float
        Truth of its constant states by name [SI]; their start where left out.
    step : float
        Longest step of the integration [s].

    Returns
    -------
    dict of str to ndarray, shape (n,)
        At the motion's times. The input channels show what they would without effects.
    """
    times = fine_times(wanted.t, float(wanted.t[-1]), step)
    path = Path(model, wanted, constants, times)
    return path.values(path.places(wanted.t))


@dataclass(frozen=True)
class Path:
    """The true motion on a fine grid.

    Parameters
    ----------
    model : FilterModel
    motion : Motion
    constants : mapping of str to float
        As of `along`.
    wanted : ndarray, shape (m,)
        Times that the grid has to have [s]; the first is the start.
    """

    model: FilterModel
    motion: Motion
    constants: Mapping[str, float]
    wanted: Array

    @cached_property
    def ideal(self) -> FilterModel:
        """The model without the errors of its readings."""
        return replace(self.model, noise={}, uses={}, ideal=True)

    @cached_property
    def t(self) -> Array:
        """Times of the grid: those that are wanted, and where the motion bends between them."""
        edges = self.motion.edges
        inside = edges[(edges > self.wanted[0]) & (edges < self.wanted[-1])]
        return np.unique(np.concatenate([self.wanted, inside]))

    @cached_property
    def known(self) -> dict[str, Any]:
        """What does not move, by name."""
        model = self.model
        values: dict[str, Any] = {c.name: c.value for c in model.constants}
        values |= {s.name: 0.0 for s in model.states} | dict.fromkeys(model.drivers, 0.0)
        for b in model.blocks:
            if isinstance(b, Vector):
                values |= dict(zip(b.nominal_names, b.start))
        return values | dict(self.constants)

    def places(self, times: Array) -> NDArray[np.intp]:
        """Where on the grid times are, shape as theirs: the nearest of its times."""
        k = np.clip(np.searchsorted(self.t, times), 1, max(self.t.size - 1, 1))
        nearer = times - self.t[k - 1] < self.t[np.minimum(k, self.t.size - 1)] - times
        return np.asarray(np.where(nearer, k - 1, np.minimum(k, self.t.size - 1)), dtype=np.intp)

    @cached_property
    def to_frame(self) -> Array:
        """North-east-down at the origin to navigation axes, shape (3, 3)."""
        return level_at(self.model, self.known).T

    @cached_property
    def _h(self) -> Array:
        return np.diff(self.t)

    def _wanted_at(self, part: slice) -> tuple[Array, Array, Array]:
        """The motion's rates at the nodes of some steps, each (steps, 3, 3): step, node, axis."""
        h = self._h[part]
        at = self.t[:-1][part, None] + h[:, None] * NODES
        omega, a_l, a_b = (r.reshape(h.size, 3, 3) for r in self.motion.rates(at.ravel()))
        return omega, a_l @ self.to_frame.T, a_b

    @cached_property
    def q(self) -> Array:
        """Attitude body to navigation frame as quaternions, scalar first, shape (m, 4)."""
        from scipy.spatial.transform import Rotation

        start = Rotation.from_matrix(self.to_frame @ self.motion.R_lb).as_quat(scalar_first=True)
        turns = [turned(self._wanted_at(p)[0], self._h[p])[0] for p in self.parts]
        return product(start, cumulative(exponential(np.concatenate([np.zeros((0, 3)), *turns]))))

    @property
    def parts(self) -> list[slice]:
        """The steps in pieces that fit into memory."""
        return [slice(k, min(k + PIECE, self._h.size)) for k in range(0, self._h.size, PIECE)]

    def _accelerations(self, part: slice) -> tuple[Array, Array, Array]:
        """Body rate, quaternion and rate of velocity in navigation axes at the nodes of some steps."""
        omega, a_n, a_b = self._wanted_at(part)
        nodes = product(self.q[:-1][part, None, :], exponential(turned(omega, self._h[part])[1]))
        return omega, nodes, a_n + rotated(nodes, a_b) if a_b.any() else a_n

    @cached_property
    def v(self) -> Array:
        """Velocity in navigation axes, shape (m, 3) [m/s]."""
        rises = [np.einsum("k,j,kji->ki", self._h[p], WEIGHTS, self._accelerations(p)[2]) for p in self.parts]
        start = self.to_frame @ self.motion.v_l
        return np.asarray(start + np.cumsum(np.concatenate([np.zeros((1, 3)), *rises]), axis=0))

    @cached_property
    def _vectors(self) -> dict[str, Vector]:
        return {b.name: b for b in self.model.motion.blocks if isinstance(b, Vector)}

    @cached_property
    def p(self) -> Array:
        """Position as the model has it, shape (m, 3): by its own rate, iterated where that depends on the position."""
        block = self._vectors["p"]
        rate = _Formulas(list(self.ideal.rates(False)["p"]), self.known)
        start = np.array([float(self.known[n]) for n in block.nominal_names])
        p = np.broadcast_to(start, self.v.shape)
        for _ in range(MAX_ITERATIONS):
            before, rises = p, []
            for part in self.parts:
                _, _, a = self._accelerations(part)
                at = self._moved(part, a, p)
                found = np.stack([np.broadcast_to(r, a.shape[:2]) for r in rate(at)], axis=-1)
                rises.append(np.einsum("k,j,kji->ki", self._h[part], WEIGHTS, found))
            p = start + np.cumsum(np.concatenate([np.zeros((1, 3)), *rises]), axis=0)
            if not rate.symbols & set(block.nominal_names) or np.abs(p - before).max() < POSITION_TOLERANCE_M:
                break
        return np.asarray(p)

    def _moved(self, part: slice, a: Array, p: Array) -> dict[str, Array]:
        """Velocity and position at the nodes of some steps, each (steps, 3)."""
        h = self._h[part]
        v = self.v[:-1][part, None, :] + h[:, None, None] * np.einsum("ij,kja->kia", PARTIAL, a)
        rise = np.diff(p, axis=0)[part]
        q = p[:-1][part, None, :] + NODES[:, None] * rise[:, None, :]
        named = {name: v[..., k] for k, name in enumerate(self._vectors["v"].nominal_names)}
        return named | {name: q[..., k] for k, name in enumerate(self._vectors["p"].nominal_names)}

    @cached_property
    def _shown(self) -> _Shown:
        return _Shown(self.ideal, self.known, ("v", "phi") if "v" in self._vectors else ("phi",))

    def nodes(self, part: slice) -> dict[str, Array]:
        """What moves at the nodes of some steps, each (steps, 3): inputs and what they follow from, by name."""
        omega, q, a = self._accelerations(part)
        values = dict(self._moved(part, a, self.p)) if "v" in self._vectors else {}
        values |= self._attitude(q)
        return values | self._shown(values, {"v": a, "phi": omega})

    def _attitude(self, q: Array) -> dict[str, Array]:
        attitude = self.model.attitude
        assert attitude is not None
        R = as_matrix(q)
        return {s.name: R[..., i // 3, i % 3] for i, s in enumerate(attitude.nominal)}

    def values(self, at: NDArray[np.intp]) -> dict[str, Array]:
        """Every symbol of the model's equations at some times of the grid, by name, each of the shape of `at`."""
        values = dict(self.known)
        if self.model.attitude is not None:
            values |= self._attitude(self.q[at])
            omega, a_l, a_b = self.motion.rates(self.t[at])
            wanted = {"phi": omega}
            if "v" in self._vectors:
                for name, rows in (("v", self.v), ("p", self.p)):
                    names = self._vectors[name].nominal_names
                    values |= {n: rows[at, k] for k, n in enumerate(names)}
                wanted["v"] = a_l @ self.to_frame.T + rotated(self.q[at], a_b)
            values |= self._shown(values, wanted)
        return {k: np.broadcast_to(np.asarray(v, float), at.shape) for k, v in values.items()}


PIECE = 1 << 16
"""Steps of the truth that are worked on at a time."""


def turned(omega: Array, h: Array) -> tuple[Array, Array]:
    """Rotation vectors of steps from rates at their nodes (Magnus' series to sixth order, sec. 5 of [1]_) [rad].

    Parameters
    ----------
    omega : ndarray, shape (n, 3, 3)
        Body rates by step, node and axis [rad/s].
    h : ndarray, shape (n,)
        Steps [s].

    Returns
    -------
    tuple of ndarray, shapes (n, 3) and (n, 3, 3)
        Over each step, and from its beginning to each node.
    """
    first = h[:, None] * omega[:, 1]
    second = _ROOT / 3.0 * h[:, None] * (omega[:, 2] - omega[:, 0])
    third = 10.0 / 3.0 * h[:, None] * (omega[:, 2] - 2.0 * omega[:, 1] + omega[:, 0])
    both = np.cross(first, second)
    inner = second - np.cross(first, both - 2.0 * third) / 60.0
    whole = first + third / 12.0 + np.cross(20.0 * first + third + both, inner) / 240.0
    part = h[:, None, None] * np.einsum("ij,kja->kia", PARTIAL, omega)
    cone = np.cross(omega[:, 1], omega[:, 2] - omega[:, 0]) * (5.0 / _ROOT / 12.0) * h[:, None] ** 2
    return whole, part + NODES[:, None] ** 3 * cone[:, None, :]


class _Formulas:
    """Expressions as a tape, in the order of their symbols' names."""

    def __init__(self, expressions: Sequence[sp.Expr], known: Mapping[str, Any]) -> None:
        symbols = sorted({s for e in expressions for s in e.free_symbols}, key=str)
        self.names = [s.name for s in symbols]
        self.known = known
        self.program: Tape = tape(list(expressions), symbols)

    @property
    def symbols(self) -> set[str]:
        """Names of what they depend on."""
        return set(self.names)

    def __call__(self, values: Mapping[str, Any]) -> list[Array]:
        """Their values; what is not given is as known."""
        given = [values[n] if n in values else self.known[n] for n in self.names]
        return [np.asarray(v, dtype=np.float64) for v in self.program.values(given)]


class _Shown:
    """What the input channels show so that blocks move as wanted."""

    def __init__(self, model: FilterModel, known: Mapping[str, Any], blocks: Sequence[str]) -> None:
        self.channels = [c for i in model.motion.inputs for c in i.channels]
        self.blocks = blocks
        symbols = [sp.Symbol(c, real=True) for c in self.channels]
        rates = [e for name in blocks for e in model.rates(False)[name]]
        self.rows = len(rates)
        slopes = [e.diff(s) for e in rates for s in symbols]
        self.formulas = _Formulas([*rates, *slopes], {**known, **dict.fromkeys(self.channels, 0.0)})

    def __call__(self, values: Mapping[str, Any], wanted: Mapping[str, Array]) -> dict[str, Array]:
        """By channel, of the shape of the wanted rates (..., 3) without their axis."""
        right = np.concatenate([wanted[name] for name in self.blocks], axis=-1)
        shape = right.shape[:-1]
        found = [np.broadcast_to(v, shape) for v in self.formulas(values)]
        free, slopes = found[: self.rows], found[self.rows :]
        matrix = np.stack(slopes, axis=-1).reshape(*shape, self.rows, len(self.channels))
        u = np.linalg.solve(matrix, (right - np.stack(free, axis=-1))[..., None])[..., 0]
        return {c: u[..., k] for k, c in enumerate(self.channels)}


def numeric(expressions: Sequence[sp.Expr], values: Mapping[str, Any]) -> list[Array]:
    """Expressions where their symbols have these values.

    Parameters
    ----------
    expressions : sequence of sympy expression
    values : mapping of str to float or ndarray

    Returns
    -------
    list of ndarray
    """
    return _Formulas(expressions, {})(values)


def level_at(model: FilterModel, values: Mapping[str, Any]) -> Array:
    """Navigation axes to north-east-down where symbols have these values.

    Parameters
    ----------
    model : FilterModel
    values : mapping of str to float

    Returns
    -------
    ndarray, shape (3, 3)
    """
    level = model.motion.offers({b.name: b.value for b in model.motion.blocks}, {})["level"]
    return np.asarray(level.subs({s: float(values[s.name]) for s in level.free_symbols}), dtype=np.float64)
