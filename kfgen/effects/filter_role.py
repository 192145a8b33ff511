"""What an effect is in a filter: every effect says it, and what it does not say is refused in words.

A role is data; `kfgen.model.filter` turns it into states, constants, noise and registers. An effect whose parameters a
filter can correct for is either *known* (corrected by its value) or a *state* (estimated, its value the mean and its
interval the prior).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from kfgen.effects.linear_system import LinearSystem


@dataclass(frozen=True)
class FilterPlace:
    """Where an effect meets a filter.

    Parameters
    ----------
    channel : str
        The channel, ``gyro_x``, or the sensor whose channels share the effect, ``mag``.
    measured : bool
        Whether the filter predicts the channel (a sensor) instead of being driven by it (an input).
    drive : mapping of str to symbol
        Recorded drivers by name.
    """

    channel: str
    measured: bool
    drive: Mapping[str, Any] = field(default_factory=dict)


class FilterRole:
    """What an effect is in a filter; one of the classes of this file."""


@dataclass(frozen=True)
class LinearStates(FilterRole):
    """The states, the driving noise and the white noise of a linear system are appended."""

    system: LinearSystem


@dataclass(frozen=True)
class StoredValue:
    """A number that the filter keeps beside its state, exactly known: the past of a driver.

    Parameters
    ----------
    name, unit, title : str
        Suffix of its name, SI unit, in words.
    driver : str
        The channel of whose first sample it has the value at the beginning.
    after : callable
        Its next value from its own symbol, the driver's symbol and the step [s].
    """

    name: str
    unit: str
    title: str
    driver: str
    after: Callable[[Any, Any, Any], Any]


@dataclass(frozen=True)
class DrivenOutput(FilterRole):
    """A coefficient times a course that follows a recorded driver.

    Parameters
    ----------
    course : callable
        The course in symbols, from the driver's symbol and the symbol of the stored value (if there is one).
    driver : str
        Name of the driver.
    stored : StoredValue, optional
        What the course needs of the driver's past.
    """

    course: Callable[[Any, Any], Any]
    driver: str
    stored: StoredValue | None = None


@dataclass(frozen=True)
class ReadingError(FilterRole):
    """A change of what is read: the effect's own expression of what should have been read."""


@dataclass(frozen=True)
class ReadingLag(FilterRole):
    """What is read is late: by a delay, or by the time constant of a low-pass.

    To first order in it; a known delay of all axes of a sensor is exact where samples are fused at their own times: over
    a log, and in the delayed horizon of emitted filters.
    """


@dataclass(frozen=True)
class AntennaOffset(FilterRole):
    """What is measured belongs to a point off the filter's own."""


@dataclass(frozen=True)
class NoiseFactor(FilterRole):
    """The variance of the channel's white noise is so many times as large; it may depend on a driver."""

    factor: Any


@dataclass(frozen=True)
class SampleVariance(FilterRole):
    """Every sample has so much more variance [U^2]; `alone` where that is all the white noise there is."""

    variance: Any
    alone: bool = False


@dataclass(frozen=True)
class SharedNoise(FilterRole):
    """White noise correlated by `rho` with that of the other channel that says so."""

    rho: Any


@dataclass(frozen=True)
class InsidePlant(FilterRole):
    """A term of the equations of a model file, or a change of its inputs or sensors: the model file carries it."""


@dataclass(frozen=True)
class NotModelled(FilterRole):
    """A filter is built without it, and every command says so.

    Parameters
    ----------
    why : str
        Why no filter models it there.
    instead : str
        What to do instead.
    """

    why: str
    instead: str


@dataclass(frozen=True)
class Use:
    """How a filter takes an effect whose parameters it can correct for.

    Parameters
    ----------
    known : bool
        Corrected by its value; else estimated, its value the mean of the prior.
    sd : mapping of str to float
        Standard deviations of the parameters [SI], where they are known.
    """

    known: bool = True
    sd: Mapping[str, float] = field(default_factory=dict)


KNOWN, STATE = "known", "state"
"""The words of a file that choose."""
