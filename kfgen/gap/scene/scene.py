"""`Scene`: what a world must say of itself for its gap to be found.

A world (a rate table, a plant) turns effects with their values into residuals in unit white noise.
Everything else (screening, fitting, comparing, intervals, tests) follows from that one function.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from kfgen.effects import Effect
from kfgen.effects.inertial.inertial_error import free
from kfgen.gap.core.result import NoiseScale, OutageDrift

Array = NDArray[np.float64]

Key = tuple[int, str]
"""A parameter: index of its effect, name."""


@dataclass(frozen=True)
class Placed:
    """An effect and where it acts: a channel, a triad of channels, a state or an input of a plant.

    Parameters
    ----------
    effect : Effect
    where : str
    prior_penalty_nats : float
        Nats by which it is rarer there than elsewhere, beside what its class says.
    held : tuple of str
        Its parameters that a fit leaves as they are.
    """

    effect: Effect
    where: str
    prior_penalty_nats: float = 0.0
    held: tuple[str, ...] = ()


@dataclass(frozen=True)
class Unknown:
    """A number of the world that is fitted beside the effects: a bias, an initial state, a trusted parameter.

    Parameters
    ----------
    name, unit : str
    value : float
        What is assumed [SI].
    sd : float
        Standard deviation of a Gaussian prior [SI]; infinite for none.
    begun : float, optional
        Where fits begin, if not there [SI].
    own : str
        How the model file calls it, where it says both value and standard deviation.
    far : float
        Standard deviations from what is assumed beyond which it does not hold.
    once : bool
        Whether it belongs to this record alone.
    """

    name: str
    unit: str
    value: float
    sd: float
    begun: float | None = None
    own: str = ""
    far: float = np.inf
    once: bool = False

    @property
    def start(self) -> float:
        """Where fits begin [SI]."""
        return self.value if self.begun is None else self.begun


@dataclass(frozen=True)
class ScenePoint:
    """A point of a scene: effects with values, and the values of its unknowns, shape (q,)."""

    placed: tuple[Placed, ...]
    unknowns: Array


def keys_of(placed: Sequence[Placed]) -> tuple[Key, ...]:
    """The parameters that are fitted."""
    return tuple((i, p.name) for i, x in enumerate(placed) for p in free(x.effect) if p.name not in x.held)


def is_signed(effect: Effect, name: str) -> bool:
    """Whether a parameter is fitted as it is, and not in its logarithm.

    Parameters
    ----------
    effect : Effect
    name : str
        Of its parameter.
    """
    return {p.name: p.kind for p in effect.parameters()}[name] == "signed"


def coordinates(point: ScenePoint) -> Array:
    """Parameters and unknowns as they are fitted, shape (p,): signed ones as they are, positive ones in their logarithm."""
    x = []
    for i, name in keys_of(point.placed):
        value = float(getattr(point.placed[i].effect, name))
        x.append(value if is_signed(point.placed[i].effect, name) else float(np.log(max(value, 1e-300))))
    return np.concatenate([np.array(x), point.unknowns])


def moved(point: ScenePoint, x: Array) -> ScenePoint:
    """The point at these coordinates.

    Parameters
    ----------
    point : ScenePoint
    x : ndarray, shape (k + q,)
        Coordinates of the effects' parameters, then the unknowns [SI].
    """
    placed, keys = list(point.placed), keys_of(point.placed)
    for (i, name), v in zip(keys, x.tolist()):
        value = v if is_signed(placed[i].effect, name) else float(np.exp(min(v, 690.0)))
        placed[i] = replace(placed[i], effect=replace(placed[i].effect, **{name: value}))
    return ScenePoint(tuple(placed), np.asarray(x[len(keys) :]))


def in_logarithms(point: ScenePoint) -> NDArray[np.bool_]:
    """Of each parameter, whether it is fitted in its logarithm."""
    return np.array([not is_signed(point.placed[i].effect, n) for i, n in keys_of(point.placed)], bool)


class Scene(Protocol):
    """A world: channels of a log against what is assumed about them."""

    @property
    def channels(self) -> tuple[str, ...]:
        """The channels that are compared."""

    @property
    def lengths(self) -> tuple[int, ...]:
        """Ordinates of each channel in the residuals, in order."""

    @property
    def dt(self) -> float:
        """Sampling period [s]."""

    @property
    def span(self) -> tuple[float, float]:
        """First and last time [s]."""

    @property
    def unknowns(self) -> tuple[Unknown, ...]:
        """What is fitted beside the effects."""

    def residuals(self, points: Sequence[ScenePoint]) -> Array:
        """Whitened residuals of all channels one after the other, shape (sum of lengths, points).

        Under the right point they are independent unit normal deviates.
        """

    def candidates(self, placed: Sequence[Placed]) -> list[list[Placed]]:
        """Every addition that the log allows beside these: the start values of each.

        Signed parameters may start at zero; sizes and times start above it, for they are fitted in their
        logarithms.
        """


def start_of(scene: Scene) -> ScenePoint:
    """Where fits begin: no effect, every unknown at its start."""
    return ScenePoint((), np.array([u.start for u in scene.unknowns], float))


def carried(point: ScenePoint, before: Scene, after: Scene) -> ScenePoint:
    """A point of a world in another one of the same log: unknowns keep their values by name, others are where fits begin.

    Parameters
    ----------
    point : ScenePoint
        Of the first.
    before, after : Scene
    """
    known = dict(zip((u.name for u in before.unknowns), point.unknowns.tolist()))
    return ScenePoint(point.placed, np.array([known.get(u.name, u.start) for u in after.unknowns], float))


@runtime_checkable
class Inspected(Protocol):
    """A world that can look at its readings before anything is fitted."""

    def faults(self) -> tuple[Placed, ...]:
        """What spoils the readings: wrong units, signs, axes."""


@runtime_checkable
class Undecided(Protocol):
    """A world in which another fault would explain the record as well as the first one."""

    @property
    def either(self) -> tuple[Placed, ...]:
        """Those other faults."""


@runtime_checkable
class Trusting(Protocol):
    """A world with numbers that are assumed."""

    def held(self, names: Collection[str]) -> Scene:
        """The same world with these unknowns at their assumed values; their errors are candidates."""

    def stated(self, where: str) -> float:
        """What is assumed about a number [SI]."""

    def refuted(self) -> tuple[Placed, ...]:
        """Errors of numbers that the log contradicts before errors of the model can add up."""


@runtime_checkable
class Integrating(Protocol):
    """A world whose residuals have unknowns integrated out."""

    def spread(self, point: ScenePoint) -> float:
        """Logarithm of how much wider that makes the data [nats]."""


@runtime_checkable
class Reaching(Protocol):
    """A world that knows what its signals reach, and what physics allows."""

    def unreached(self, placed: Placed) -> str:
        """Why an effect with its values is nothing that can be there or be seen; empty where it is."""


@runtime_checkable
class HasInputs(Protocol):
    """A world with inputs."""

    @property
    def constant_inputs(self) -> tuple[str, ...]:
        """Those that never change: no effect of them can be seen."""

    @property
    def follows_nowhere(self) -> bool:
        """Whether the assumed model follows the record nowhere."""


@runtime_checkable
class Telling(Protocol):
    """A world in which faults were left out or corrected, with which a fit means something."""

    @property
    def said(self) -> tuple[Placed, ...]:
        """Those faults."""


@runtime_checkable
class HasOwnNoiseLevels(Protocol):
    """A world in which nobody knows beforehand how loud the readings are."""

    @property
    def noise_level_sd_of_log(self) -> float:
        """Standard deviation of the logarithm of each channel's noise level before the log."""


