"""`Flight`: a model along a manoeuvre, in numbers: every symbol of its equations at every time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import sympy as sp
from numpy.typing import NDArray

from kfgen.manoeuvre.control import Control, control
from kfgen.manoeuvre.manoeuvre import Manoeuvre, plant_input
from kfgen.manoeuvre.truth import Truth, truth
from kfgen.model.blocks import Vector
from kfgen.model.filter import FilterModel
from kfgen.model.tape import Tape, tape

Array = NDArray[np.float64]


def warming(t: Array) -> Array:
    """A temperature [K] that warms up by 12 K and then swings by 4 K, shape (n,)."""
    T = float(t[-1] - t[0]) or 1.0
    return np.asarray(293.15 + 12.0 * (1.0 - np.exp(-6.0 * t / T)) + 4.0 * np.sin(4.5 * np.pi * t / T))


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
    """

    model: FilterModel
    manoeuvre: Manoeuvre
    t: Array
    drive: Mapping[str, Array]

    @cached_property
    def truth(self) -> Truth:
        """The body's motion."""
        return truth(self.manoeuvre, self.t)

    @cached_property
    def control(self) -> Control | None:
        """How the inputs follow from it."""
        return control(self.model)

    @cached_property
    def values(self) -> dict[sp.Symbol, Array | float]:
        """Every symbol of F, G, H and of the expected measurements: numbers, or arrays of shape (n,)."""
        true, model = self.truth, self.model
        values: dict[sp.Symbol, Array | float] = {c.symbol: c.value for c in model.constants}
        values |= {s.symbol: 0.0 for s in model.states if s.symbol not in values}
        values |= {sp.Symbol(d, real=True): self.drive.get(d, warming(self.t)) for d in model.drivers}
        if model.attitude is not None:
            atoms = list(model.attitude.nominal)
            values |= {s: true.R_nb[:, k // 3, k % 3] for k, s in enumerate(atoms)}
        flown = {"v": true.v_n, "p": true.p_n}
        for b in self._vectors:
            columns = flown[b.name].T if b.name in self._placed else b.start
            values |= dict(zip(b.nominal, columns))
        self._inputs(values)
        self._free(values)
        return values

    @property
    def _vectors(self) -> list[Vector]:
        return [b for b in self.model.blocks if isinstance(b, Vector)]

    @property
    def _placed(self) -> tuple[str, ...]:
        return self.control.placed if self.control is not None else ()

    def _inputs(self, values: dict[sp.Symbol, Array | float]) -> None:
        """What the inputs read."""
        found = self.control
        channels = [c for i in self.model.motion.inputs for c in i.channels]
        determined = found.channels if found else ()
        for k, c in enumerate(c for c in channels if c not in determined):
            values[sp.Symbol(c, real=True)] = plant_input(self.manoeuvre, c, k, self.t)
        if found is None:
            return
        n, r = self.t.size, len(found.channels)
        rows = evaluate([*found.J, *found.b], values, n)
        J, b = rows[: r * r].T.reshape(n, r, r), rows[r * r :].T
        rates = {"v": self.truth.a_n}
        targets = np.hstack([rates.get(name, self.truth.omega_b) for name in found.targets])
        u = np.linalg.solve(J, (targets - b)[:, :, None])[:, :, 0]
        values |= {sp.Symbol(c, real=True): u[:, k] for k, c in enumerate(found.channels)}

    def _free(self, values: dict[sp.Symbol, Array | float]) -> None:
        """The blocks that follow their own rates, where these are not zero (classical Runge-Kutta)."""
        rates = self.model.rates(False)
        placed = ("v", "p") if self.control else ()
        free = [
            b for b in self._vectors if b.name not in placed and any(r != 0 for r in rates.get(b.name, ()))
        ]
        if not free:
            return
        symbols = [s for b in free for s in b.nominal]
        others = [s for s in values if s not in symbols]
        program = tape([e for b in free for e in rates[b.name]], [*symbols, *others])
        known = np.array([np.broadcast_to(values[s], self.t.shape) for s in others]).reshape(-1, self.t.size)
        start = np.array([c for b in free for c in b.start])
        path = _integrated(program, start, known, float(self.t[1] - self.t[0]) if self.t.size > 1 else 1.0)
        values |= {s: path[:, k] for k, s in enumerate(symbols)}

    def rows(self, expressions: Sequence[sp.Expr]) -> Array:
        """Expressions at every time, shape (expressions, n)."""
        return evaluate(expressions, self.values, self.t.size)

    def matrix(self, M: sp.Matrix) -> Array:
        """A matrix at every time, shape (n, rows, columns)."""
        out = np.zeros((self.t.size, M.rows, M.cols))
        places = [(i, j) for i in range(M.rows) for j in range(M.cols) if M[i, j] != 0]
        for (i, j), row in zip(places, self.rows([M[p] for p in places])):
            out[:, i, j] = row
        return out


def evaluate(expressions: Sequence[sp.Expr], values: Mapping[sp.Symbol, Array | float], n: int) -> Array:
    """Expressions at every time, shape (expressions, n)."""
    symbols = sorted({s for e in expressions for s in e.free_symbols}, key=str)
    if not expressions:
        return np.zeros((0, n))
    rows = tape(list(expressions), symbols).values([values[s] for s in symbols])
    return np.array([np.broadcast_to(np.asarray(r, dtype=np.float64), (n,)) for r in rows])


def _integrated(program: Tape, x: Array, known: Array, dt: float) -> Array:
    """States at every time, shape (n, states); what is known is held over a step."""
    n = known.shape[1]
    out = np.empty((n, x.size))
    for k in range(n):
        out[k] = x
        u = known[:, k]

        def rate(state: Array, u: Array = u) -> Array:
            return np.array(program.values([*state, *u]), dtype=np.float64)

        a = rate(x)
        b = rate(x + dt / 2 * a)
        c = rate(x + dt / 2 * b)
        d = rate(x + dt * c)
        x = x + dt / 6 * (a + 2 * b + 2 * c + d)
    return out
