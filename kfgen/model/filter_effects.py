"""`FilterEffects`: what every effect of a filter's channels is in it, by the role that the effect says.

References
----------
.. [1] P. D. Groves, Principles of GNSS, Inertial, and Multisensor Integrated Navigation
   Systems, 2nd ed., 2013, sec. 14.2.6 (augmenting by sensor errors).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import sympy as sp

from kfgen.core.channel_names import AXES, acts_on
from kfgen.effects import Effect
from kfgen.effects.filter_role import (
    AntennaOffset,
    DrivenOutput,
    FilterPlace,
    FilterRole,
    InsidePlant,
    LinearStates,
    NoiseFactor,
    NotModelled,
    ReadingError,
    ReadingLag,
    SampleVariance,
    SharedNoise,
    Use,
)
from kfgen.effects.inertial.inertial_error import free
from kfgen.model.attach import Attachment, Omission
from kfgen.model.parts.attached_error import AttachedError, attached, error_blocks, merged
from kfgen.model.parts.motion import MotionModel
from kfgen.model.parts.sensor import Sensor
from kfgen.model.symbols.blocks import Block


@dataclass(frozen=True)
class FilterEffects:
    """The effects of a filter.

    Parameters
    ----------
    name : str
        Of the filter, said in words.
    motion : MotionModel
    sensors : tuple of Sensor
    noise : mapping of str to tuple of Effect
        By channel, or by sensor.
    uses : mapping of str to tuple of Use
        Of each of them.
    units : mapping of str to str
        SI unit of every channel, inputs first.
    ideal : bool
        Without errors of readings.
    """

    name: str
    motion: MotionModel
    sensors: tuple[Sensor, ...]
    noise: Mapping[str, tuple[Effect, ...]]
    uses: Mapping[str, tuple[Use, ...]]
    units: Mapping[str, str]
    ideal: bool = False

    @cached_property
    def inputs(self) -> frozenset[str]:
        """The channels that drive the motion."""
        return frozenset(c for i in self.motion.inputs for c in i.channels)

    def channels_of(self, where: str) -> tuple[str, ...]:
        """The channels of a place."""
        return tuple(c for c in self.units if acts_on(where, c))

    @cached_property
    def roles(self) -> tuple[tuple[str, Effect, Use, FilterRole], ...]:
        """Every effect with its place, its use and what it is there."""
        drive = {d: sp.Symbol(d, real=True) for d in self._driver_names}
        out = []
        for where, effects in self.noise.items():
            measured = not self.inputs & set(self.channels_of(where))
            place = FilterPlace(where, measured, drive)
            for effect, use in zip(effects, self.uses[where]):
                role = self._possible(where, effect.in_filter(place))
                out.append((where, effect, use, self._felt(where, effect, role)))
        return tuple(out)

    @cached_property
    def _offered(self) -> frozenset[str]:
        """What sensors may look at: the motion's blocks and offers."""
        x = {b.name: b.value for b in self.motion.blocks}
        u = {i.name: sp.Matrix([sp.Symbol(c, real=True) for c in i.channels]) for i in self.motion.inputs}
        return frozenset(x) | frozenset(self.motion.offers(x, self.motion.rates(x, u)))

    def _possible(self, where: str, role: FilterRole) -> FilterRole:
        """A role, or why the sensors of a place cannot have it."""
        sensors = [s for s in self.sensors if any(acts_on(where, c) for c in s.channels)]
        if isinstance(role, ReadingLag):
            blind = [s for s in sensors if not s.rate_needs or not set(s.rate_needs) <= self._offered]
            if blind or not sensors:
                return NotModelled(
                    f"{self.name} has no expression for the rate of {where}",
                    f"Shift the time stamps of {where}",
                )
        if isinstance(role, AntennaOffset) and any(s.arm_order < 0 for s in sensors):
            return NotModelled(
                f"{where} is no place and no velocity", "Give the arm to the sensor that measures one"
            )
        if isinstance(role, InsidePlant) and not self.motion.is_plant:
            return NotModelled(
                f"it acts inside the equations of a plant, and {self.name} is no model file",
                "Write it under [dynamics_effects] of a model file",
            )
        return role

    def _felt(self, where: str, effect: Effect, role: FilterRole) -> FilterRole:
        """A role, or that a plant's measurement does not know what the effect depends on."""
        if not isinstance(role, ReadingError) or not self.motion.is_plant:
            return role
        others = [p.name[1] for p in free(effect) if len(p.name) == 2 and set(p.name) <= set(AXES)]
        lacks = [n for n in getattr(effect, "needs", ()) if n != "warmth"]
        if lacks or any(a != where[-1] for a in others):
            return NotModelled(
                f"it depends on other axes or other sensors than {where}, which one measurement of a model file does not know",
                f"Write it into the expression of {where}",
            )
        return role

    @property
    def omitted(self) -> tuple[Omission, ...]:
        """The effects that the filter is built without."""
        return tuple(
            Omission(where, e.name, role.why, role.instead)
            for where, e, _, role in self.roles
            if isinstance(role, NotModelled)
        )

    @cached_property
    def errors(self) -> tuple[AttachedError, ...]:
        """The changes of readings: of the motion's options, of the sensors', of the effects of channels."""
        if self.ideal:
            return ()
        found: dict[tuple[str, str, str], AttachedError] = {}
        for e in (*self.motion.errors, *(e for s in self.sensors for e in s.errors)):
            found.setdefault((e.where, e.effect.name, ",".join(p.name for p in e.parameters)), e)
        own = [
            attached(where, e, self.units[self.channels_of(where)[0]], use, role=role)
            for where, e, use, role in self.roles
            if isinstance(role, ReadingError | ReadingLag | AntennaOffset)
        ]
        return merged(tuple(found.values()), own)

    @property
    def blocks(self) -> tuple[Block, ...]:
        """The blocks of the motion, what its inputs' errors do not know, then the same of the sensors, each once."""
        of_inputs = [e for e in self.errors if any(e.acts_on(c) for c in self.inputs)]
        unknown: dict[str, Block] = {b.name: b for b in error_blocks(of_inputs)}
        for s in self.sensors:
            mine = [e for e in self.errors if e not in of_inputs and any(e.acts_on(c) for c in s.channels)]
            for b in (*s.blocks, *error_blocks(mine)):
                unknown.setdefault(b.name, b)
        return (*self.motion.blocks, *unknown.values())

    @cached_property
    def _driver_names(self) -> tuple[str, ...]:
        every = [e for es in self.noise.values() for e in es]
        names = [n for e in every for n in (e.driver, *getattr(e, "filter_drivers", ())) if n]
        return tuple(dict.fromkeys(names))

    @cached_property
    def drivers(self) -> tuple[str, ...]:
        """The drivers of those that are in the filter."""
        used = [e for _, e, _, role in self.roles if not isinstance(role, NotModelled)]
        names = {n for e in used for n in (e.driver, *getattr(e, "filter_drivers", ()))}
        return tuple(d for d in self._driver_names if d in names)

    def attachment(self, offset: int) -> Attachment:
        """States, known outputs and changes of noise, the first state having the index `offset`."""
        letters = {c: f"{i.bias}_{c[-1]}" for i in self.motion.inputs for c in i.channels if not i.scalar}
        drive = {d: sp.Symbol(d, real=True) for d in self._driver_names}
        out = Attachment(letters, drive, offset)
        for channel, unit in self.units.items():
            for where, effect, use, role in self.roles:
                if not acts_on(where, channel):
                    continue
                if isinstance(role, LinearStates):
                    out.add_states(channel, unit, effect, role, use)
                elif isinstance(role, DrivenOutput):
                    out.add_output(channel, unit, effect, role, use)
                elif isinstance(role, NoiseFactor | SampleVariance | SharedNoise):
                    out.scale_noise(channel, role)
        return out
