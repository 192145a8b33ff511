"""`AttachedError`: an error of a sensor in a filter, its parameters known constants or states.

The expression is the effect's own (`kfgen.effects.inertial`): scale factors, misalignments, sensitivity to forces, iron,
lever arms and delays are declared once, for the simulation, the gap and the filter. Options of a model such as
``scale_factors`` are spellings of an attached effect.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import sympy as sp

from kfgen.core.channel_names import acts_on
from kfgen.core.units import derived_unit, parse_unit
from kfgen.effects import Effect
from kfgen.effects.filter_role import FilterRole, ReadingError, Use
from kfgen.effects.inertial.inertial_error import free
from kfgen.model.parts.constant import Constant
from kfgen.model.symbols.blocks import Vector

READING_ERROR = ReadingError()
LETTERS: Mapping[tuple[str, str], tuple[str, str]] = {
    ("scale_factor", "gyro"): ("sg", "gyro scale factor"),
    ("scale_factor", "accel"): ("sa", "accelerometer scale factor"),
    ("misalignment", "gyro"): ("mg", "gyro misalignment"),
    ("misalignment", "accel"): ("ma", "accelerometer misalignment"),
    ("g_sensitivity", "gyro"): ("dg", "gyro g-sensitivity"),
    ("soft_iron", "mag"): ("si", "soft iron"),
    ("lever_arm", "gnss"): ("l", "GNSS lever arm"),
    ("time_delay", "gnss"): ("td", "GNSS delay"),
    ("time_delay", "mag"): ("tm", "magnetometer delay"),
}
"""Paper letter and title of the parameters of an effect on a sensor; others have the names of both."""


@dataclass(frozen=True)
class ErrorParameter:
    """One parameter of an attached effect.

    Parameters
    ----------
    parameter : str
        Its name in the effect.
    block, axis : str
        Its symbol is ``block_axis``, or ``block`` where the axis is empty.
    unit, title : str
        SI unit; in words.
    value, sd : float
        Its value, and the standard deviation of its prior where it is a state [SI].
    """

    parameter: str
    block: str
    axis: str
    unit: str
    title: str
    value: float
    sd: float = 0.0

    @property
    def name(self) -> str:
        """Of its symbol."""
        return f"{self.block}_{self.axis}" if self.axis else self.block

    @property
    def symbol(self) -> sp.Symbol:
        """Its symbol."""
        return sp.Symbol(self.name, real=True)


@dataclass(frozen=True)
class AttachedError:
    """An effect on a channel or on all channels of a sensor.

    Parameters
    ----------
    where : str
        ``gyro_x``, or the sensor: ``gyro``, ``mag``, ``gnss``.
    effect : Effect
        With its values.
    parameters : tuple of ErrorParameter
        Those that have symbols; the others stand as numbers.
    known : bool
        Corrected by its value (constants) instead of being estimated (states).
    role : FilterRole
        How it changes a reading.
    """

    where: str
    effect: Effect
    parameters: tuple[ErrorParameter, ...]
    known: bool
    role: FilterRole = READING_ERROR

    def acts_on(self, channel: str) -> bool:
        """Whether a channel shows it."""
        return acts_on(self.where, channel)

    @cached_property
    def symbolic(self) -> Any:
        """The effect with symbols for its parameters."""
        return replace(self.effect, **{p.parameter: p.symbol for p in self.parameters})

    @property
    def is_small(self) -> bool:
        """Whether it starts from nothing, so that first order in it is enough to undo it."""
        return all(p.value == 0.0 for p in self.parameters)

    @property
    def constants(self) -> tuple[Constant, ...]:
        """Its known values, which firmware may set."""
        if not self.known:
            return ()
        return tuple(
            Constant(p.name, p.unit, p.value, f"{p.title}{', ' if p.axis else ''}{p.axis}")
            for p in self.parameters
        )


def attached(
    where: str,
    effect: Effect,
    unit: str,
    use: Use,
    names: Sequence[str] | None = None,
    role: FilterRole = READING_ERROR,
) -> AttachedError:
    """An effect attached to a place.

    Parameters
    ----------
    where : str
        Channel or sensor.
    effect : Effect
        With its values [SI].
    unit : str
        SI unit of the channel.
    use : Use
        Known (constants) or a state with these standard deviations [SI]; a state without one has its own size.
    names : sequence of str, optional
        The parameters that have symbols, with the paper letters of an option; those that are not at zero where left out.
    role : FilterRole
        How it changes a reading.
    """
    chosen = tuple(names) if names is not None else _parameters(effect, use.known)
    sensor, _, axis = where.partition("_")
    letter, title = LETTERS.get((effect.name, sensor), ("", ""))
    if not letter or (use.known and names is None):
        letter, title, axis = f"{where}_{effect.name}", f"{effect.title} of {where}", ""
    single = len(effect.estimated()) == 1
    units = {p.name: p.unit for p in effect.parameters()}
    parameters = []
    largest = max((abs(float(getattr(effect, n))) for n in chosen), default=0.0)
    for name in chosen:
        value, sd = float(getattr(effect, name)), use.sd.get(name, 0.0)
        si = parse_unit(derived_unit(units[name], unit)).si
        parameters.append(
            ErrorParameter(
                name, letter, axis if single else name, si, title, value, sd or abs(value) or largest
            )
        )
    return AttachedError(where, effect, tuple(parameters), use.known, role)


def unknown_state(sd: float, names: Sequence[str]) -> Use:
    """A state of which nothing but a standard deviation [SI] is known, the same for some parameters."""
    return Use(known=False, sd=dict.fromkeys(names, sd))


def _parameters(effect: Effect, known: bool) -> tuple[str, ...]:
    """Those that are not at zero; of a vector that is to be estimated all three."""
    names = tuple(p.name for p in effect.estimated())
    if not known and names == ("x", "y", "z"):
        return names
    return tuple(p.name for p in free(effect)) or names[:1]


def error_blocks(errors: Iterable[AttachedError]) -> tuple[Vector, ...]:
    """The states of errors, those of one letter as one block.

    Parameters
    ----------
    errors : iterable of AttachedError
        In the order of the states.
    """
    found: dict[str, dict[str, ErrorParameter]] = {}
    for p in (p for e in errors if not e.known for p in e.parameters):
        found.setdefault(p.block, {}).setdefault(p.axis, p)
    return tuple(_block(name, tuple(own.values())) for name, own in found.items())


def _block(name: str, own: tuple[ErrorParameter, ...]) -> Vector:
    values = tuple(p.value for p in own)
    return Vector(
        name,
        tuple(p.axis for p in own),
        own[0].unit,
        own[0].title,
        own[0].sd,
        values if any(values) else (),
        priors=tuple(p.sd for p in own) if len({p.sd for p in own}) > 1 else (),
    )


def merged(first: Sequence[AttachedError], second: Sequence[AttachedError]) -> tuple[AttachedError, ...]:
    """Errors of a file before those of a model's options: a state that the file describes is taken from there.

    Parameters
    ----------
    first : sequence of AttachedError
        Of the options.
    second : sequence of AttachedError
        Of the file.
    """
    better = {p.name: p for e in second if not e.known for p in e.parameters}
    out = []
    for e in first:
        parameters = tuple(
            replace(p, value=better[p.name].value, sd=better[p.name].sd)
            if p.name in better and not e.known
            else p
            for p in e.parameters
        )
        out.append(replace(e, parameters=parameters))
    names = {p.name for e in out if not e.known for p in e.parameters}
    rest = [e for e in second if e.known or not {p.name for p in e.parameters} <= names]
    return (*out, *rest)
