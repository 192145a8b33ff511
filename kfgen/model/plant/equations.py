"""A model file as a filter: its equations as a motion, its measurements as sensors.

Every state is a block of one component, every parameter and every coefficient of an effect a constant that firmware
may set. Lags become states; a delay of an input is a line of its samples, a backlash is where it stands, both kept beside
the state (`kfgen.model.register`).
"""

from __future__ import annotations

import keyword
import re
from collections.abc import Mapping
from typing import Any

import numpy as np
import sympy as sp

from kfgen.core.errors import InputError
from kfgen.core.expression import symbol
from kfgen.core.units import derived_unit, parse_unit
from kfgen.effects.noise_model import NoiseModel
from kfgen.effects.plant.sensor import SensorChange
from kfgen.effects.plant.terms import InputChange, PlantEffect, StateTerm
from kfgen.effects.process.stochastic import has_white_noise
from kfgen.model.filter import FilterModel
from kfgen.model.parts.constant import Constant
from kfgen.model.parts.motion import Input, MotionModel
from kfgen.model.parts.sensors import Sensor
from kfgen.model.plant.file import model_text, parse_model
from kfgen.model.plant.user import Measurement, UserModel
from kfgen.model.register import BacklashOperator, DelayLine
from kfgen.model.symbols.blocks import Vector

UNKNOWN = {"rad": 3.0, "rad/s": 10.0, "m": 100.0, "m/s": 30.0, "K": 100.0, "A": 10.0}
"""Standard deviation of a state that starts unknown [SI], by its unit; 10 in others."""
C_WORDS = (
    "auto break case char const continue default do double else enum extern float for goto if inline int long "
    "register restrict return short signed sizeof static struct switch typedef union unsigned void volatile while"
)
OWN_WORDS = "x P k z kf dt innovation variance status gate fused dx np"
RESERVED = frozenset({*re.findall(r"\w+", f"{C_WORDS} {OWN_WORDS}"), *keyword.kwlist})
"""Names of the emitted filter and of its languages."""


class Equations(MotionModel):
    """The dynamics of a model file in symbols.

    Parameters
    ----------
    user : UserModel
    blocks, inputs, constants
        As of `MotionModel`.
    derivatives : mapping of str to expression
        Of every block, in the symbols of states, inputs and constants.
    late : tuple of DelayLine
        As of `MotionModel`.
    """

    is_plant = True

    def __init__(
        self,
        user: UserModel,
        blocks: tuple[Vector, ...],
        inputs: tuple[Input, ...],
        constants: tuple[Constant, ...],
        derivatives: Mapping[str, sp.Expr],
        late: tuple[DelayLine, ...] = (),
    ) -> None:
        self.user = user
        self.blocks = blocks
        self.inputs = inputs
        self.constants = constants
        self.late = late
        self.derivatives = dict(derivatives)

    def rates(self, x: Mapping[str, sp.Matrix], u: Mapping[str, sp.Matrix]) -> dict[str, sp.Matrix]:
        """The derivatives with what the states and inputs are."""
        values = {symbol(b.name): x[b.name][0] for b in self.blocks}
        values |= {symbol(i.name): u[i.name][0] for i in self.inputs}
        return {n: sp.Matrix([e.xreplace(values)]) for n, e in self.derivatives.items()}

    def offers(self, x: Mapping[str, sp.Matrix], rates: Mapping[str, sp.Matrix]) -> dict[str, sp.Matrix]:
        """Nothing: the names of a model file are its own."""
        return {}

    def starts_unknown(self, value: sp.Expr) -> bool:
        """Whether an expression is a state alone, and one of which nothing is assumed."""
        state = self.user.states.get(value.name) if value.is_Symbol else None
        return state is not None and bool(np.isinf(state.sd))


class Shown(Sensor):
    """One measurement of a model file.

    Parameters
    ----------
    channel, unit : str
        SI unit.
    value : sympy expression
        In the symbols of the states and constants.
    states : tuple of str
        The blocks that it looks at.
    backlash : BacklashOperator, optional
        As of `Sensor`.
    """

    def __init__(
        self,
        channel: str,
        unit: str,
        value: sp.Expr,
        states: tuple[str, ...],
        backlash: BacklashOperator | None = None,
        slope: sp.Expr | None = None,
    ) -> None:
        self.name = channel  # type: ignore[misc]
        self.title = f"measured {channel}"  # type: ignore[misc]
        self.unit = unit
        self.channels = (channel,)
        self.value = value
        self.needs = states
        self.backlash = backlash
        self.slope = slope
        self.rate_needs = states if slope is not None else ()

    def predict(self, x: Mapping[str, sp.Matrix]) -> sp.Matrix:
        """The measurement's expression."""
        return sp.Matrix([self.value.xreplace({symbol(n): x[n][0] for n in self.needs})])

    def rate(self, x: Mapping[str, sp.Matrix]) -> sp.Matrix:
        """Its derivative along the dynamics."""
        slope = sp.Integer(0) if self.slope is None else self.slope
        return sp.Matrix([slope.xreplace({symbol(n): x[n][0] for n in x if len(x[n]) == 1})])


