"""The routines of a filter in the intermediate form, from its discrete model.

Two families from the same expressions: the whole filter on packed arrays (``init``, ``predict``,
``update_<sensor>``), for C and its float32 reference; and its pieces (``step``, ``transition``,
``noise``, ``expect_<sensor>``, ``inject``), for a target that has matrices of its own.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import sympy as sp

from kfgen.discretise import DT, DiscreteModel
from kfgen.emit.covariance import Row, packed, packed_size, predict_covariance, update_scalar
from kfgen.emit.ir import (
    Argument,
    Compare,
    Expr,
    Flag,
    Let,
    Note,
    Num,
    Ref,
    Routine,
    Scratch,
    Stmt,
    Store,
    Una,
    When,
    mul,
    sub,
)
from kfgen.emit.lower import Lowering
from kfgen.errors import InputError
from kfgen.model.motion import Constant
from kfgen.model.rotation import matrix_of
from kfgen.model.sensors import Sensor

GATE = Constant("gate", "1", 100.0, "gate: largest squared innovation over its variance")


@dataclass(frozen=True)
class Program:
    """A discrete model as code: what every target needs to know.

    Parameters
    ----------
    discrete : DiscreteModel
    """

    discrete: DiscreteModel

    def __post_init__(self) -> None:
        d = self.discrete
        if d.rate * d.max_step < 1.0:
            raise InputError(
                f"the period of {d.rate:g} Hz is longer than the longest step of {d.max_step:g} s",
                remedy="Give a longer --max-step, or a higher --rate",
            )

    @property
    def name(self) -> str:
        """The model's name as an identifier."""
        return re.sub(r"\W", "_", self.discrete.model.name)

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

    def _lowering(self, prefix: str = "") -> Lowering:
        places = {name: Ref("x", i) for i, name in enumerate(self.discrete.nominal_names)}
        places |= {c.name: Ref("k", i) for i, c in enumerate(self.constants)}
        places |= {
            c: Ref(i.name) if i.scalar else Ref(i.name, k)
            for i in self.discrete.model.motion.inputs
            for k, c in enumerate(i.channels)
        }
        places |= {d: Ref(d) for d in self.discrete.model.drivers}
        return Lowering(places | {str(DT): Ref("dt")}, prefix)

    def _rotation(self, lower: Lowering, used: Sequence[sp.Expr]) -> list[Stmt]:
        """The entries of the rotation matrix that `used` needs, from the quaternion."""
        attitude = self.discrete.model.attitude
        if attitude is None:
            return []
        symbols = set().union(*(e.free_symbols for e in used)) if used else set()
        wanted = [(s, e) for s, e in zip(attitude.nominal, matrix_of(attitude.quaternion)) if s in symbols]
        values, body = lower.many([e for _, e in wanted])
        for (symbol, _), value in zip(wanted, values):
            body.append(Let(symbol.name, value))
            lower.places[symbol.name] = Ref(symbol.name)
        return body

    def _inputs(self) -> tuple[Argument, ...]:
        return tuple(
            Argument(i.name, 0, f"{i.title} [{i.unit}]")
            if i.scalar
            else Argument(i.name, len(i.channels), f"{i.title} [{i.unit}], body axes")
            for i in self.discrete.model.motion.inputs
        )

    def _drivers(self, used: Sequence[sp.Expr]) -> tuple[Argument, ...]:
        symbols = {s.name for e in used for s in e.free_symbols}
        return tuple(Argument(d, 0, f"{d} [K]") for d in self.discrete.model.drivers if d in symbols)

    def _sample_arguments(self, used: Sequence[sp.Expr]) -> tuple[Argument, ...]:
        """The inputs and drivers that a measurement needs at its own time."""
        symbols = {s.name for e in used for s in e.free_symbols}
        pairs = zip(self.discrete.model.motion.inputs, self._inputs())
        return (*(a for i, a in pairs if symbols & set(i.channels)), *self._drivers(used))

    def _motion_arguments(self, used: Sequence[sp.Expr]) -> tuple[Argument, ...]:
        return (*self._inputs(), *self._drivers(used), Argument("dt", 0, "step [s]"))

    @cached_property
    def _transition(self) -> tuple[dict[int, dict[int, sp.Expr]], dict[tuple[int, int], sp.Expr]]:
        """Rows of Phi that differ from the identity's, and the upper non-zeros of Qd."""
        Phi, Qd, n = self.discrete.Phi, self.discrete.Qd, self.n
        rows = {i: {j: Phi[i, j] for j in range(n) if Phi[i, j] != 0} for i in range(n)}
        moving = {i: row for i, row in rows.items() if row != {i: 1}}
        return moving, {(i, j): Qd[i, j] for i in range(n) for j in range(i, n) if Qd[i, j] != 0}

    def _normalised(self, values: list[Expr], lower: Lowering) -> list[Stmt]:
        """Store the new state, its quaternion scaled to unit length."""
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
            body.append(Let("q_scale", inner.expression(1 / sp.sqrt(sum(s * s for s in q)))))
            for i, k in enumerate(where):
                locals_[k] = mul(Ref(f"q{i}"), Ref("q_scale"))
        return [*body, *(Store(Ref("x", i), v) for i, v in enumerate(locals_) if v != Ref("x", i))]

    @cached_property
    def predict(self) -> Routine:
        """State and covariance over one step."""
        rows, noise = self._transition
        lower = self._lowering()
        flat = [e for row in rows.values() for e in row.values()] + list(noise.values())
        used = [*flat, *self.discrete.step]
        body = self._rotation(lower, used)
        values, statements = lower.many(used)
        body += statements
        atoms: list[Expr] = []
        for value in values[: len(flat)]:
            atom, made = lower.let(value, "f")
            atoms.append(atom)
            body += made
        stream = iter(atoms)
        Phi: dict[int, Row] = {i: {j: next(stream) for j in row} for i, row in rows.items()}
        Qd = {key: next(stream) for key in noise}
        body += predict_covariance(self.n, Phi, Qd, [s.name for s in self.discrete.model.states])
        body.append(Note("state"))
        body += self._normalised(values[len(flat) :], lower)
        longest = Num(self.discrete.max_step)
        guarded = When(Compare("<=", Ref("dt"), longest), tuple(body), (Flag("BAD_STEP"),))
        outer = When(Compare(">", Ref("dt"), Num(0.0)), (guarded,), (Flag("BAD_STEP"),))
        return Routine(
            "predict", "State and covariance over one step.", self._motion_arguments(used), (outer,)
        )

    def update(self, sensor: Sensor) -> Routine:
        """Fuse one measurement of a sensor, scalar by scalar."""
        model = self.discrete.model
        h, H = model.expected(sensor), model.H(sensor)
        lower = self._lowering()
        used = [*h, *H]
        body = self._rotation(lower, used)
        entries = [(i, j) for i in range(H.rows) for j in range(self.n) if H[i, j] != 0]
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
        for i, channel in enumerate(sensor.channels):
            variance = Num(self.discrete.measurement_variance(sensor, channel))
            body.append(Note(channel))
            body += update_scalar(lower, self.n, f"{i}", H=rows[i], residual=residuals[i], variance=variance)
        body.append(When(Compare(">", Ref("fused", 0), Num(0.0)), tuple(self._inject())))
        arguments = (
            Argument(
                "z", len(sensor.channels), f"{sensor.title} [{sensor.unit}]: " + ", ".join(sensor.channels)
            ),
            *self._sample_arguments(used),
        )
        return Routine(
            f"update_{sensor.name}",
            f"Fuse one sample: {sensor.title}.",
            arguments,
            tuple(body),
            (Scratch("dx", self.n), Scratch("fused", 1)),
        )

    def _inject(self) -> list[Stmt]:
        """The correction ``dx`` moves into the state."""
        model = self.discrete.model
        lower = self._lowering("c")
        lower.places |= {s.error.name: Ref("dx", i) for i, s in enumerate(model.states)}
        values, body = lower.many(list(model.corrected))
        return [Note("correct the state"), *body, *self._normalised(values, lower)]

    @cached_property
    def init(self) -> Routine:
        """State, covariance and constants before the first measurement."""
        body: list[Stmt] = [Store(Ref("x", i), Num(v)) for i, v in enumerate(self.discrete.start)]
        priors = {packed(self.n, i, i): s.prior**2 for i, s in enumerate(self.discrete.model.states)}
        body += [Store(Ref("P", i), Num(priors.get(Ref("P", i), 0.0))) for i in range(packed_size(self.n))]
        body += [Store(Ref("k", i), Num(c.value)) for i, c in enumerate(self.constants)]
        body += [Store(Ref(a, i), Num(0.0)) for a in ("innovation", "variance") for i in range(self.rows)]
        return Routine(
            "init", "State, covariance and constants before the first measurement.", (), tuple(body)
        )

    @cached_property
    def routines(self) -> tuple[Routine, ...]:
        """The whole filter."""
        updates = tuple(self.update(s) for s in self.discrete.model.sensors)
        return (self.init, self.predict, *updates)

    @cached_property
    def pieces(self) -> tuple[Routine, ...]:
        """The parts of a filter whose matrices belong to the target."""
        Phi, Qd, n = self.discrete.Phi, self.discrete.Qd, self.n
        transition = [
            (Ref("Phi", i * n + j), Phi[i, j]) for i in range(n) for j in range(n) if Phi[i, j] != 0
        ]
        noise = [(Ref("Qd", i * n + j), Qd[i, j]) for i in range(n) for j in range(n) if Qd[i, j] != 0]
        parts = [
            self._piece("transition", "Transition of the error.", transition),
            self._piece("noise", "Process noise of a step.", noise),
        ]
        for s in self.discrete.model.sensors:
            h, H = self.discrete.model.expected(s), self.discrete.model.H(s)
            stores = [(Ref("h", i), h[i]) for i in range(H.rows)]
            stores += [
                (Ref("H", i * n + j), H[i, j]) for i in range(H.rows) for j in range(n) if H[i, j] != 0
            ]
            arguments = self._sample_arguments([e for _, e in stores])
            parts.append(
                self._piece(
                    f"expect_{s.name}", f"Expected sample and Jacobian: {s.title}.", stores, arguments
                )
            )
        lower = self._lowering()
        body = self._rotation(lower, self.discrete.step)
        values, statements = lower.many(self.discrete.step)
        body += [*statements, *self._normalised(values, lower)]
        step = Routine(
            "step", "The stored state over one step.", self._motion_arguments(self.discrete.step), tuple(body)
        )
        inject = Routine(
            "inject",
            "The correction dx moves into the stored state.",
            (Argument("dx", n, "correction of the error state"),),
            tuple(self._inject()),
        )
        return (step, *parts, inject)

    def _piece(
        self,
        name: str,
        text: str,
        stores: list[tuple[Ref, sp.Expr]],
        arguments: tuple[Argument, ...] | None = None,
    ) -> Routine:
        used = [e for _, e in stores]
        lower = self._lowering()
        body = self._rotation(lower, used)
        values, statements = lower.many(used)
        body += [*statements, *(Store(ref, v) for (ref, _), v in zip(stores, values))]
        return Routine(
            name, text, self._motion_arguments(used) if arguments is None else arguments, tuple(body)
        )
