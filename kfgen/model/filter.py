"""`FilterModel`: blocks, motion, sensors and effects; F, G and H by differentiation.

Every effect of a channel appends its states. Of an input (a gyro that drives the
motion) the truth is ``u = u_measured - sum C x - n``; of a sensor the measurement is
``z = predict(x) + sum C x + n``. States of one channel that only keep their value (a constant
bias, a random walk) cannot be told apart and are one state whose driving noises add.

The errors obey ``d(dx)/dt = F dx + G n`` and a measurement's residual is ``H dx + n``, where
F, G and H are the derivatives, at zero error, of the equations written with the perturbed state.

References
----------
.. [1] J. Solà, Quaternion kinematics for the error-state Kalman filter, 2017, sec. 7.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from types import MappingProxyType

import sympy as sp

from kfgen.core.errors import InputError
from kfgen.effects import Effect
from kfgen.effects.noise_model import NoiseModel
from kfgen.model.attach import Attached, Attachment, StateInfo
from kfgen.model.parts.motion import Constant, MotionModel
from kfgen.model.parts.sensors import Sensor
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
        The effects of each channel, in SI.
    units : mapping of str to str
        The user's units of the channels, in which he is answered.
    options : mapping of str to str
        What was chosen of the library model's options, as text.
    given_noise : NoiseModel, optional
        What it was built with, which goes beside its code.

    Raises
    ------
    InputError
        Effects of a channel that there is not, a sensor that the motion cannot serve, or a state that could never
        move from its start.
    """

    name: str
    title: str
    motion: MotionModel
    sensors: tuple[Sensor, ...]
    noise: Mapping[str, tuple[Effect, ...]] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    options: Mapping[str, str] = field(default_factory=dict)
    given_noise: NoiseModel | None = field(default=None, compare=False)

    def __repr__(self) -> str:
        sensors = ", ".join(s.name for s in self.sensors)
        lines = [
            f"{self.name}: {self.title}",
            f"{len(self.states)} states: {', '.join(s.name for s in self.states)}",
        ]
        return "\n".join(
            [*lines, f"sensors: {sensors}; inputs: {', '.join(i.name for i in self.motion.inputs) or 'none'}"]
        )

    def __post_init__(self) -> None:
        object.__setattr__(self, "noise", MappingProxyType(dict(self.noise)))
        self._check_channels()
        self._check_needs()
        unknown = [c for c in self.noise if c not in self.channel_units]
        if unknown:
            raise InputError(
                f"{self.name} has no channel '{unknown[0]}'", remedy=f"It has {', '.join(self.channel_units)}"
            )

    def augment(self, channel: str, effect: Effect) -> FilterModel:
        """The same model with one more effect on a channel."""
        effects = (*self.noise.get(channel, ()), effect)
        return replace(self, noise={**self.noise, channel: effects})

    @cached_property
    def channel_units(self) -> dict[str, str]:
        """SI unit of every channel, inputs first."""
        units = {c: i.unit for i in self.motion.inputs for c in i.channels}
        return units | {c: s.unit for s in self.sensors for c in s.channels}

    def _check_channels(self) -> None:
        """No two parts read one channel."""
        readers: dict[str, str] = {}
        parts = [
            *((f"the input {i.name}", i.channels) for i in self.motion.inputs),
            *((f"the sensor {s.name}", s.channels) for s in self.sensors),
        ]
        for name, channels in parts:
            for c in channels:
                if readers.setdefault(c, name) != name:
                    raise InputError(
                        f"{readers[c]} and {name} of {self.name} both read the channel {c}",
                        where=self.name,
                        remedy=f"Leave out {name}",
                    )

    def _check_needs(self) -> None:
        """Every sensor's needs are met by the motion's blocks, by what it offers, or by the sensor itself."""
        if not any(s.needs for s in self.sensors):
            return
        offered = {b.name for b in self.blocks} | set(self._offers)
        for s in self.sensors:
            missing = [n for n in s.needs if n not in offered]
            if missing:
                raise InputError(
                    f"the sensor {s.name} needs {', '.join(missing)}, which {self.name} does not have",
                    where=self.name,
                    remedy=f"Leave it out, or take a model with it; {self.name} offers {', '.join(sorted(offered))}",
                )

    @cached_property
    def blocks(self) -> tuple[Block, ...]:
        """The blocks of the motion, then the unknown constants of the sensors, each once."""
        unknown = {b.name: b for s in self.sensors for b in s.blocks}
        return (*self.motion.blocks, *unknown.values())

    @cached_property
    def constants(self) -> tuple[Constant, ...]:
        """Every constant of the motion and of the sensors, once."""
        declared = [*self.motion.constants, *(c for s in self.sensors for c in s.constants)]
        return tuple({c.name: c for c in declared}.values())

    @cached_property
    def drivers(self) -> tuple[str, ...]:
        """Channels that drive effects, ``temperature`` for example."""
        return tuple(dict.fromkeys(e.driver for es in self.noise.values() for e in es if e.driver))

    @cached_property
    def _attachment(self) -> tuple[tuple[StateInfo, ...], tuple[Attached, ...]]:
        """The effects' states (after the blocks') and which effect has which."""
        letters = {c: f"{i.bias}_{c[-1]}" for i in self.motion.inputs for c in i.channels if not i.scalar}
        drive = {d: sp.Symbol(d, real=True) for d in self.drivers}
        attachment = Attachment(letters, drive, sum(len(b.error_names) for b in self.blocks))
        for channel, unit in self.channel_units.items():
            for effect in self.noise.get(channel, ()):
                attachment.add(channel, unit, effect)
        return tuple(attachment.states), tuple(attachment.effects)

    @cached_property
    def states(self) -> tuple[StateInfo, ...]:
        """The error states in order: blocks first, then the effects' by channel."""
        blocks = tuple(
            StateInfo(n, b.unit, f"{b.title} {n.rsplit('_', 1)[-1]}", b.prior)
            for b in self.blocks
            for n in b.error_names
        )
        return blocks + self._attachment[0]

    @property
    def attached(self) -> tuple[Attached, ...]:
        """The effects of all channels in order."""
        return self._attachment[1]

    @cached_property
    def attitude(self) -> Attitude | None:
        """The attitude block, where there is one."""
        return next((b for b in self.blocks if isinstance(b, Attitude)), None)

    def _shown(self, channel: str, perturbed: bool) -> sp.Expr:
        """``sum C x`` of a channel's effects, for the estimate or for the truth."""
        total = sp.Integer(0)
        for a in self.attached:
            for c, k, new in zip(a.form.C, a.states, a.brought):
                if a.channel == channel and new:
                    info = self.states[k]
                    total += sp.sympify(c, strict=True) * (info.symbol + (info.error if perturbed else 0))
        return total

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
        """The true (or estimated) value of each input triad in symbols."""
        shown = {
            i.name: sp.Matrix([self.freed(c, perturbed) for c in i.channels]) for i in self.motion.inputs
        }
        return dict(self.motion.true_inputs(self._view(perturbed), shown))

    def freed(self, channel: str, perturbed: bool) -> sp.Expr:
        """What an input shows without its effects, of the estimate or of the truth."""
        noise = sp.Symbol(f"n_{channel}", real=True) if perturbed else 0
        return sp.Symbol(channel, real=True) - self._shown(channel, perturbed) - noise

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
        """The expected measurement of the estimate without effects, shape (m, 1)."""
        return sensor.predict(self._seen(False))

    @cached_property
    def noise_symbols(self) -> tuple[sp.Symbol, ...]:
        """White noises that drive the error: of the inputs, of the blocks, then of the effects' states."""
        inputs = [sp.Symbol(f"n_{c}", real=True) for i in self.motion.inputs for c in i.channels]
        driven = [sp.Symbol(f"w_{n}", real=True) for b in self.driven for n in b.error_names]
        return (*inputs, *driven, *(sp.Symbol(f"w_{s.name}", real=True) for s in self._attachment[0]))

    @cached_property
    def driven(self) -> tuple[Vector, ...]:
        """The blocks that white noise drives."""
        return tuple(b for b in self.blocks if isinstance(b, Vector) and b.driven)

    @cached_property
    def noise_driven_blocks(self) -> tuple[tuple[Vector, ...], sp.Matrix, sp.Matrix]:
        """Blocks that white noise moves and nothing else: dynamics A and driving density W of their components."""
        if not self.driven:
            return (), sp.zeros(0, 0), sp.zeros(0, 0)
        rates = self.rates(False)
        own = [b for b in self.blocks if isinstance(b, Vector) and (b.driven or any(rates[b.name]))]
        x = sp.Matrix([s for b in own for s in b.nominal])
        while closed := [b for b in own if _linear(rates[b.name], x)]:
            if len(closed) == len(own):
                break
            own, x = closed, sp.Matrix([s for b in closed for s in b.nominal])
        A = sp.Matrix.vstack(*(rates[b.name].jacobian(x) for b in closed)) if closed else sp.zeros(0, 0)
        W = sp.diag(*(sp.Float(b.driven) ** 2 for b in closed for _ in b.error_names))
        return tuple(closed), A, W

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
        effects = self.states[len(self.states) - len(self._attachment[0]) :]
        return (*self.error.corrected, *(s.symbol + s.error for s in effects))

    @cached_property
    def effect_dynamics(self) -> tuple[sp.Matrix, sp.Matrix]:
        """Dynamics A and driving density W of the effects' states, shape (m, m)."""
        n0 = sum(len(b.error_names) for b in self.blocks)
        m = len(self._attachment[0])
        A, W = sp.zeros(m, m), sp.zeros(m, m)
        for a in self.attached:
            for i, k in enumerate(a.states):
                for j, l in enumerate(a.states):
                    W[k - n0, l - n0] += sp.sympify(a.form.W[i][j], strict=True)
                    A[k - n0, l - n0] += sp.sympify(a.form.A[i][j], strict=True)
        return A, W

    def white(self, channel: str) -> tuple[sp.Expr, sp.Expr]:
        """White noise of a channel: density [U^2/Hz], and variance of the steps of its integral."""
        forms = [a.form for a in self.attached if a.channel == channel]
        return (
            sum((sp.sympify(f.V, strict=True) for f in forms), sp.Integer(0)),
            sum((sp.sympify(f.Z, strict=True) for f in forms), sp.Integer(0)),
        )

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
        inputs = [self.white(c)[0] + i.left_out**2 for i in self.motion.inputs for c in i.channels]
        driven = [sp.Float(b.driven) ** 2 for b in self.driven for _ in b.error_names]
        return sp.diag(*inputs, *driven, self.effect_dynamics[1]) if self.noise_symbols else sp.zeros(0, 0)

    def expected(self, sensor: Sensor, *, perturbed: bool = False) -> sp.Matrix:
        """The expected measurement with the effects of its channels, shape (m, 1)."""
        h = sensor.predict(self._seen(perturbed))
        return h + sp.Matrix([self._shown(c, perturbed) for c in sensor.channels])

    def H(self, sensor: Sensor) -> sp.Matrix:
        """The measurement's Jacobian, shape (m, n)."""
        columns = len(self.states) + len(self.noise_symbols)
        return expanded(slopes(self.expected(sensor), self._variation, columns))[:, : len(self.states)]

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
        parts = [
            self.name,
            *(repr(s) for s in self.states),
            sp.srepr(self.F),
            sp.srepr(self.G),
            sp.srepr(self.W),
            *(repr(c) for c in self.constants),
        ]
        parts += [
            f"{s.name} {s.sd!r} {s.left_out!r} {sp.srepr(self.expected(s))} {[sp.srepr(sp.Tuple(*self.white(c))) for c in s.channels]}"
            for s in self.sensors
        ]
        parts += [repr(line) for line in self.motion.late]
        parts += [f"{s.play.channel} {sp.srepr(sp.sympify(s.play.width))}" for s in self.sensors if s.play]
        return hashlib.sha256("\n".join(parts).encode()).hexdigest()


def _linear(rate: sp.Matrix, x: sp.Matrix) -> bool:
    """Whether a rate is `x` times numbers and nothing else."""
    J = rate.jacobian(x)
    return not J.free_symbols and (rate - J * x).expand().is_zero_matrix is True
