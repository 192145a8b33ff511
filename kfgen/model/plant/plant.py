"""`Plant`: a model file with effects in place, simulated over the times of a log.

The classical Runge-Kutta method with as many parts to a step as the fastest motion asks for; a whole batch of
parameter values is simulated at once.

References
----------
.. [1] E. Hairer, S. P. Nørsett, G. Wanner, Solving Ordinary Differential Equations I, 2nd ed., 1993, sec. II.1.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property

import numpy as np
import sympy as sp
from numpy.typing import NDArray

from kfgen.core.errors import InputError
from kfgen.core.expression import symbol
from kfgen.core.tape import Tape, tape
from kfgen.effects.plant.sensor import SensorChange
from kfgen.effects.plant.terms import InputChange, PlantEffect, StateTerm
from kfgen.model.plant.runaway import refuse
from kfgen.model.plant.runge_kutta import Steps, integrate
from kfgen.model.plant.signal import Signal
from kfgen.model.plant.user import UserModel

Array = NDArray[np.float64]

MOST = 256
"""Parts of a step at most."""
PHASE = 1e-5
"""Error of a phase over the whole record [rad] that a step may bring."""
TRANSIENT = 1e-3
"""Relative error of a transient that dies within few steps."""
STABLE = 2.0
"""Rate times step up to which the method is stable."""
MAX_NEED_RATIO = 4.0
"""How many times the parts that another column asks for are taken, or that are taken may be asked for."""
LOOKS = 40
"""Times at which the rates of a motion are looked at."""
MEMORY = 4_000_000
"""Numbers of the inputs that are held at once."""


@dataclass(frozen=True)
class Batch:
    """What is simulated at once.

    Parameters
    ----------
    parameters : mapping of str to ndarray, shape (batch,)
        SI.
    effects : tuple of (where, PlantEffect)
        With numbers of shape (batch,), in the order of the plant.
    initial : ndarray, shape (segments, states, batch)
        Where each segment of the record starts.
    before : mapping of str to ndarray, shape (batch,)
        By how much inputs were others before the record, see `Signal`.
    """

    parameters: Mapping[str, Array]
    effects: tuple[tuple[str, PlantEffect], ...]
    initial: Array
    before: Mapping[str, Array] = field(default_factory=dict)

    @property
    def size(self) -> int:
        """Columns."""
        return int(self.initial.shape[2])

    def before_of(self, name: str) -> Array:
        """By how much an input was another one before the record, shape (batch,)."""
        return np.broadcast_to(np.asarray(self.before.get(name, 0.0), dtype=np.float64), (self.size,))


@dataclass(frozen=True)
class Run:
    """A simulation: states, shape (n, states, batch), channels by name, each (n, batch), parts that a step needs."""

    states: Array
    channels: Mapping[str, Array]
    substeps: int


@dataclass(frozen=True)
class _Task:
    """One simulation: times, signals, numbers of the equations (batch,), segments."""

    t: Array
    signals: Sequence[Signal]
    given: Sequence[Array]
    batch: Batch
    starts: Sequence[int]


def stacked(effects: Sequence[PlantEffect]) -> PlantEffect:
    """Effects of one kind, each of one column or more, as one whose numbers have shape (batch,)."""
    values = {
        f.name: np.hstack([np.asarray(getattr(e, f.name), float) for e in effects])
        for f in fields(effects[0])
    }
    return replace(effects[0], **values)


class Plant:
    """The equations of a model with kinds of effects in place.

    Parameters
    ----------
    model : UserModel
    kinds : sequence of (where, class)
        Every effect inside the plant, the model's own among them.
    """

    def __init__(self, model: UserModel, kinds: Sequence[tuple[str, type[PlantEffect]]]) -> None:
        self.model = model
        self.kinds = tuple(kinds)
        self.states = tuple(model.states)
        self.inputs = tuple(model.inputs)

    @cached_property
    def _letters(self) -> list[list[sp.Symbol]]:
        """Symbols of the parameters of each effect."""
        return [
            [symbol(f"__{i}_{f.name}") for f in fields(cls)] if issubclass(cls, StateTerm) else []
            for i, (_, cls) in enumerate(self.kinds)
        ]

    @cached_property
    def _variables(self) -> list[sp.Symbol]:
        """States, inputs, parameters, numbers of the effects."""
        names = (*self.states, *self.inputs, *self.model.parameters)
        return [*map(symbol, names), *(s for letters in self._letters for s in letters)]

    @cached_property
    def rates(self) -> Tape:
        """The time derivatives of the states."""
        total = {n: e.value for n, e in self.model.dynamics.items()}
        for (where, cls), letters in zip(self.kinds, self._letters):
            if issubclass(cls, StateTerm):
                p = self.model.position_of(where)
                effect = cls(*letters)
                total[where] = total[where] + effect.term(symbol(where), symbol(p) if p else None)
        return tape([total[n] for n in self.states], self._variables)

    @cached_property
    def shows(self) -> Tape:
        """The values of the measurements."""
        return tape([m.expression.value for m in self.model.measurements.values()], self._variables)

    @cached_property
    def _shown_inputs(self) -> set[str]:
        """Inputs that a measurement shows at once."""
        found = {s for m in self.model.measurements.values() for s in m.expression.value.free_symbols}
        return {n for n in self.inputs if symbol(n) in found}

    def simulate(
        self,
        t: Array,
        inputs: Mapping[str, Array],
        batch: Batch,
        starts: Sequence[int] = (0,),
        substeps: int = 1,
        most: int = MOST,
    ) -> Run:
        """States and channels at every time.

        Parameters
        ----------
        t : ndarray, shape (n,)
            Times [s]; they may be uneven.
        inputs : mapping of str to ndarray, shape (n,)
            SI.
        batch : Batch
        starts : sequence of int
            The sample at which each segment starts.
        substeps : int
            Parts of a step to begin with; more are taken where the motion asks for them.
        most : int
            Parts of a step at most.

        Returns
        -------
        Run
            Not finite where the simulation diverges.
        """
        signals = [
            Signal.of(t, inputs[n], not n.startswith("ref_"), self._changes(batch, n), batch.before_of(n))
            for n in self.inputs
        ]
        task = _Task(t, signals, self.given(batch), batch, starts)
        with np.errstate(all="ignore"):
            X = self._states(task, substeps)
            needs = self._needs(task, X)
            for _ in range(4):
                if (wanted := min(_parts(needs), most)) <= substeps:
                    break
                substeps = wanted
                X = self._states(task, substeps)
                needs = self._needs(task, X)
            astray = needs > MAX_NEED_RATIO * max(substeps, wanted, float(needs.min(initial=np.inf)))
            X[:, :, astray] = np.nan
            return Run(X, self._channels(task, X), wanted)

    def _changes(self, batch: Batch, name: str) -> list[InputChange]:
        return [e for where, e in batch.effects if where == name and isinstance(e, InputChange)]

    def given(self, batch: Batch) -> list[Array]:
        """Parameters and numbers of the effects, in the order of the variables, each of shape (batch,)."""
        out = [batch.parameters[n] for n in self.model.parameters]
        for _, effect in batch.effects:
            if isinstance(effect, StateTerm):
                out += [np.asarray(getattr(effect, f.name), dtype=np.float64) for f in fields(effect)]
        return [np.broadcast_to(v, (batch.size,)) for v in out]

    def _states(self, task: _Task, substeps: int) -> Array:
        """The states, shape (n, states, batch), in chunks of the record."""
        n, k, size = task.t.size, len(self.states), task.batch.size
        X = np.zeros((n, k, size))
        if k == 0:
            return X
        chunk = max(1, MEMORY // max(1, len(task.signals) * 3 * substeps * size))
        begins = np.asarray(task.starts, dtype=np.int64)
        for a in range(0, max(n - 1, 1), chunk):
            b = min(a + chunk, n - 1)
            inside = (begins >= a) & (begins <= b)
            at, X0 = begins[inside] - a, task.batch.initial[inside]
            if a > 0 and not (at.size and at[0] == 0):
                at, X0 = np.insert(at, 0, 0), np.concatenate([X[a][None], X0])
            U = _common([s.nodes(a, b, substeps) for s in task.signals], b - a)
            steps = Steps(self.rates, task.given, U, np.diff(task.t[a : b + 1]), substeps)
            X[a : b + 1] = integrate(steps, at, X0)
        return X

    def _needs(self, task: _Task, X: Array) -> Array:
        """Parts of a step that the rates along the motion of each column ask for [1]_, shape (batch,)."""
        if not self.states or task.t.size < 2:
            return np.ones(task.batch.size)
        h = float(np.diff(task.t).max())
        return np.maximum(self._smooth(task, X, h), self._sharp(task, X, h))

    def _smooth(self, task: _Task, X: Array, h: float) -> Array:
        """Parts of a step `h` [s] that the rates of each column ask for, shape (batch,)."""
        eigenvalues = self._eigenvalues(task, X)
        size, damping = np.abs(eigenvalues) * h, np.maximum(-eigenvalues.real, 0.0) * h
        longest = float(np.diff([*task.starts, task.t.size]).max())
        lasting = np.clip(1.0 / np.maximum(damping, 1e-12), 1.0, longest)
        allowed = np.where(2.0 * eigenvalues.real**2 > np.abs(eigenvalues) ** 2, TRANSIENT, PHASE)
        accurate = (lasting * size**5 / 120.0 / allowed) ** 0.25
        return np.asarray(np.maximum(accurate, size / STABLE).max(axis=(0, 2), initial=1.0))

    def _sharp(self, task: _Task, X: Array, h: float) -> Array:
        """Parts of a step `h` [s] in which a state crosses where a term bends sharply, stably, shape (batch,)."""
        parts = np.ones(X.shape[2])
        for where, e in task.batch.effects:
            if isinstance(e, StateTerm) and np.all(np.isfinite(e.width)):
                steps = np.diff(X[:, self.states.index(where)], axis=0)
                there = np.isfinite(steps)
                power = np.sum(np.where(there, steps, 0.0) ** 2, axis=0) / np.maximum(there.sum(axis=0), 1)
                parts = np.maximum(parts, np.maximum(e.rate * h / STABLE, np.sqrt(power) / e.width))
        return parts

    def _eigenvalues(self, task: _Task, X: Array) -> NDArray[np.complex128]:
        """Of the Jacobian at some times of every column, shape (times, batch, states); zero where it diverges."""
        k = len(self.states)
        at = np.unique(np.linspace(0, task.t.size - 1, LOOKS).astype(int))
        u = [s.samples[at] for s in task.signals]  # what is late or lags is near enough
        sizes = np.where(np.isfinite(X[at]), np.abs(X[at]), 0.0).max(axis=(0, 2))
        step = 1e-6 * np.where(sizes > 0.0, sizes, 1.0)
        # Every state a little more, then every state a little less, all at once: shape (2 k, times, batch) each.
        shifts = np.concatenate([np.diag(step), -np.diag(step)])
        x = [X[at, i] + shifts[:, i, None, None] for i in range(k)]
        shape = 2 * k, at.size, X.shape[2]
        rates = [np.broadcast_to(v, shape) for v in self.rates.values([*x, *u, *task.given])]
        more, less = np.split(np.stack(rates, axis=-1), 2)
        J = np.moveaxis((more - less) / (2.0 * step[:, None, None, None]), 0, -1)
        good = np.isfinite(J).all(axis=(2, 3), keepdims=True)
        return np.asarray(np.linalg.eigvals(np.where(good, J, 0.0)), dtype=np.complex128)

    def _channels(self, task: _Task, X: Array) -> dict[str, Array]:
        """What every channel shows, each of shape (n, batch)."""
        t = task.t
        x = [X[:, i] for i in range(len(self.states))]
        u = [
            s.at(t) if n in self._shown_inputs else np.zeros((1, 1))
            for n, s in zip(self.inputs, task.signals)
        ]
        values = self.shows.values([*x, *u, *task.given])
        out = {}
        for name, value in zip(self.model.measurements, values):
            h = np.asarray(np.broadcast_to(value, (t.size, task.batch.size)))
            for where, effect in task.batch.effects:
                if where == name and isinstance(effect, SensorChange):
                    h = effect.shown(t, h)
            out[name] = h
        return out


def _parts(needs: Array) -> int:
    """Parts of a step of columns that ask for `needs`, shape (batch,).

    A column that runs away beside others, which a search has tried, needs no accuracy, and has none: it is not followed.
    """
    most = MAX_NEED_RATIO * float(needs.min(initial=MOST))
    return int(np.ceil(min(float(np.quantile(needs, 0.5, method="lower")), most, MOST)))


def _common(nodes: Sequence[Array], steps: int) -> Array:
    """Inputs of several shapes as one array, shape (inputs, steps, substeps, nodes, batch)."""
    if not nodes:
        return np.zeros((0, steps, 1, 1, 1))
    shape = np.broadcast_shapes(*(v.shape for v in nodes))
    return np.ascontiguousarray(np.stack([np.broadcast_to(v, shape) for v in nodes]))


def effects_inside(model: UserModel) -> tuple[tuple[str, PlantEffect], ...]:
    """Where effects act that a model has inside its plant, and these.

    Parameters
    ----------
    model : UserModel
    """
    found = [(a.where, a.effect) for a in model.dynamics_effects]
    found += [(n, e) for n, m in model.measurements.items() for e in m.noise.effects]
    return tuple((w, e) for w, e in found if isinstance(e, PlantEffect))


def simulate(
    model: UserModel, t: Array, inputs: Mapping[str, Array], initial: Mapping[str, float] | None = None
) -> Run:
    """The model as it stands over the times of a log, a batch of one, without its process noise.

    That is drawn by `kfgen.model.plant.drawn_process_noise`.

    Parameters
    ----------
    t : ndarray, shape (n,)
        Times [s].
    inputs : mapping of str to ndarray, shape (n,)
        SI.
    initial : mapping of str to float, optional
        Where states start [SI]; else as the file says.

    Raises
    ------
    InputError
        An input is missing, or the simulation diverges.
    """
    missing = [n for n in model.inputs if n not in inputs]
    if missing:
        raise InputError(f"the input '{missing[0]}' of {model.name} is missing", where=model.path)
    effects = effects_inside(model)
    start = {n: s.initial for n, s in model.states.items()} | dict(initial or {})
    X0 = np.array([start[n] for n in model.states], dtype=np.float64).reshape(1, len(model.states), 1)
    batch = Batch({n: np.array([p.value]) for n, p in model.parameters.items()}, effects, X0)
    plant = Plant(model, [(w, type(e)) for w, e in effects])
    t = np.asarray(t, dtype=np.float64)
    run = plant.simulate(t, inputs, batch)
    refuse(plant, t, inputs, batch, run, np.zeros(t.size, bool))
    return run