class _Builder:
    """Collects blocks, constants and derivatives."""

    def __init__(self, user: UserModel) -> None:
        self.user = user
        noises = user.process_noise
        self.blocks = [_block(n, s.unit, s.initial, s.sd, noises.get(n, 0.0)) for n, s in user.states.items()]
        self.constants = [
            Constant(n, parse_unit(p.unit).si, p.value, f"parameter {n}") for n, p in user.parameters.items()
        ]
        self.derivatives = {n: _smooth(e.value) for n, e in user.dynamics.items()}
        self.delays: dict[str, float] = {}

    @property
    def late(self) -> tuple[DelayLine, ...]:
        """The inputs that act late."""
        units = {n: parse_unit(self.user.inputs[n]).si for n in self.delays}
        return tuple(DelayLine(n, units[n], delay) for n, delay in self.delays.items())

    def numbers(self, effect: PlantEffect, where: str) -> Any:
        """The effect with symbols for its numbers, which become constants."""
        values = {}
        for p in effect.parameters():
            name = f"{where}_{effect.name}_{p.name}"
            unit = parse_unit(derived_unit(p.unit, self.user.unit_at(where, effect))).si
            title = f"{effect.title} of {where}, {p.name}"
            self.constants.append(Constant(name, unit, float(getattr(effect, p.name)), title))
            values[p.name] = symbol(name)
        return type(effect)(**values)

    def lag(self, effect: PlantEffect, where: str, unit: str, driven: sp.Expr) -> sp.Symbol:
        """The state of a first-order lag behind an expression."""
        name = f"{where}_behind"
        self.blocks.append(_block(name, unit, 0.0, np.inf))
        self.derivatives[name] = (driven - symbol(name)) / self.numbers(effect, where).lag
        return symbol(name)

    def dynamics(self) -> None:
        """Terms of the equations, and what happens to the inputs."""
        seen: dict[sp.Symbol, sp.Expr] = {}
        lags: dict[str, PlantEffect] = {}
        for where, effect in ((a.where, a.effect) for a in self.user.dynamics_effects):
            if isinstance(effect, StateTerm):
                p = self.user.position_of(where)
                term = self.numbers(effect, where).term(symbol(where), symbol(p) if p else None)
                self.derivatives[where] = self.derivatives[where] + term
            elif isinstance(effect, InputChange) and effect.late:
                self.delays[where] = self.delays.get(where, 0.0) + float(effect.late)
            elif isinstance(effect, InputChange) and effect.lag:
                lags[where] = effect
            elif isinstance(effect, InputChange):
                u = seen.get(symbol(where), symbol(where))
                seen[symbol(where)] = self.numbers(effect, where).samples(u)
        plain = {symbol(w): symbol(f"{w}_behind") for w in lags}
        self.derivatives = {n: e.xreplace({**seen, **plain}) for n, e in self.derivatives.items()}
        for where, effect in lags.items():
            assert isinstance(effect, PlantEffect)
            self.lag(effect, where, self.user.inputs[where], seen.get(symbol(where), symbol(where)))

    def sensors(self) -> list[Shown]:
        """Every measurement."""
        return [self._shown(name, m) for name, m in self.user.measurements.items()]

    def _shown(self, name: str, m: Measurement) -> Shown:
        """One of them, with its lags and its backlash."""
        value, backlash, unit = _smooth(m.expression.value), None, parse_unit(m.unit).si
        used = sorted(m.expression.names & set(self.user.inputs))
        if used:
            raise InputError(
                f"the measurement {name} shows the input {used[0]}, which no filter can predict yet",
                where=self.user.path,
                remedy="Make the input a state, or leave the measurement out",
            )
        for effect in m.noise.effects:
            if isinstance(effect, SensorChange) and backlash is not None:
                raise InputError(
                    f"{effect.name} stands behind the {backlash[0].name} of {name}, which no filter carries",
                    where=self.user.path,
                    remedy=f"Write it before the {backlash[0].name}, or leave one of them out",
                )
            if isinstance(effect, SensorChange) and effect.backlash:
                backlash = effect, BacklashOperator(name, unit, self.numbers(effect, name).backlash)
            elif isinstance(effect, SensorChange) and effect.lag:
                value = self.lag(effect, name, m.unit, value)
        names = {b.name for b in self.blocks}
        needs = tuple(sorted(s.name for s in value.free_symbols if s.name in names))
        slope = sum((value.diff(symbol(n)) * self.derivatives[n] for n in needs), sp.Integer(0))
        return Shown(name, unit, value, needs, backlash[1] if backlash else None, slope)


