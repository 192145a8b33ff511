"""`FilterModel`: blocks, motion, sensors and effects; F, G and H by differentiation.

Every effect of a channel appends its states. Of an input (a gyro that drives the
motion) the truth is ``u = u_measured - sum C x - n``; of a sensor the measurement is
``z = predict(x) + sum C x + n``. States of one channel that only keep their value (a constant
bias, a random walk) cannot be distinguished and are one state whose driving noises add.

The errors obey ``d(dx)/dt = F dx + G n`` and a measurement's residual is ``H dx + n``, where
F, G and H are the derivatives, at zero error, of the equations written with the perturbed state.

References
----------
.. [1] J. Solà, Quaternion kinematics for the error-state Kalman filter, 2017, sec. 7.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from types import MappingProxyType

import sympy as sp

from kfgen.core.channel_names import acts_on
from kfgen.core.errors import InputError
from kfgen.effects import Effect
from kfgen.effects.filter_role import Use
from kfgen.effects.noise_model import NoiseModel
from kfgen.model.attach import Attached, Attachment, Omission, StateInfo
from kfgen.model.filter_checks import check_channels, check_needs, content_hash, described
from kfgen.model.filter_effects import FilterEffects
from kfgen.model.filter_file import HEADING, FilterFile, Initial
from kfgen.model.noise_driven import closed_under_noise, densities
from kfgen.model.parts.attached_error import AttachedError
from kfgen.model.parts.constant import Constant
from kfgen.model.parts.motion import MotionModel
from kfgen.model.parts.reading import reading, undone
from kfgen.model.parts.sensors import Sensor
from kfgen.model.register import Register
from kfgen.model.symbols.blocks import Attitude, Block, Vector
from kfgen.model.symbols.convention import Convention
from kfgen.model.symbols.error_state import ErrorState, Variation, slopes
from kfgen.model.symbols.expanded import expanded


@dataclass(frozen=True, repr=False)
class FilterModel:
    """A filter in symbols.

    Parameters
    ----------
    name, title : str
    motion : Motion
    sensors : tuple of Sensor
    noise : mapping of str to tuple of Effect
        The effects of each channel, or of a sensor whose channels share them, in SI.
    units : mapping of str to str
        The user's units of the channels, in which he is answered.
    options : mapping of str to str
        What was chosen of the library model's options, as text.
    uses : mapping of str to tuple of Use
        How the effects of `noise` are taken, in their order: known where it says nothing.
    initial : mapping of str to Initial
        What is assumed before the first measurement, by the name of a stored state, or ``heading``.
    unchecked : tuple of Omission
        What else its file says that is not in the filter.
    limits : mapping of str to float
        Largest magnitude that an input or a sensor can give, by its name [SI].
    ideal : bool
        Without the errors of its readings.
    given : NoiseModel or FilterFile, optional
        What it was built from, which goes beside its code.

    Raises
    ------
    InputError
        Effects of a channel that there is not, or a sensor that the motion cannot serve.
    """

    name: str
    title: str
    motion: MotionModel
    sensors: tuple[Sensor, ...]
    noise: Mapping[str, tuple[Effect, ...]] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    options: Mapping[str, str] = field(default_factory=dict)
    uses: Mapping[str, tuple[Use, ...]] = field(default_factory=dict)
    initial: Mapping[str, Initial] = field(default_factory=dict)
    unchecked: tuple[Omission, ...] = ()
    limits: Mapping[str, float] = field(default_factory=dict)
    ideal: bool = False
    given: NoiseModel | FilterFile | None = field(default=None, compare=False)

    __repr__ = described

    def __post_init__(self) -> None:
        object.__setattr__(self, "noise", MappingProxyType(dict(self.noise)))
        object.__setattr__(self, "uses", MappingProxyType(dict(self.uses)))
        check_channels(self)
        if any(s.needs for s in self.sensors):
            check_needs(self, {b.name for b in self.blocks} | set(self._offers))

    def augment(self, where: str, effect: Effect, use: Use | None = None) -> FilterModel:
        """The same model with one more effect.

        Parameters
        ----------
        where : str
            A channel, or a sensor whose channels share it.
        effect : Effect
            With its values [SI].
        use : Use, optional
            Known, or a state; known where left out.
        """
        effects, uses = self.noise.get(where, ()), self.uses_at(where)
        noise = {**self.noise, where: (*effects, effect)}
        return replace(self, noise=noise, uses={**self.uses, where: (*uses, use or Use())})

    def uses_at(self, where: str) -> tuple[Use, ...]:
        """How each effect of a place is taken."""
        given = self.uses.get(where, ())
        return given + (Use(),) * (len(self.noise.get(where, ())) - len(given))

    @cached_property
    def channel_units(self) -> dict[str, str]:
        """SI unit of every channel, inputs first."""
        units = {c: i.unit for i in self.motion.inputs for c in i.channels}
        return units | {c: s.unit for s in self.sensors for c in s.channels}

    def channels_of(self, where: str) -> tuple[str, ...]:
        """The channels of a place: of a sensor all of its own."""
        return tuple(c for c in self.channel_units if acts_on(where, c))

    @cached_property
    def _effects(self) -> FilterEffects:
        """What the effects of channels are in this filter."""
        uses = {where: self.uses_at(where) for where in self.noise}
        parts = self.name, self.motion, self.sensors, self.noise
        return FilterEffects(*parts, uses, self.channel_units, self.ideal)

    @property
    def omitted(self) -> tuple[Omission, ...]:
        """The effects that this filter is built without, each with why and what to do instead."""
        return (*self.unchecked, *self._effects.omitted)

    @property
    def errors(self) -> tuple[AttachedError, ...]:
        """The changes of readings: of the motion's options, of the sensors', of the effects of channels."""
        return self._effects.errors

    @cached_property
    def blocks(self) -> tuple[Block, ...]:
        """The blocks of the motion, what its inputs' errors do not know, then the same of the sensors, each once."""
        return self._effects.blocks

    @cached_property
    def constants(self) -> tuple[Constant, ...]:
        """Every constant of the motion, of the sensors and of known effects, once."""
        declared = [*self.motion.constants, *(c for s in self.sensors for c in s.constants)]
        declared += [c for e in self.errors for c in e.constants]
        declared += [o.constant for o in self._attachment.outputs]
        return tuple({c.name: c for c in declared}.values())

    @property
    def drivers(self) -> tuple[str, ...]:
        """Channels that drive effects, ``temperature`` for example."""
        return self._effects.drivers

    @cached_property
    def _attachment(self) -> Attachment:
        """The effects' states (after the blocks'), which effect has which, known outputs and changes of noise."""
        return self._effects.attachment(sum(len(b.error_names) for b in self.blocks))

    @property
    def registers(self) -> tuple[Register, ...]:
        """Numbers of the past of drivers that are kept beside the state."""
        return tuple(self._attachment.registers)

    @cached_property
    def states(self) -> tuple[StateInfo, ...]:
        """The error states in order: blocks first, then the effects' by channel."""
        blocks = tuple(
            StateInfo(n, b.unit, f"{b.title} {n.rsplit('_', 1)[-1]}", sd)
            for b in self.blocks
            for n, sd in zip(b.error_names, b.deviations)
        )
        return tuple(self._known_better(s) for s in blocks + tuple(self._attachment.states))

    def _known_better(self, state: StateInfo) -> StateInfo:
        """A state with what is assumed about it before the first measurement; the heading is the turn about down."""
        turn = self.attitude.error_names[2] if self.attitude is not None else ""
        found = self.initial.get(HEADING if state.name == turn else state.name)
        sd = found.sd if found is not None else 0.0
        return replace(state, prior=sd or state.prior)

    @property
    def attached(self) -> tuple[Attached, ...]:
        """The effects of all channels in order."""
        return tuple(self._attachment.effects)

    @cached_property
    def attitude(self) -> Attitude | None:
        """The attitude block, where there is one."""
        return next((b for b in self.blocks if isinstance(b, Attitude)), None)

    def effects_on(self, channel: str, *, perturbed: bool = False) -> sp.Expr:
        """``sum C x`` of a channel's effects [SI], for the estimate or for the truth."""
        total = sp.Integer(0)
        for a in self.attached:
            for c, k, new in zip(a.form.C, a.states, a.brought):
                if a.channel == channel and new:
                    info = self.states[k]
                    total += sp.sympify(c, strict=True) * (info.symbol + (info.error if perturbed else 0))
        return total + sum(o.expression for o in self._attachment.outputs if o.channel == channel)

    @cached_property
    def error(self) -> ErrorState:
        """The error of the blocks in the attitude's convention."""
        return ErrorState(self.blocks, self.motion.turning)

    @property
    def convention(self) -> type[Convention]:
        """How truth is made of estimate and error."""
        return self.error.convention

    def _view(self, perturbed: bool) -> dict[str, sp.Matrix]:
        return self.error.truth if perturbed else self.error.estimate

    def inputs(self, perturbed: bool) -> dict[str, sp.Matrix]:
        """The true (or estimated) value of each input triad in symbols: what it shows less all that is wrong with it."""
        shown = {
            i.name: sp.Matrix([self.corrected_input(c, perturbed) for c in i.channels])
            for i in self.motion.inputs
        }
        true: dict[str, sp.Matrix] = {}
        for i in sorted(self.motion.inputs, key=lambda i: i.name != "accel"):  # forces act on gyros
            true[i.name] = undone(
                i.channels, shown[i.name], self.errors, self.motion, self._view(perturbed), true.get("accel")
            )
        return true

    def corrected_input(self, channel: str, perturbed: bool) -> sp.Expr:
        """What an input shows without its biases and driven effects, of the estimate or of the truth."""
        noise = sp.Symbol(f"n_{channel}", real=True) if perturbed else 0
        return sp.Symbol(channel, real=True) - self.effects_on(channel, perturbed=perturbed) - noise

    @cached_property
    def _estimated_rates(self) -> dict[str, sp.Matrix]:
        still = {b.name: sp.zeros(len(b.error_names), 1) for b in self.blocks}
        return still | self.motion.rates(self._view(False), self.inputs(False))

    def rates(self, perturbed: bool) -> dict[str, sp.Matrix]:
        """The blocks' rates on the estimate or on the truth; the body rate of an attitude."""
        if not perturbed:
            return self._estimated_rates
        still = {b.name: sp.zeros(len(b.error_names), 1) for b in self.blocks}
        return still | self.motion.rates(self._view(True), self.inputs(True))

    @cached_property
    def _offers(self) -> dict[str, sp.Matrix]:
        return self.motion.offers(self._view(False), self.rates(False))

    def _seen(self, perturbed: bool) -> dict[str, sp.Matrix]:
        """What sensors see of the estimate or of the truth: blocks, and what the motion offers."""
        view = self._view(perturbed)
        return view | (self.motion.offers(view, self.rates(True)) if perturbed else self._offers)

    def clean(self, sensor: Sensor) -> sp.Matrix:
        """The expected measurement of the estimate without any effect, shape (m, 1)."""
        return sensor.predict(self._seen(False))

    def read(self, sensor: Sensor, *, perturbed: bool = False) -> sp.Matrix:
        """The expected measurement with the errors of its reading, shape (m, 1): offset, then late, then distorted."""
        return reading(sensor, self._seen(perturbed), self.errors, self.motion)

    @cached_property
    def noise_symbols(self) -> tuple[sp.Symbol, ...]:
        """White noises that drive the error: of the inputs, of the blocks, then of the effects' states."""
        inputs = [sp.Symbol(f"n_{c}", real=True) for i in self.motion.inputs for c in i.channels]
        driven = [sp.Symbol(f"w_{n}", real=True) for b in self.driven for n in b.error_names]
        return (*inputs, *driven, *(sp.Symbol(f"w_{s.name}", real=True) for s in self._attachment.states))

    @cached_property
    def driven(self) -> tuple[Vector, ...]:
        """The blocks that white noise drives."""
        return tuple(b for b in self.blocks if isinstance(b, Vector) and b.driven)

    @cached_property
    def noise_driven_blocks(self) -> tuple[tuple[Vector, ...], sp.Matrix, sp.Matrix]:
        """Blocks that white noise moves and nothing else: dynamics A and driving density W of their components."""
        return (
            closed_under_noise(self.blocks, self.driven, self.rates(False))
            if self.driven
            else ((), sp.zeros(0, 0), sp.zeros(0, 0))
        )

    @cached_property
    def _variation(self) -> Variation:
        """How every symbol varies with the error states and, after them, with `noise_symbols`."""
        out = self.error.variation
        first, size = len(self.error.symbols), len(self.states)
        out |= {s.symbol: {first + k: sp.Integer(1)} for k, s in enumerate(self.states[first:])}
        channels = [c for i in self.motion.inputs for c in i.channels]
        return out | {sp.Symbol(c, real=True): {size + k: sp.Integer(-1)} for k, c in enumerate(channels)}

    @cached_property
    def _error_rate(self) -> sp.Matrix:
        """``d(dx)/dt`` to first order: coefficients of the error states, then of the noises, shape (n, n + q)."""
        first, size = len(self.error.symbols), len(self.states)
        columns = size + len(self.noise_symbols)
        rates = self.rates(False)
        variations = {b.name: slopes(rates[b.name], self._variation, columns) for b in self.blocks}
        column = size + sum(len(i.channels) for i in self.motion.inputs)
        for b in self.driven:
            k = len(b.error_names)
            variations[b.name][:, column : column + k] = sp.eye(k)
            column += k
        effects = sp.zeros(size - first, columns)
        effects[:, first:size] = self.effect_dynamics[0]
        effects[:, columns - (size - first) :] = sp.eye(size - first)
        moved = self.error.rates(variations, rates) if self.blocks else sp.zeros(0, columns)
        return sp.Matrix.vstack(moved, effects)

    @cached_property
    def corrected(self) -> tuple[sp.Expr, ...]:
        """The stored state with the error put in, in order; quaternions not normalised."""
        effects = self.states[len(self.states) - len(self._attachment.states) :]
        return (*self.error.corrected, *(s.symbol + s.error for s in effects))

    @cached_property
    def effect_dynamics(self) -> tuple[sp.Matrix, sp.Matrix]:
        """Dynamics A and driving density W of the effects' states, shape (m, m)."""
        return self._attachment.dynamics()

    def white(self, channel: str) -> tuple[sp.Expr, sp.Expr]:
        """White noise of a channel: density [U^2/Hz], and variance of the steps of its integral."""
        forms = [a.form for a in self.attached if a.channel == channel]
        factor = self.noise_change(channel)[0]
        return (
            factor * sum((sp.sympify(f.V, strict=True) for f in forms), sp.Integer(0)),
            sum((sp.sympify(f.Z, strict=True) for f in forms), sp.Integer(0)),
        )

    def is_sampled(self, channel: str) -> bool:
        """Whether the white noise of a channel is said by the standard deviation of its samples."""
        return channel in self._attachment.sampled

    def noise_change(self, channel: str) -> tuple[sp.Expr, sp.Expr]:
        """Factor on the variance of a channel's white noise, and variance that each sample has beside it [SI^2]."""
        found = self._attachment
        return found.factors.get(channel, sp.Integer(1)), found.extra.get(channel, sp.Integer(0))

    @cached_property
    def F(self) -> sp.Matrix:
        """Dynamics of the error, shape (n, n)."""
        return self._error_rate[:, : len(self.states)]

    @cached_property
    def G(self) -> sp.Matrix:
        """Noise input, shape (n, q)."""
        return self._error_rate[:, len(self.states) :]

    @cached_property
    def W(self) -> sp.Matrix:
        """Densities of `noise_symbols`, shape (q, q)."""
        return densities(self, self._attachment.shared) if self.noise_symbols else sp.zeros(0, 0)

    def expected(self, sensor: Sensor, *, perturbed: bool = False) -> sp.Matrix:
        """The expected measurement with the effects of its channels, shape (m, 1)."""
        h = self.read(sensor, perturbed=perturbed)
        return h + sp.Matrix([self.effects_on(c, perturbed=perturbed) for c in sensor.channels])

    def H(self, sensor: Sensor) -> sp.Matrix:
        """The measurement's Jacobian, shape (m, n)."""
        if sensor not in self._jacobians:
            columns = len(self.states) + len(self.noise_symbols)
            slope = slopes(self.expected(sensor), self._variation, columns)[:, : len(self.states)]
            self._jacobians[sensor] = expanded(slope)
        return self._jacobians[sensor].copy()

    @cached_property
    def _jacobians(self) -> dict[Sensor, sp.Matrix]:
        """Of the sensors that were asked for."""
        return {}

    def sensor(self, name: str) -> Sensor:
        """The sensor of that name; raises `InputError` when there is none."""
        for s in self.sensors:
            if s.name == name:
                return s
        raise InputError(
            f"{self.name} has no sensor '{name}'", remedy=f"It has {', '.join(s.name for s in self.sensors)}"
        )

    @cached_property
    def hash(self) -> str:
        """SHA-256 over the content: equations, numbers, order of states (hexadecimal)."""
        return content_hash(self)
