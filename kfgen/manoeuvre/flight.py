"""`Flight`: a model along a manoeuvre, in numbers: every symbol of its equations at every time."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
import sympy as sp
from numpy.typing import NDArray

from kfgen.core.tape import Tape, tape
from kfgen.effects.driven.proportional import driver_named
from kfgen.manoeuvre.manoeuvre import DEFAULT_LENGTH_S, INPUT_FORMULA_ORDER, Manoeuvre
from kfgen.manoeuvre.truth import along
from kfgen.model.filter import FilterModel

Array = NDArray[np.float64]


def plant_input(manoeuvre: Manoeuvre, name: str, k: int, t: Array) -> Array:
    """An input of a plant along a manoeuvre: as named, else the manoeuvre's own signals as plain numbers.

    Parameters
    ----------
    manoeuvre : Manoeuvre
    name : str
        Of the input.
    k : int
        Its number among the plant's inputs.
    t : ndarray, shape (n,)
        Times [s].

    Returns
    -------
    ndarray, shape (n,)
        In SI.
    """
    named = manoeuvre.input(name, t)
    if named is not None:
        return named
    rate, acceleration, _ = manoeuvre.values(t)
    return np.asarray(np.hstack([rate, acceleration])[:, INPUT_FORMULA_ORDER[k % len(INPUT_FORMULA_ORDER)]])


@dataclass(frozen=True)
class ManoeuvreMotion:
    """A manoeuvre as a motion from its start at the origin.

    Parameters
    ----------
    manoeuvre : Manoeuvre
    t : ndarray, shape (n,)
        Even times at which it is wanted [s].
    length : float
        Its length, unless its segments say their own [s].
    shaken : callable, optional
        Acceleration in body axes (m, 3) [m/s^2] at times (m,), beside the manoeuvre's.
    """

    manoeuvre: Manoeuvre
    t: Array
    length: float
    shaken: Callable[[Array], Array] | None = None

    @property
    def edges(self) -> Array:
        """Where its segments begin and end [s]."""
        return np.asarray(self.t[0] + self.manoeuvre.starts(self.length))

    @property
    def R_lb(self) -> Array:
        """Attitude at the start, body to north-east-down, shape (3, 3)."""
        from scipy.spatial.transform import Rotation

        return np.asarray(Rotation.from_quat(self.manoeuvre.attitude, scalar_first=True).as_matrix())

    @property
    def v_l(self) -> Array:
        """Velocity at the start [m/s]."""
        return np.asarray(self.manoeuvre.velocity, dtype=np.float64)

    def rates(self, t: Array) -> tuple[Array, Array, Array]:
        """Body rate, rate of velocity in north, east and down, and in body axes, at times (m,), each (m, 3)."""
        omega, a_l, a_b = self.manoeuvre.values(t, self.length, float(self.t[0]))
        return omega, a_l, a_b + self.shaken(t) if self.shaken else a_b


def wanted(manoeuvre: Manoeuvre, t: Array) -> ManoeuvreMotion:
    """A manoeuvre of the length of a time base.

    Parameters
    ----------
    manoeuvre : Manoeuvre
    t : ndarray, shape (n,)
        Even times [s].

    Returns
    -------
    ManoeuvreMotion
    """
    return ManoeuvreMotion(manoeuvre, t, float(t[-1] - t[0]) if t.size > 1 else DEFAULT_LENGTH_S)


AUDIT_STEP_S = 0.05
"""Longest step of the motion where only its derivatives are looked at [s]."""


@dataclass(frozen=True)
class Flight:
    """A model that flies a manoeuvre, its effects' states at zero.

    Parameters
    ----------
    model : FilterModel
    manoeuvre : Manoeuvre
    t : ndarray, shape (n,)
        Even times [s].
    drive : mapping of str to ndarray
        Drivers of effects [SI].
    start : mapping of str to float
        Where components of blocks start [SI], where it is not as declared.
    """

    model: FilterModel
    manoeuvre: Manoeuvre
    t: Array
    drive: Mapping[str, Array] = field(default_factory=dict)
    start: Mapping[str, float] = field(default_factory=dict)

    @cached_property
    def values(self) -> dict[str, Array]:
        """Every symbol of F, G, H and of the expected measurements by name, each of shape (n,)."""
        drive = {d: self.drive.get(d, driver_named(d).course(self.t)) for d in self.model.drivers}
        if self.model.attitude is not None:
            motion = wanted(self.manoeuvre, self.t)
            return along(self.model, motion, self.start, AUDIT_STEP_S) | drive
        values: dict[str, Any] = {c.name: c.value for c in self.model.constants}
        values |= {s.name: 0.0 for s in self.model.states} | drive
        for b in self.model.blocks:
            values |= dict(zip(b.nominal_names, b.start))
        values |= self.start
        channels = [c for i in self.model.motion.inputs for c in i.channels]
        values |= {c: plant_input(self.manoeuvre, c, k, self.t) for k, c in enumerate(channels)}
        values |= self._moving(values)
        return {n: np.broadcast_to(np.asarray(v, dtype=np.float64), self.t.shape) for n, v in values.items()}

    def _moving(self, values: Mapping[str, Any]) -> dict[str, Array]:
        """The blocks by their own rates (classical Runge-Kutta)."""
        rates = self.model.rates(False)
        blocks = [b for b in self.model.blocks if b.name in rates and any(r != 0 for r in rates[b.name])]
        if not blocks:
            return {}
        names = [n for b in blocks for n in b.nominal_names]
        others = [n for n in values if n not in names]
        symbols = [sp.Symbol(n, real=True) for n in (*names, *others)]
        program = tape([e for b in blocks for e in rates[b.name]], symbols)
        known = np.array([np.broadcast_to(values[n], self.t.shape) for n in others], dtype=np.float64)
        start = np.array([values[n] for n in names], dtype=np.float64)
        dt = float(self.t[1] - self.t[0]) if self.t.size > 1 else 1.0
        path = _integrated(program, start, known.reshape(-1, self.t.size), dt)
        return {n: path[:, k] for k, n in enumerate(names)}

    def rows(self, expressions: Sequence[sp.Expr]) -> Array:
        """Expressions at every time, shape (expressions, n)."""
        symbols = sorted({s for e in expressions for s in e.free_symbols}, key=str)
        out = np.zeros((len(expressions), self.t.size))
        if len(expressions):
            with np.errstate(all="ignore"):
                found = tape(list(expressions), symbols).values([self.values[s.name] for s in symbols])
            for row, value in zip(out, found):
                row[:] = value
        return out

    def matrix(self, M: sp.Matrix) -> Array:
        """A matrix at every time, shape (n, rows, columns)."""
        out = np.zeros((self.t.size, M.rows, M.cols))
        places = [(i, j) for i in range(M.rows) for j in range(M.cols) if M[i, j] != 0]
        for (i, j), row in zip(places, self.rows([M[p] for p in places])):
            out[:, i, j] = row
        return out


def _integrated(program: Tape, x: Array, known: Array, dt: float) -> Array:
    """States at every time, shape (n, states); what is known is held over a step."""
    n = known.shape[1]
    out = np.empty((n, x.size))
    for k in range(n):
        out[k] = x
        u = known[:, k]

        def rate(state: Array, u: Array = u) -> Array:
            with np.errstate(all="ignore"):
                return np.array(program.values([*state, *u]), dtype=np.float64)

        a = rate(x)
        b = rate(x + dt / 2 * a)
        c = rate(x + dt / 2 * b)
        d = rate(x + dt * c)
        x = x + dt / 6 * (a + 2 * b + 2 * c + d)
    return out