@runtime_checkable
class HasWidths(Protocol):
    """A world whose residuals are innovations of a filter, which divides each by its own standard deviation."""

    @property
    def log_widths(self) -> Array:
        """Logarithms of the standard deviations by which readings were divided, channels one after the other, each in
        the order of time, shape (sum of lengths,).
        """


@runtime_checkable
class HasNoiseSizes(HasWidths, Protocol):
    """A world in which noises are not readings by themselves: a filter weighs its readings by their sizes."""

    @property
    def noise_scales(self) -> tuple[NoiseScale, ...]:
        """The noises whose size was estimated and is not as assumed."""

    def tuned(self, point: ScenePoint) -> Scene:
        """The same world, about no effect, with noises of the sizes that are most likely beside those of a point."""


@runtime_checkable
class InPieces(Protocol):
    """A world that may be simulated in pieces, each with a start of its own: a plant that nobody can follow for long."""

    def in_one_piece(self) -> Scene | None:
        """The same in one piece; None where it is, or where one simulation follows nothing."""

    def free_run(self, point: ScenePoint) -> float:
        """Share of the power of the channels that one simulation over the whole log leaves at a point, the mean of them."""


@runtime_checkable
class HasSeveralMaxima(Protocol):
    """A world in which a fit may end at another maximum than the highest: a plant whose equations are far from linear."""

    @property
    def has_several_maxima(self) -> bool:
        """Whether that is so."""


def has_several_maxima(scene: Scene) -> bool:
    """Whether a fit of a world may end at another maximum than the highest."""
    return isinstance(scene, HasSeveralMaxima) and scene.has_several_maxima


@runtime_checkable
class HasOutages(Protocol):
    """A world of a filter from which aiding readings can be kept away."""

    def drifts(self, share: float) -> tuple[OutageDrift, ...]:
        """How far it drifts in outages in a share of the log, its end."""


@runtime_checkable
class Linearised(Protocol):
    """A world whose residuals are linear about a point: it can be had about another one."""

    def about(self, point: ScenePoint) -> Scene:
        """The same world about a point."""


@runtime_checkable
class ReadingByReading(Protocol):
    """A world whose residuals are its readings one by one, where those of others are cosine transforms of them."""

    @property
    def is_reading_by_reading(self) -> bool:
        """Always."""