def _block(name: str, unit: str, initial: float, sd: float, driven: float = 0.0) -> Vector:
    si = parse_unit(unit).si
    prior = sd if np.isfinite(sd) else unknown_deviation(si, initial)
    return Vector(name, ("",), si, f"state {name}", float(prior), (float(initial),), driven)


def unknown_deviation(unit: str, initial: float) -> float:
    """Standard deviation of a state that starts unknown and that no measurement shows [SI], by its SI unit."""
    return max(UNKNOWN.get(unit, 10.0), abs(initial))


def _smooth(e: sp.Expr) -> sp.Expr:
    """Minima and maxima by absolute values, which have a derivative that can be computed."""

    def pair(a: sp.Expr, b: sp.Expr, sign: int) -> sp.Expr:
        return (a + b + sign * sp.Abs(a - b)) / 2

    def all_of(sign: int, arguments: tuple[sp.Expr, ...]) -> sp.Expr:
        value = arguments[0]
        for other in arguments[1:]:
            value = pair(value, other, sign)
        return value

    return e.replace(sp.Max, lambda *a: all_of(1, a)).replace(sp.Min, lambda *a: all_of(-1, a))


def filter_model(user: UserModel, noise: NoiseModel | None = None) -> FilterModel:
    """A model file as a filter.

    Parameters
    ----------
    noise : NoiseModel, optional
        Effects of inputs, and of measurements instead of the file's.

    Raises
    ------
    InputError
        An effect or a measurement that no filter carries, or a name that the emitted code needs.
    """
    user = parse_model(model_text(user), user.path)  # with the digits of its file, so that hashes agree
    for name in (*user.names, *user.measurements):
        if name in RESERVED:
            raise InputError(
                f"the emitted filter needs the name '{name}'", where=user.path, remedy="Rename it"
            )
    builder = _Builder(user)
    builder.dynamics()
    sensors = builder.sensors()
    inputs = tuple(
        Input(n, parse_unit(unit).si, f"input {n}", f"b_{n}", 0.0, 0.0, scalar=True)
        for n, unit in user.inputs.items()
    )
    parts = tuple(builder.blocks), inputs, tuple(builder.constants)
    motion = Equations(user, *parts, builder.derivatives, builder.late)
    terms = {
        n: tuple(t for t in m.noise.terms if not isinstance(t.effect, PlantEffect))
        for n, m in user.measurements.items()
    }
    for channel, given in (noise.channels if noise else {}).items():
        own = user.inputs.get(channel) or (user.measurements[channel].unit if channel in terms else None)
        if own is None:
            continue
        if not parse_unit(given.unit).same_dimension(parse_unit(own)):
            raise InputError(
                f"channel {channel} is in {given.unit} in the noise file, {user.name} needs {own}"
            )
        terms[channel] = given.terms
    units = dict(user.inputs) | {n: m.unit for n, m in user.measurements.items()}
    title = f"the model file {re.sub(r'[^A-Za-z0-9 _-]', '_', user.name)}"
    for channel in user.measurements:
        if not has_white_noise(t.effect for t in terms[channel]):
            raise InputError(
                f"the model of {channel} has no white noise",
                where=user.path,
                remedy="Give it an effect white_noise",
            )
    name = re.sub(r"[^A-Za-z0-9]+", "_", user.name).strip("_") or "plant"
    name = name if name[0].isalpha() else f"plant_{name}"
    return FilterModel(
        name,
        title,
        motion,
        tuple(sensors),
        {c: tuple(t.effect for t in ts) for c, ts in terms.items()},
        units,
        uses={c: tuple(t.use for t in ts) for c, ts in terms.items()},
    )
