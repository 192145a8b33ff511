"""The routines of a filter in the intermediate form, from its discrete model.

Two families from the same expressions: the whole filter on packed arrays (``init``, ``predict``,
``update_<sensor>``), for C and its float32 reference; and its pieces (``step``, ``transition``,
``noise``, ``expect_<sensor>``, ``inject``), for a target that has matrices of its own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, reduce
from math import ceil
from typing import Any

import numpy as np
import sympy as sp

from kfgen.core.errors import InputError
from kfgen.emit.covariance.factored import Factored
from kfgen.emit.covariance.forms import ANY_HELD, HEALTH, HELD, CovarianceForm, Packed
from kfgen.emit.covariance.packed import Row
from kfgen.emit.covariance.scalars import NIS, fused
from kfgen.emit.ir.ir import (
    Argument,
    Compare,
    Expr,
    Let,
    Note,
    Num,
    Ref,
    Routine,
    Scratch,
    StatusFlag,
    Stmt,
    Store,
    Una,
    When,
    add,
    mul,
    sub,
)
from kfgen.emit.ir.lower import Lowering
from kfgen.emit.ir.symbols import Atoms, Rows, lowering, transition
from kfgen.emit.ir.tidy import tidy
from kfgen.emit.targets.names import argument, check_names, identifier
from kfgen.emit.targets.words import driver_text
from kfgen.model.discretise import DiscreteModel
from kfgen.model.parts.constant import Constant
from kfgen.model.parts.sensors import Sensor
from kfgen.model.register import DT

GATE = Constant("gate", "1", 100.0, "gate: largest squared innovation over its variance")
MAX_INPUT_SQUARE_SUM = 1e30
"""Squares of inputs add up to less, unless one is no number."""
MAX_WAITING_PREDICTIONS = 2000
"""Predictions for which noise may wait: the proof runs twice as many."""
FORMS: dict[str, type[CovarianceForm]] = {f.NAME: f for f in (Packed, Factored)}
REALS: dict[str, type[np.floating[Any]]] = {"float": np.float32, "double": np.float64}


@dataclass(frozen=True)
class Program:
    """A discrete model as code: what every target needs to know.

    Parameters
    ----------
    discrete : DiscreteModel
    form : str
        Of the covariance: a key of `FORMS`.
    real : str
        Of every number: a key of `REALS`.
    loops : bool
        Loops in place of repeated columns: less code, more instructions.
    q_interval : float
        Noise of states that keep their value waits and comes in after so long [s]; zero: at every step.
    costs : tuple of str
        What its calls cost on cores, in words for the reader of the code.
    """

    discrete: DiscreteModel
    form: str = Packed.NAME
    real: str = "float"
    loops: bool = False
    q_interval: float = 0.0
    costs: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        d = self.discrete
        for option, value, known in (("--form", self.form, FORMS), ("--real", self.real, REALS)):
            if value not in known:
                raise InputError(
                    f"there is no '{value}'", where=option, remedy=f"Known are {', '.join(known)}"
                )
        if not 0.0 <= self.q_interval < float("inf") or (
            self.q_interval and not FORMS[self.form].HAS_Q_INTERVAL
        ):
            raise InputError(
                f"noise cannot wait for {self.q_interval:g} s with --form {self.form}",
                where="--q-interval",
                remedy="Give zero or more seconds, with --form ud",
            )
        if self.q_interval * d.rate > MAX_WAITING_PREDICTIONS:
            raise InputError(
                f"noise that waits for {self.q_interval:g} s misses {self.q_interval * d.rate:.6g} predictions",
                where="--q-interval",
                remedy=f"Give {MAX_WAITING_PREDICTIONS / d.rate:g} s or less, {MAX_WAITING_PREDICTIONS} predictions",
            )
        if d.rate * d.max_step < 1.0:
            raise InputError(
                f"the period of {d.rate:g} Hz is longer than the longest step of {d.max_step:g} s",
                remedy="Give a longer --max-step, or a higher --rate",
            )
        check_names(d)

    @cached_property
    def covariance(self) -> CovarianceForm:
        """How the covariance is stored and worked on."""
        rows, _ = self._transition
        names = tuple(s.name for s in self.discrete.model.states)
        Phi = {i: tuple(row) for i, row in rows.items()}
        return FORMS[self.form](self.n, Phi, names, self.loops, self._slow, self.q_interval)

    @cached_property
    def _slow(self) -> dict[int, float]:
        """States that keep their value under white noise alone, with its density, where it may wait."""
        rows, noise = self._transition
        mixed = {i for i, j in noise if i != j} | {j for i, j in noise if i != j}
        still = {i: q / DT for (i, j), q in noise.items() if i == j and i not in rows and i not in mixed}
        return {i: float(q) for i, q in still.items() if self.q_interval > 0.0 and q.is_number}

    @property
    def settling(self) -> int:
        """Predictions until noise that waits has come in; zero where none waits."""
        return ceil(self.q_interval * self.discrete.rate) if self._slow else 0

    @property
    def type(self) -> type[np.floating[Any]]:
        """Numpy's type of every number."""
        return REALS[self.real]

    @cached_property
    def arrays(self) -> dict[str, tuple[int, str]]:
        """The filter's memory in order: size and meaning of each array."""
        return {
            "x": (len(self.discrete.nominal_names), "state"),
            self.covariance.ARRAY: (self.covariance.size, self.covariance.TITLE),
            "k": (len(self.constants), "constants"),
            "innovation": (self.rows, "of the last update, by row"),
            "variance": (self.rows, "of the last innovations"),
            NIS.name: (1, "sum of squared innovations over their variances, of the rows that were fused"),
            HELD: (self.n, "1 for a state that is considered and not corrected, else 0"),
            ANY_HELD.name: (1, "how many there are"),
            **self.covariance.memory,
            HEALTH.name: (1, "smallest pivot of the covariance over its variance, of the last check"),
        }

    @property
    def name(self) -> str:
        """The model's name as an identifier."""
        return identifier(self.discrete.model.name)

    @property
    def n(self) -> int:
        """Error states."""
        return len(self.discrete.model.states)

    @property
    def constants(self) -> tuple[Constant, ...]:
        """The numbers that firmware may set, the gate last."""
        return (*self.discrete.model.constants, GATE)

    @property
    def rows(self) -> int:
        """Rows of the largest sensor."""
        return max(len(s.channels) for s in self.discrete.model.sensors)

    def lowering(self, prefix: str = "") -> Lowering:
        """A lowering of the filter's expressions."""
        return lowering(self.discrete, self.constants, prefix)

    @cached_property
    def atoms(self) -> Atoms:
        """The atoms of its expressions."""
        return Atoms(self.discrete)

    def drivers(self, used: Sequence[sp.Expr]) -> tuple[Argument, ...]:
        """The drivers of effects that expressions need, as arguments."""
        symbols = {s.name for e in used for s in e.free_symbols}
        return tuple(
            Argument(argument(d), 0, driver_text(d)) for d in self.discrete.model.drivers if d in symbols
        )

    def _inputs(self) -> tuple[Argument, ...]:
        return tuple(
            Argument(argument(i.name), 0, f"{i.title} [{i.unit}]")
            if i.scalar
            else Argument(argument(i.name), len(i.channels), f"{i.title} [{i.unit}], body axes")
            for i in self.discrete.model.motion.inputs
        )

    def sample_arguments(self, used: Sequence[sp.Expr]) -> tuple[Argument, ...]:
        """The inputs and drivers that a measurement needs at its own time."""
        symbols = {s.name for e in used for s in e.free_symbols}
        pairs = zip(self.discrete.model.motion.inputs, self._inputs())
        return (*(a for i, a in pairs if symbols & set(i.channels)), *self.drivers(used))

    def motion_arguments(self, used: Sequence[sp.Expr]) -> tuple[Argument, ...]:
        """Inputs, drivers and step as arguments."""
        return (*self._inputs(), *self.drivers(used), Argument("dt", 0, "step [s]"))

    @cached_property
    def _transition(self) -> tuple[Rows, dict[tuple[int, int], sp.Expr]]:
        return transition(self.discrete, self.atoms)

    def normalised(self, values: list[Expr], lower: Lowering) -> list[Stmt]:
        """Store the new state, its quaternion scaled to unit length.

        Parameters
        ----------
        values : list of Expr
            Of the stored state, in order.
        lower : Lowering
            Names the locals.
        """
        quaternion = self.discrete.model.attitude.nominal_names if self.discrete.model.attitude else ()
        body: list[Stmt] = []
        locals_: list[Expr] = []
        for value in values:
            atom, statements = lower.let(value, "n")
            if isinstance(atom, Ref) and atom.name == "x":
                name = lower.fresh("n")
                atom, statements = Ref(name), [Let(name, atom)]
            locals_.append(atom)
            body += statements
        where = [i for i, n in enumerate(self.discrete.nominal_names) if n in quaternion]
        if where:
            q = sp.symbols(f"__n0:{len(where)}")
            inner = Lowering({s.name: Ref(f"q{i}") for i, s in enumerate(q)})
            body += [Let(f"q{i}", locals_[k]) for i, k in enumerate(where)]
            (scale,), _ = inner.many([1 / sp.sqrt(sum(s * s for s in q))])
            body.append(Let("q_scale", scale))
            for i, k in enumerate(where):
                locals_[k] = mul(Ref(f"q{i}"), Ref("q_scale"))
        return [*body, *(Store(Ref("x", i), v) for i, v in enumerate(locals_) if v != Ref("x", i))]

    @cached_property
    def predict(self) -> Routine:
        """State and covariance over one step."""
        rows, noise = self._transition
        noise = {key: q for key, q in noise.items() if key[0] not in self._slow}
        lower = self.lowering()
        flat = [e for row in rows.values() for e in row.values()] + list(noise.values())
        used = [*flat, *(self.atoms.of_corrected_inputs(e) for e in self.discrete.step)]
        body = self.atoms.make(lower, used)
        values, statements = lower.many(used)
        body += statements
        entries: list[Expr] = []
        for value in values[: len(flat)]:
            atom, made = lower.let(value, "f")
            entries.append(atom)
            body += made
        stream = iter(entries)
        Phi: dict[int, Row] = {i: {j: next(stream) for j in row} for i, row in rows.items()}
        Qd = {key: next(stream) for key in noise}
        body += [Note("state"), *self.normalised(values[len(flat) :], lower)]
        body += self.covariance.predict(Phi, Qd)
        arguments = self.motion_arguments([e for row in self._raw for e in row])
        longest = Num(self.discrete.max_step)
        known = self._known(arguments[:-1], tuple(body))
        guarded = When(Compare("<=", Ref("dt"), longest), known, (StatusFlag("BAD_STEP"),))
        outer = When(Compare(">", Ref("dt"), Num(0.0)), (guarded,), (StatusFlag("BAD_STEP"),))
        return Routine(
            "predict",
            "State and covariance over one step.",
            arguments,
            tidy((outer,)),
            self.covariance.predict_scratch,
        )

    @property
    def _raw(self) -> tuple[Sequence[sp.Expr], ...]:
        return (list(self.discrete.Phi), list(self.discrete.Qd), self.discrete.step)

    def _known(self, arguments: Sequence[Argument], body: tuple[Stmt, ...]) -> tuple[Stmt, ...]:
        """The body, where every argument is a number: their squares add up to one."""
        given = [Ref(a.name, k) if a.size else Ref(a.name) for a in arguments for k in range(max(a.size, 1))]
        if not given:
            return body
        squares = reduce(add, (mul(g, g) for g in given))
        return (When(Compare("<=", squares, Num(MAX_INPUT_SQUARE_SUM)), body, (StatusFlag("BAD_INPUT"),)),)

    def update(self, sensor: Sensor) -> Routine:
        """Fuse one measurement of a sensor, scalar by scalar.

        Raises
        ------
        InputError
            A row of it depends on no state.
        """
        model = self.discrete.model
        h, H = self.discrete.expected(sensor), self.discrete.H(sensor)
        lower = self.lowering()
        used = [*h, *H]
        body = self.atoms.make(lower, used)
        entries = [(i, j) for i in range(H.rows) for j in range(self.n) if H[i, j] != 0]
        blind = [c for i, c in enumerate(sensor.channels) if not any(k == i for k, _ in entries)]
        if blind:
            raise InputError(
                f"the measurement {blind[0]} depends on no state, so it can correct none",
                where=model.name,
                remedy="Leave it out, or write its expression in states",
            )
        values, statements = lower.many([*h, *(H[i, j] for i, j in entries)])
        body += statements
        rows: list[Row] = [{} for _ in range(H.rows)]
        for (i, j), value in zip(entries, values[H.rows :]):
            rows[i][j], made = lower.let(value, "h")
            body += made
        residuals: list[Expr] = []
        for i in range(H.rows):
            residual, made = lower.let(sub(Ref("z", i), values[i]), "r")
            body += made
            if sensor.period:
                turns = mul(Una("rint", mul(residual, Num(1.0 / sensor.period))), Num(sensor.period))
                residual, made = lower.let(sub(residual, turns), "r")
                body += made
            residuals.append(residual)
        body.append(Store(NIS, Num(0.0)))
        for i, channel in enumerate(sensor.channels):
            R = self.discrete.measurement_variance(sensor, channel)
            body.append(Note(channel))
            body += fused(self.covariance, i, rows[i], residuals[i], R, lower.places["gate"])
        body.append(When(Compare(">", Ref("fused", 0), Num(0.0)), tuple(self.inject())))
        arguments = (
            Argument(
                "z", len(sensor.channels), f"{sensor.title} [{sensor.unit}]: " + ", ".join(sensor.channels)
            ),
            *self.sample_arguments(used),
        )
        return Routine(
            f"update_{sensor.name}",
            f"Fuse one sample: {sensor.title}.",
            arguments,
            tidy(self._known(arguments, tuple(body))),
            (Scratch("dx", self.n), Scratch("fused", 1), *self.covariance.scratch),
        )

    def inject(self) -> list[Stmt]:
        """The correction ``dx`` moves into the state."""
        model = self.discrete.model
        lower = self.lowering("c")
        lower.places |= {s.error.name: Ref("dx", i) for i, s in enumerate(model.states)}
        values, body = lower.many(list(model.corrected))
        return [Note("correct the state"), *body, *self.normalised(values, lower)]

    @cached_property
    def init(self) -> Routine:
        """State, covariance and constants before the first measurement."""
        body: list[Stmt] = [Store(Ref("x", i), Num(v)) for i, v in enumerate(self.discrete.start)]
        body += self.covariance.init([s.prior for s in self.discrete.model.states])
        body += [Store(Ref("k", i), Num(c.value)) for i, c in enumerate(self.constants)]
        done = {"x", "k", self.covariance.ARRAY}
        for name, (size, _) in self.arrays.items():
            if name not in done:
                body += [Store(Ref(name, i), Num(0.0)) for i in range(size)]
        return Routine(
            "init", "State, covariance and constants before the first measurement.", (), tuple(body)
        )

    @cached_property
    def routines(self) -> tuple[Routine, ...]:
        """The whole filter."""
        updates = tuple(self.update(s) for s in self.discrete.model.sensors)
        return (self.init, self.predict, *updates)

    @property
    def entries(self) -> tuple[Routine, ...]:
        """What a user can call."""
        return (*self.routines, self.covariance.health)

    @property
    def word_count(self) -> int:
        """Numbers of state and covariance."""
        return len(self.discrete.nominal_names) + self.covariance.size

    @cached_property
    def helpers(self) -> tuple[Routine, ...]:
        """What the routines call, and the check of the covariance."""
        return (*self.covariance.internals, self.covariance.health)

    @cached_property
    def pieces(self) -> tuple[Routine, ...]:
        """The parts of a filter whose matrices belong to the target."""
        from kfgen.emit.pieces import pieces

        return pieces(self)
