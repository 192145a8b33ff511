"""The routines of a filter in the intermediate form, from its discrete model.

Two families from the same expressions: the whole filter on packed arrays (``init``, ``predict``,
``update_<sensor>``), for C and its float32 reference; and its pieces (``step``, ``transition``,
``noise``, ``expect_<sensor>``, ``inject``), for a target that has matrices of its own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from math import ceil
from typing import Any

import numpy as np
import sympy as sp

from kfgen.core.errors import InputError
from kfgen.emit.covariance.factored import Factored
from kfgen.emit.covariance.forms import ANY_HELD, HEALTH, HELD, CovarianceForm, Packed
from kfgen.emit.covariance.joint import NIS
from kfgen.emit.covariance.packed import Row
from kfgen.emit.guards import every, finite, within
from kfgen.emit.ir.ir import (
    All,
    Argument,
    Compare,
    Expr,
    Let,
    Note,
    Num,
    Ref,
    Routine,
    StatusFlag,
    Stmt,
    Store,
    When,
    mul,
)
from kfgen.emit.ir.lower import Lowering
from kfgen.emit.ir.symbols import Atoms, Rows, lowering, transition
from kfgen.emit.ir.tidy import tidy
from kfgen.emit.settings import MAX_OTHER, settings
from kfgen.emit.supervisor import ARRAY as SUPERVISOR
from kfgen.emit.supervisor import Supervisor
from kfgen.emit.targets.names import argument, check_names, identifier
from kfgen.emit.targets.words import driver_text
from kfgen.model.discretise import DiscreteModel
from kfgen.model.parts.constant import Constant
from kfgen.model.parts.sensors import Sensor
from kfgen.model.register import DT

GATE = Constant("gate", "1", 100.0, "gate: largest squared innovation over its variance")
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
        values = dict(self.discrete.named_noise[1].values())
        plain = {i: q.xreplace(values) for i, q in still.items()}
        return {i: float(q) for i, q in plain.items() if self.q_interval > 0.0 and q.is_number}

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
            SUPERVISOR: (len(self.supervisor.places), "ages, rejections and resets, see the places below"),
            "k": (len(self.constants), "constants"),
            "innovation": (self.rows, "of the last update, by row"),
            "variance": (self.rows, "of the last innovations"),
            NIS.name: (1, "squared innovation of the last sample over its covariance, all rows together"),
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

    def normalised(
        self, values: list[Expr], lower: Lowering, guarded: bool = False, then: Sequence[Stmt] = ()
    ) -> list[Stmt]:
        """Store the new state, its quaternion scaled to unit length.

        Parameters
        ----------
        values : list of Expr
            Of the stored state, in order.
        lower : Lowering
            Names the locals.
        guarded : bool
            Only where the new state is finite; else the old one stays, and the status says so.
        then : sequence of Stmt
            What follows, under the same guard.
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
        stores = [Store(Ref("x", i), v) for i, v in enumerate(locals_) if v != Ref("x", i)]
        if not guarded or not locals_:
            return [*body, *stores, *then]
        return [*body, When(finite(locals_), (*stores, *then), (StatusFlag("NOT_FINITE"),))]

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
        then = [*self.covariance.predict(Phi, Qd), *self.covariance_guard()]
        body += [Note("state"), *self.normalised(values[len(flat) :], lower, True, then)]
        arguments = self.motion_arguments([e for row in self._raw for e in row])
        body = [*self.supervisor.resynchronise(), *self.supervisor.changed(), *body]
        looked = [c for a in arguments[:-1] for c in within(a, self.input_limit(a.name))]
        refused = (StatusFlag("BAD_INPUT"), *self.supervisor.missed())
        known = (When(every(looked), tuple(body), refused),) if looked else tuple(body)
        step = All((Compare(">", Ref("dt"), Num(0.0)), Compare("<=", Ref("dt"), Num(self.discrete.max_step))))
        outer = When(step, (*self.supervisor.elapsed(), *known), (StatusFlag("BAD_STEP"),))
        return Routine(
            "predict",
            "State and covariance over one step.",
            arguments,
            tidy((outer,)),
            self.covariance.predict_scratch,
        )

    @property
    def _raw(self) -> tuple[Sequence[sp.Expr], ...]:
        return (list(self.discrete.Phi), list(self.discrete.named_noise[0]), self.discrete.step)

    @cached_property
    def settings(self) -> dict[str, Constant]:
        """What firmware may set before it compiles, by name."""
        return settings(self.discrete)

    def setting(self, name: str) -> Num:
        """A setting as a number of the emitted code."""
        return Num(self.settings[name].value, name)

    def prior(self, state: int) -> Num:
        """The prior standard deviation of an error state."""
        return self.setting(f"PRIOR_{identifier(self.discrete.model.states[state].name).upper()}")

    def input_limit(self, name: str) -> Num:
        """The largest magnitude of an input; of a driver, of which no range is known, that of any number."""
        by_argument = {argument(i.name): i.name for i in self.discrete.model.motion.inputs}
        if name not in by_argument:
            return Num(MAX_OTHER)
        return self.setting(f"MAX_{identifier(by_argument[name]).upper()}")

    @cached_property
    def supervisor(self) -> Supervisor:
        """What watches over the filter."""
        model = self.discrete.model
        triads = (argument(i.name) for i in model.motion.inputs if i.N > 0.0 and not (i.scalar or i.quiet))
        return Supervisor({s.name: len(s.channels) for s in model.sensors}, tuple(triads), self.settings)

    def update(self, sensor: Sensor) -> Routine:
        """Fuse one sample of a sensor; raises as `kfgen.emit.update.update`."""
        from kfgen.emit.update import update

        return update(self, sensor)

    def inject(self, guarded: bool = False) -> list[Stmt]:
        """The correction ``dx`` moves into the state; where that is guarded, only if the new one is finite."""
        model = self.discrete.model
        lower = self.lowering("c")
        lower.places |= {s.error.name: Ref("dx", i) for i, s in enumerate(model.states)}
        values, body = lower.many(list(model.corrected))
        return [Note("correct the state"), *body, *self.normalised(values, lower, guarded)]

    def covariance_guard(self) -> list[Stmt]:
        """A covariance that is no longer finite is said, and goes back to the priors."""
        lost = (StatusFlag("NOT_FINITE"), *self.supervisor.widen())
        return [When(finite(self.covariance.diagonal), (), lost)]

    @cached_property
    def init(self) -> Routine:
        """State, covariance and constants before the first measurement."""
        body: list[Stmt] = [Store(Ref("x", i), Num(v)) for i, v in enumerate(self.discrete.start)]
        body += self.covariance.init([self.prior(i) for i in range(self.n)])
        body += [Store(Ref("k", i), Num(c.value)) for i, c in enumerate(self.constants)]
        body += [Store(Ref(SUPERVISOR, i), Num(v)) for i, v in enumerate(self.supervisor.start)]
        done = {"x", "k", self.covariance.ARRAY, SUPERVISOR}
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
        return (*self.routines, self.check, self.supervisor.condition)

    @property
    def word_count(self) -> int:
        """Numbers of state, covariance and supervisor."""
        return sum(self.arrays[name][0] for name in self.compared)

    @property
    def compared(self) -> tuple[str, ...]:
        """The arrays that a proof compares, the first of the filter's memory."""
        return ("x", self.covariance.ARRAY, SUPERVISOR)

    @cached_property
    def helpers(self) -> tuple[Routine, ...]:
        """What the routines call, and what looks at the whole filter."""
        from kfgen.emit.check import widen

        return (*self.covariance.internals, widen(self), self.check, self.supervisor.condition)

    @cached_property
    def check(self) -> Routine:
        """The health of the covariance, and whether the state is finite and its quaternion of unit length."""
        from kfgen.emit.check import check

        return check(self)

    @cached_property
    def pieces(self) -> tuple[Routine, ...]:
        """The parts of a filter whose matrices belong to the target."""
        from kfgen.emit.pieces import pieces

        return pieces(self)
