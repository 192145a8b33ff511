"""`Plan`: a filter's error system written as operations, once for every manoeuvre and every ring.

Along a manoeuvre the attitude and the velocity are given; the inputs (gyros, accelerometers) are what the model's own
rates need for it, and all else that moves follows its own rates. The errors of effects and of biases are looked at
around zero: the true motion is what is given, not what a biased sensor shows.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property

import sympy as sp

from kfgen.audit.exact.power_series import exact_writer
from kfgen.core.straight_line import Writer, decimal
from kfgen.manoeuvre.control import Control, control
from kfgen.manoeuvre.truth import level_at
from kfgen.model.filter import FilterModel
from kfgen.model.parts.sensors import Sensor
from kfgen.model.symbols.blocks import Vector

SERIES_FUNCTIONS = (sp.sin, sp.cos, sp.tan, sp.exp, sp.atan)
"""Functions whose power series around zero are summed exactly."""
Entry = tuple[int, int, int]
"""Row, column, place."""


@dataclass(frozen=True)
class LinearSolve:
    """A `Control` in places of a writer's operations.

    Parameters
    ----------
    writer : Writer
    targets, channels : tuple of str
    J : tuple of tuple of int, shape (r, r)
    b : tuple of int
    """

    writer: Writer
    targets: tuple[str, ...]
    channels: tuple[str, ...]
    J: tuple[tuple[int, ...], ...]
    b: tuple[int, ...]


@dataclass(frozen=True)
class Plan:
    """A model's operations.

    Parameters
    ----------
    model : FilterModel
    sensors : tuple of Sensor
        Those in use.
    """

    model: FilterModel
    sensors: tuple[Sensor, ...]

    @property
    def size(self) -> int:
        """Error states."""
        return len(self.model.states)

    @cached_property
    def channels(self) -> tuple[str, ...]:
        """The inputs' channels."""
        return tuple(c for i in self.model.motion.inputs for c in i.channels)

    @cached_property
    def rotation(self) -> tuple[sp.Symbol, ...]:
        """The nine atoms of the attitude that flies, row by row; none where there is none."""
        return tuple(self.model.attitude.nominal) if self.model.attitude is not None else ()

    @cached_property
    def vectors(self) -> tuple[Vector, ...]:
        """The other blocks."""
        return tuple(b for b in self.model.blocks if isinstance(b, Vector))

    @cached_property
    def variables(self) -> tuple[sp.Symbol, ...]:
        """What changes with time: attitude, other blocks, inputs, drivers."""
        flat = [s for b in self.vectors for s in b.nominal]
        others = [sp.Symbol(c, real=True) for c in (*self.channels, *self.model.drivers)]
        return (*self.rotation, *flat, *others)

    def fresh(self) -> Writer:
        """A writer in the variables, with constants as numbers and the states of effects at zero."""
        writer = exact_writer(self.variables)
        at_zero = {s.symbol for s in self.model.states}.difference(self.variables)
        for c in self.model.constants:
            writer.name(c.symbol, sp.Rational(decimal(c.value)))
            at_zero.discard(c.symbol)
        for symbol in sorted(at_zero, key=str):
            writer.name(symbol, sp.Integer(0))
        return writer

    @cached_property
    def _rates(self) -> Mapping[str, sp.Matrix]:
        return self.model.rates(False)

    @cached_property
    def equations(self) -> Control | None:
        """How inputs follow from a manoeuvre, in symbols; None where they do not."""
        return control(self.model)

    @cached_property
    def control(self) -> LinearSolve | None:
        """The same in places of a writer's operations."""
        found = self.equations
        if found is None:
            return None
        writer, r = self.fresh(), len(found.channels)
        J = tuple(tuple(writer.place(found.J[i, j]) for j in range(r)) for i in range(r))
        return LinearSolve(writer, found.targets, found.channels, J, tuple(writer.place(e) for e in found.b))

    def slope(self, block: str) -> sp.Matrix:
        """The model's own rate of a block."""
        return self._rates.get(block, sp.zeros(0, 1))

    @property
    def given(self) -> tuple[str, ...]:
        """The blocks whose rates a manoeuvre gives."""
        return self.control.targets if self.control else ()

    @cached_property
    def _main(self) -> tuple[Writer, dict[str, tuple[int, ...]], tuple[Entry, ...], tuple[Entry, ...]]:
        writer = self.fresh()
        rates = {n: tuple(writer.place(e) for e in r) for n, r in self._rates.items() if n not in self.given}
        F = self.model.F
        H = sp.Matrix.vstack(sp.zeros(0, self.size), *(self.model.H(s) for s in self.sensors))
        return writer, rates, _entries(writer, F), _entries(writer, H)

    @property
    def writer(self) -> Writer:
        """Rates of the free blocks, F and H."""
        return self._main[0]

    @property
    def rates(self) -> Mapping[str, tuple[int, ...]]:
        """Places of the rates of the free blocks."""
        return self._main[1]

    @property
    def F(self) -> tuple[Entry, ...]:
        """The entries of the dynamics that are not zero."""
        return self._main[2]

    @property
    def H(self) -> tuple[Entry, ...]:
        """The entries of the measurement."""
        return self._main[3]

    @cached_property
    def own(self) -> tuple[sp.Symbol, ...]:
        """Components of the blocks that no manoeuvre places: an arm, a feature, the states of a plant."""
        return tuple(s for b in self.vectors if not self._placed(b) for s in b.nominal)

    @cached_property
    def curved(self) -> frozenset[sp.Symbol]:
        """Own components inside sines and the like, which have a value only where their power series converge."""
        M = [*self.model.F, *(e for s in self.sensors for e in self.model.H(s))]
        rates = [e for r in self._rates.values() for e in r]
        found: set[sp.Symbol] = set()
        for e in (*M, *rates):
            for call in e.atoms(*SERIES_FUNCTIONS):
                found |= call.args[0].free_symbols
        return frozenset(found & set(self.own))

    def numbers(self, *, generic: bool) -> dict[str, float]:
        """Where the plan's own components start, by name [SI]."""
        start = self.start(generic=generic)
        return {s.name: float(start[s]) for s in self.own}

    @cached_property
    def frame(self) -> tuple[float, float, float, float]:
        """The quaternion that takes north-east-down at the start to navigation axes, scalar first."""
        from scipy.spatial.transform import Rotation

        values = {c.name: c.value for c in self.model.constants}
        values |= {n: v for b in self.vectors for n, v in zip(b.nominal_names, b.start)}
        level = level_at(self.model, values)
        w, x, y, z = (float(e) for e in Rotation.from_matrix(level.T).as_quat(scalar_first=True))
        return w, x, y, z

    def _placed(self, b: Vector) -> bool:
        return self.control is not None and b.name in ("p", "v")

    def start(self, *, generic: bool) -> dict[sp.Symbol, Fraction]:
        """Where the blocks start.

        Parameters
        ----------
        generic : bool
            Near their declared start, at no special point; else at the declared one, as position and velocity always.
        """
        out, draw = {}, Draws()
        for b in self.vectors:
            for s, declared, sd in zip(b.nominal, b.start, b.deviations):
                off = decimal(_round(sd)) * next(draw)
                moved = generic and not self._placed(b)
                out[s] = decimal(declared) + (off if moved else 0)
        return out


def _round(x: float) -> float:
    return float(f"{x:.2g}")


class Draws:
    """Fractions between a third and one, of either sign, always the same."""

    def __init__(self) -> None:
        self.k = 0

    def __next__(self) -> Fraction:
        self.k += 1
        size = Fraction(37 + (self.k * 61) % 97, 137)
        return size if self.k % 2 else -size


def _entries(writer: Writer, M: sp.Matrix) -> tuple[Entry, ...]:
    """The entries of a matrix that are not zero."""
    return tuple((i, j, writer.place(M[i, j])) for i in range(M.rows) for j in range(M.cols) if M[i, j] != 0)
