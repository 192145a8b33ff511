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

from kfgen.emit.align import Alignment
from kfgen.emit.covariance.factored import Factored
from kfgen.emit.covariance.forms import ANY_HELD, HEALTH, HELD, CovarianceForm, Packed
from kfgen.emit.covariance.joint import NIS
from kfgen.emit.gather import gather, gathered_inputs
from kfgen.emit.gather import memory as gathering
from kfgen.emit.geodetic.origin import Border, bordered, recentre
from kfgen.emit.guards import finite
from kfgen.emit.horizon.memory import SETTINGS as HORIZON_SETTINGS
from kfgen.emit.horizon.memory import HorizonMemory
from kfgen.emit.ir.ir import (
    Argument,
    Expr,
    Num,
    Routine,
    StatusFlag,
    Stmt,
    When,
)
from kfgen.emit.ir.lower import Lowering
from kfgen.emit.ir.symbols import Atoms, Rows, lowering, transition
from kfgen.emit.moving.places import moving_places
from kfgen.emit.settings import MAX_OTHER, gates, settings
from kfgen.emit.state import init
from kfgen.emit.targets.names import argument, identifier
from kfgen.emit.targets.words import driver_text
from kfgen.emit.watch import biases, lanes
from kfgen.emit.watch.parts import BIASES, REST
from kfgen.emit.watch.rest import PLACES as REST_PLACES
from kfgen.emit.watch.rest import SETTINGS as REST_SETTINGS
from kfgen.emit.watch.rest import resting
from kfgen.emit.watch.supervisor import ARRAY as SUPERVISOR
from kfgen.emit.watch.supervisor import Supervisor
from kfgen.model.discretise import DiscreteModel
from kfgen.model.parts.constant import Constant
from kfgen.model.parts.sensors import Sensor
from kfgen.model.register import DT

FORMS: dict[str, type[CovarianceForm]] = {f.NAME: f for f in (Packed, Factored)}
REALS: dict[str, type[np.floating[Any]]] = {"float": np.float32, "double": np.float64}

