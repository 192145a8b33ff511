"""`FittedRandomError`, `NamedRandomError`: a random error of a channel in a scene, and the worlds that can have one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Protocol, Self, runtime_checkable

from kfgen.gap.core.search import Label
from kfgen.gap.scene.scene import HasNoiseSizes, Placed, Scene, ScenePoint


@dataclass(frozen=True)
class FittedRandomError:
    """A random error of a channel with its most likely size and time.

    Parameters
    ----------
    placed : Placed
    ci95 : mapping of str to (float, float)
        Intervals of its parameters [SI].
    evidence : float
        Over the scene without it, less the cost of choosing it [nats].
    occam : float
        Of that what is no likelihood: prior, volume, choice [nats].
    """

    placed: Placed
    ci95: Mapping[str, tuple[float, float]]
    evidence: float
    occam: float

    @property
    def label(self) -> Label:
        """Effect and place."""
        return self.placed.effect.name, self.placed.where


@dataclass(frozen=True)
class NamedRandomError:
    """A random error that is in the noise of an answer.

    Parameters
    ----------
    fitted : FittedRandomError
    gain : float
        Evidence of the whole over that without it [nats].
    probabilities : mapping of Label to float
        Of everything that competed.
    objection : str
        Why its course is none of a random error; empty where it is.
    """

    fitted: FittedRandomError
    gain: float
    probabilities: Mapping[Label, float] = field(default_factory=dict)
    objection: str = ""


@runtime_checkable
class HasRandomErrors(Scene, Protocol):
    """A world in which random errors of channels or states can be in the noise."""

    def likely_random_errors(self, point: ScenePoint) -> list[FittedRandomError]:
        """Random errors that are worth a look beside the effects of a point, by evidence."""

    def with_random_error(self, placed: Placed) -> Self:
        """The same world, about no effect, with one random error more in its noise."""

    def without_random_errors(self, where: str) -> Self:
        """The same world, about no effect, without the random errors of a channel in its noise."""

    def not_random(self, placed: Placed, point: ScenePoint) -> str:
        """In what the course of a random error in the noise, beside a point, is none of one; empty where in nothing."""


@runtime_checkable
class HasInertialNoise(HasRandomErrors, HasNoiseSizes, Protocol):
    """A world of a filter, whose inputs have noise."""

    def with_inertial_noise(self, point: ScenePoint) -> HasRandomErrors:
        """The world with the noise of inputs that its innovations beside a point ask for; itself where that is as assumed."""

    def with_noise_changes(self, point: ScenePoint) -> HasRandomErrors:
        """The world with noises that change from some time on, where innovations beside a point show it; itself where none does."""