MAX_WAITING_PREDICTIONS = 2000
"""Predictions for which noise may wait: the proof runs twice as many."""
USUAL_Q_INTERVAL = 1.0
"""For how long the noise of biases waits [s]: in a second a usual walk is a thousandth of a turn-on bias."""


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
    q_interval : float, optional
        Noise of states that keep their value waits and comes in after so long [s]; zero: at every step. By default
        `USUAL_Q_INTERVAL` where the form lets it wait.
    costs : tuple of str
        What its calls cost on cores, in words for the reader of the code.
    horizon : float
        Age up to which measurements are fused at their own times [s]; zero: there is no delayed horizon.
    without : tuple of str
        Parts of the supervisor that are left out, of `kfgen.emit.watch.parts.PARTS`.
    lanes : bool
        With hooks for firmware that has several filters.
    """

    discrete: DiscreteModel
    form: str = Packed.NAME
    real: str = "float"
    loops: bool = False
    q_interval: float | None = None
    costs: tuple[str, ...] = ()
    horizon: float = 0.0
    without: tuple[str, ...] = ()
    lanes: bool = False

    def __post_init__(self) -> None:
        from kfgen.emit.choices import check_choices

        check_choices(self, FORMS, REALS)

    @cached_property
    def covariance(self) -> CovarianceForm:
        """How the covariance is stored and worked on."""
        rows, noise = self.transition
        names = tuple(s.name for s in self.discrete.model.states)
        Phi = {i: tuple(row) for i, row in rows.items()}
        driven = tuple(i for i, j in noise if i == j)
        form = FORMS[self.form]
        return form(self.n, Phi, names, self.loops, self.slow, self.noise_waits, driven)

    @property
    def noise_waits(self) -> float:
        """For how long noise of states that keep their value waits [s]; zero: it does not."""
        if self.q_interval is not None:
            return self.q_interval
        usual = min(USUAL_Q_INTERVAL, MAX_WAITING_PREDICTIONS / self.discrete.rate)
        return usual if FORMS[self.form].HAS_Q_INTERVAL else 0.0

    @cached_property
    def slow(self) -> dict[int, Expr]:
        """Biases that walk, with the density of their noise, where it waits; what comes in at once moves nothing else."""
        Qd = self.discrete.named_noise[0]
        waits = {i: Qd[i, i] / DT for i in range(self.n) if Qd[i, i] / DT in self._waiting}
        return dict(zip(waits, self.lowering().many(list(waits.values()))[0]))

    @cached_property
    def _waiting(self) -> frozenset[sp.Symbol]:
        """Densities of the noise that waits."""
        walks = self.discrete.named_walks.values() if self.noise_waits > 0.0 else ()
        return frozenset(symbol for symbol, _ in walks)

    @property
    def settling(self) -> int:
        """Predictions until noise that waits has come in; zero where none waits."""
        return ceil(self.noise_waits * self.discrete.rate) + len(self.slow) if self.slow else 0

    @property
    def type(self) -> type[np.floating[Any]]:
        """Numpy's type of every number."""
        return REALS[self.real]

    @cached_property
    def delayed_memory(self) -> HorizonMemory:
        """The layout of the delayed horizon."""
        return HorizonMemory(self)

    @cached_property
    def arrays(self) -> dict[str, tuple[int, str]]:
        """The filter's memory in order: size and meaning of each array."""
        return {
            "x": (len(self.discrete.nominal_names), "state"),
            self.covariance.ARRAY: (self.covariance.size, self.covariance.TITLE),
            SUPERVISOR: (len(self.supervisor.places), "ages, rejections and resets, see the places below"),
            **gathering(self.discrete.model),
            **(self.delayed_memory.arrays if self.horizon else {}),
            "k": (len(self.constants), "constants"),
            "innovation": (self.rows, "of the last update, by row"),
            "variance": (self.rows, "of the last innovations"),
            NIS.name: (1, "squared innovation of the last sample over its covariance, all rows together"),
            HELD: (self.n, "1 for a state that is considered and not corrected, else 0"),
            ANY_HELD.name: (1, "how many there are"),
            **self.covariance.memory,
            HEALTH.name: (1, "smallest pivot of the covariance over its variance, of the last check"),
            **(self.delayed_memory.waiting if self.horizon else {}),
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
        """The numbers that may change in flight, the gates of the sensors last."""
        return (*self.discrete.model.constants, *gates(self.discrete.model))

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
    def transition(self) -> tuple[Rows, dict[tuple[int, int], sp.Expr]]:
        """Rows of Phi that differ from the identity's, and the upper non-zeros of Qd but for what waits."""
        return transition(self.discrete, self.atoms, self._waiting)

    @cached_property
    def predict(self) -> Routine:
        """State and covariance over one step."""
        from kfgen.emit.predict import predict

        return predict(self)

    @cached_property
    def settings(self) -> dict[str, Constant]:
        """What firmware may set before it compiles, by name."""
        own = (*(HORIZON_SETTINGS if self.horizon else ()), *(REST_SETTINGS if self.resting else ()))
        bounds = biases.constants(self.discrete.model) if self.bounds_biases else ()
        return settings(self.discrete) | {c.name: c for c in (*own, *bounds)}

    @property
    def bounds_biases(self) -> bool:
        """Whether biases are held at bounds."""
        return BIASES not in self.without

    @cached_property
    def resting(self) -> Sensor | None:
        """What is given v = 0 where the body is found at rest; None where that is left out or cannot be found."""
        return None if REST in self.without else resting(self.discrete.model)

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
        rows = {s.name: len(s.channels) for s in model.sensors}
        rest = REST_PLACES if self.resting else ()
        held = biases.places(model) if self.bounds_biases else ()
        jumps = lanes.places(model) if self.lanes else ()
        others = (*Alignment(model).places, *moving_places(model), *rest, *held, *jumps)
        return Supervisor(rows, tuple(triads), self.settings, others)

    def update(self, sensor: Sensor) -> Routine:
        """Fuse one sample of a sensor; raises as `kfgen.emit.update.update`."""
        from kfgen.emit.update import update

        return update(self, sensor)

    def covariance_guard(self) -> list[Stmt]:
        """A covariance that is no longer finite is said, and goes back to the priors."""
        lost = (StatusFlag("NOT_FINITE"), *self.supervisor.widen())
        total, is_finite = finite(self.covariance.diagonal, "sum_P")
        return [total, When(is_finite, (), lost)]

    @cached_property
    def init(self) -> Routine:
        """State, covariance and constants before the first measurement."""
        return init(self)

    @cached_property
    def routines(self) -> tuple[Routine, ...]:
        """The whole filter."""
        updates = tuple(self.update(s) for s in self.discrete.model.sensors)
        return (self.init, self.predict, *updates)

    @property
    def entries(self) -> tuple[Routine, ...]:
        """What a user can call."""
        return (*self.routines, *self._beside)

    @property
    def _beside(self) -> tuple[Routine, ...]:
        """What stands beside prediction and updates; one that calls another follows it."""
        from kfgen.emit.watch.rest_routine import detect_rest

        start = (*self.align, *self.moving, *self.gather, *detect_rest(self))
        return (
            *start,
            *self.delayed,
            *self.recentre,
            self.check,
            self.supervisor.condition,
            *lanes.routines(self),
        )

    @property
    def varied(self) -> tuple[str, ...]:
        """The routines that take variances."""
        return tuple(r.name for r in (*self.routines, *self.delayed) if r.arguments != r.required)

    @property
    def word_count(self) -> int:
        """Numbers of state, covariance and supervisor."""
        return sum(self.arrays[name][0] for name in self.compared)

    @property
    def compared(self) -> tuple[str, ...]:
        """The arrays that a proof compares, the first of the filter's memory."""
        own = (*gathering(self.discrete.model), *(self.delayed_memory.arrays if self.horizon else ()))
        return ("x", self.covariance.ARRAY, SUPERVISOR, *own)

    @cached_property
    def helpers(self) -> tuple[Routine, ...]:
        """What the routines call, and what looks at the whole filter."""
        from kfgen.emit.check import widen

        return (*self.covariance.internals, widen(self), *lanes.internals(self), *self._beside)

    @cached_property
    def align(self) -> tuple[Routine, ...]:
        """The first attitude, where there is one to be found."""
        from kfgen.emit.align_routine import AlignRoutine

        return (AlignRoutine(self).routine(),) if Alignment(self.discrete.model).possible else ()

    @cached_property
    def moving(self) -> tuple[Routine, ...]:
        """The first attitude in motion, where there is one to be found."""
        from kfgen.emit.moving.moving import moving

        return moving(self)

    @cached_property
    def gather(self) -> tuple[Routine, ...]:
        """The increments of a prediction, where the filter takes them."""
        return (gather(self),) if gathered_inputs(self.discrete.model) else ()

    @cached_property
    def delayed(self) -> tuple[Routine, ...]:
        """The delayed horizon, where there is one."""
        from kfgen.emit.horizon.delayed import delayed

        return delayed(self)

    @cached_property
    def border(self) -> Border | None:
        """Its latitude, longitude and height, where it has a place."""
        return Border(self) if bordered(self) else None

    @cached_property
    def recentre(self) -> tuple[Routine, ...]:
        """What moves its origin, where it has a place."""
        return (recentre(self),) if self.border else ()

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
