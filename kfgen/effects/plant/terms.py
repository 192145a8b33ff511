"""Effects in a plant: friction, drag, springs, what happens to an input, a wrong parameter.

They act inside the equations of a model file, not on a channel at rest: a term of a state's derivative
(`StateTerm`), a change of an input's samples (`InputChange`), a change of what a sensor shows (`kfgen.effects.plant.sensor`).

References
----------
.. [1] B. Armstrong-Hélouvry, P. Dupont, C. Canudas de Wit, A survey of models, analysis tools and compensation
   methods for the control of machines with friction, Automatica 30(7), 1994.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from kfgen.effects.effect import AddsNothingAtRest, parameter
from kfgen.effects.filter_role import FilterPlace, FilterRole, InsidePlant

Array = NDArray[np.float64]


@dataclass(frozen=True)
class PlantEffect(AddsNothingAtRest):
    """An effect inside a plant; a channel at rest shows nothing of it.

    Attributes
    ----------
    acts : str
        On a ``state``'s equation, an ``input``, a ``channel`` or a ``parameter``; `U` of its parameters is
        the unit of the state's derivative, of the input, of the channel, of the parameter.
    """

    acts: ClassVar[str] = ""

    def in_filter(self, place: FilterPlace) -> FilterRole:
        """A part of the equations of a model file."""
        return InsidePlant()


@dataclass(frozen=True)
class StateTerm(PlantEffect):
    """A term of a state's equation.

    Attributes
    ----------
    positional : bool
        It needs the state whose derivative is the state that it acts on.
    brakes : bool
        All friction of a plant together takes energy away.
    """

    acts: ClassVar[str] = "state"
    positional: ClassVar[bool] = False
    brakes: ClassVar[bool] = False

    def term(self, s: Any, p: Any) -> Any:
        """What is added to the derivative of a state, in symbols.

        Parameters
        ----------
        s : sympy expression
            The state, a velocity for example.
        p : sympy expression
            Its integral, a position; only used where `positional`.
        """
        raise NotImplementedError

    @property
    def rate(self) -> Any:
        """The fastest rate [1/s] that the term brings where it bends sharply; zero where it does not."""
        return 0.0

    @property
    def width(self) -> Any:
        """The range of the state over which it bends sharply; infinite where it does not."""
        return math.inf


@dataclass(frozen=True)
class ViscousFriction(StateTerm):
    """Friction proportional to speed: ``-c s``."""

    coefficient: Any = parameter("1/s", "signed")

    name: ClassVar[str] = "viscous_friction"
    title: ClassVar[str] = "viscous friction"
    separating_experiment: ClassVar[str] = "coasting down from two speeds"
    sentence_template: ClassVar[str] = "is slowed in proportion to its speed by {coefficient}"

    def term(self, s: Any, p: Any) -> Any:
        """``-c s``."""
        return -self.coefficient * s


@dataclass(frozen=True)
class CoulombFriction(StateTerm):
    """Dry friction of a constant level against the motion, smooth over a small speed `v0` [1]_."""

    level: Any = parameter("U", "signed")
    v0: Any = parameter("U*s", "setting", 1e-3)

    name: ClassVar[str] = "coulomb_friction"
    brakes: ClassVar[bool] = True
    title: ClassVar[str] = "dry (Coulomb) friction"
    separating_experiment: ClassVar[str] = "coasting down from two speeds, to rest"
    sentence_template: ClassVar[str] = "is slowed by dry friction of {level}"

    def term(self, s: Any, p: Any) -> Any:
        """``-level tanh(s / v0)``."""
        import sympy as sp

        return -self.level * sp.tanh(s / self.v0)

    @property
    def rate(self) -> Any:
        """``level / v0``, at rest."""
        return np.abs(self.level) / self.v0

    @property
    def width(self) -> Any:
        """``v0``."""
        return self.v0


@dataclass(frozen=True)
class QuadraticDrag(StateTerm):
    """Drag of a turbulent flow: ``-c s |s|``."""

    coefficient: Any = parameter("1/(U*s^2)", "signed")

    name: ClassVar[str] = "quadratic_drag"
    brakes: ClassVar[bool] = True
    title: ClassVar[str] = "quadratic drag"
    separating_experiment: ClassVar[str] = "coasting down from two speeds"
    sentence_template: ClassVar[str] = "is slowed in proportion to its speed squared by {coefficient}"

    def term(self, s: Any, p: Any) -> Any:
        """``-c s |s|``."""
        import sympy as sp

        return -self.coefficient * s * sp.Abs(s)


@dataclass(frozen=True)
class ConstantInput(StateTerm):
    """A constant force, torque or flow that the model does not know."""

    value: Any = parameter("U", "signed")

    name: ClassVar[str] = "constant_input"
    title: ClassVar[str] = "constant unmodelled input"
    separating_experiment: ClassVar[str] = "rest in several positions"
    sentence_template: ClassVar[str] = "is driven by a constant {value}"

    def term(self, s: Any, p: Any) -> Any:
        """``value``."""
        return self.value


@dataclass(frozen=True)
class Spring(StateTerm):
    """A restoring force in proportion to the position: ``-k p``."""

    coefficient: Any = parameter("1/s^2", "signed")

    name: ClassVar[str] = "spring"
    title: ClassVar[str] = "stiffness"
    separating_experiment: ClassVar[str] = "large and small deflections"
    sentence_template: ClassVar[str] = "is pulled back in proportion to its displacement by {coefficient}"
    positional: ClassVar[bool] = True

    def term(self, s: Any, p: Any) -> Any:
        """``-k p``."""
        return -self.coefficient * p


@dataclass(frozen=True)
class CubicSpring(StateTerm):
    """A restoring force that hardens: ``-k p^3``."""

    coefficient: Any = parameter("1/(U*U*s^6)", "signed")

    name: ClassVar[str] = "cubic_spring"
    title: ClassVar[str] = "hardening stiffness"
    separating_experiment: ClassVar[str] = "large and small deflections"
    sentence_template: ClassVar[str] = "is pulled back by the cube of its displacement by {coefficient}"
    positional: ClassVar[bool] = True

    def term(self, s: Any, p: Any) -> Any:
        """``-k p^3``."""
        return -self.coefficient * p**3


@dataclass(frozen=True)
class InputChange(PlantEffect):
    """A change of an input between the log and the plant: of its samples, then a lag, then a delay."""

    acts: ClassVar[str] = "input"

    def samples(self, u: Any) -> Any:
        """The samples as they act, numbers of shape (n, batch) or symbols; the same where only their timing changes."""
        return u

    @property
    def lag(self) -> Any:
        """Time constant of a first-order lag [s]; zero for none."""
        return 0.0

    @property
    def late(self) -> Any:
        """Delay [s]."""
        return 0.0


@dataclass(frozen=True)
class InputDelay(InputChange):
    """The input acts later than the log says."""

    delay: Any = parameter("s", "time")

    name: ClassVar[str] = "input_delay"
    title: ClassVar[str] = "delay of an input"
    separating_experiment: ClassVar[str] = "steps and slow ramps of the input"
    sentence_template: ClassVar[str] = "acts late by {delay}"

    @property
    def late(self) -> Any:
        """The delay [s]."""
        return self.delay


@dataclass(frozen=True)
class InputLag(InputChange):
    """An actuator that follows with a first-order lag."""

    tau: Any = parameter("s", "time")

    name: ClassVar[str] = "input_lag"
    title: ClassVar[str] = "lag of an actuator"
    separating_experiment: ClassVar[str] = "steps and slow ramps of the input"
    sentence_template: ClassVar[str] = "acts through a lag of {tau}"

    @property
    def lag(self) -> Any:
        """The time constant [s]."""
        return self.tau


@dataclass(frozen=True)
class InputNonlinearity(InputChange):
    """An actuator that is not linear: ``u + k2 u^2 + k3 u^3``."""

    k2: Any = parameter("1/(U)", "signed")
    k3: Any = parameter("1/(U)^2", "signed")

    name: ClassVar[str] = "input_nonlinearity"
    title: ClassVar[str] = "nonlinear actuator"
    separating_experiment: ClassVar[str] = "inputs of several sizes of both signs"
    sentence_template: ClassVar[str] = "acts with a square of {k2} and a cube of {k3}"

    def samples(self, u: Any) -> Any:
        """``u + k2 u^2 + k3 u^3``."""
        return u + self.k2 * u**2 + self.k3 * u**3


@dataclass(frozen=True)
class SquareLaw(InputChange):
    """An actuator part of which goes with the square of its input, as a propeller's thrust with its speed.

    ``(1 - share) u + share u |u| / full``: what flight controllers call a thrust curve; nothing is changed at `full`.
    """

    share: Any = parameter("", "signed")
    full: Any = parameter("U", "setting", 1.0)

    name: ClassVar[str] = "square_law"
    title: ClassVar[str] = "square law of an actuator"
    separating_experiment: ClassVar[str] = "inputs of several sizes of both signs"
    sentence_template: ClassVar[str] = "acts with its square by a share of {share}"

    def samples(self, u: Any) -> Any:
        """``(1 - share) u + share u |u| / full``."""
        return u * (1 - self.share + self.share * abs(u) / self.full)


@dataclass(frozen=True)
class Saturation(InputChange):
    """An actuator that gives no more than its limit."""

    limit: Any = parameter("U", "size")

    name: ClassVar[str] = "saturation"
    shrinks_with_size: ClassVar[bool] = True
    title: ClassVar[str] = "saturation of an actuator"
    separating_experiment: ClassVar[str] = "inputs up to the limit, of both signs"
    sentence_template: ClassVar[str] = "acts no stronger than {limit}"

    def samples(self, u: Any) -> Any:
        """Clipped to the limit of either sign."""
        return (abs(u + self.limit) - abs(u - self.limit)) / 2


@dataclass(frozen=True)
class InputDeadZone(InputChange):
    """An actuator that does nothing until its input exceeds a width, and gives what is beyond: ``u -+ width``."""

    width: Any = parameter("U", "size")

    name: ClassVar[str] = "input_dead_zone"
    title: ClassVar[str] = "dead zone of an actuator"
    separating_experiment: ClassVar[str] = "small and large inputs of both signs"
    sentence_template: ClassVar[str] = "does nothing within {width} of zero"

    def samples(self, u: Any) -> Any:
        """What is beyond the width of either sign."""
        return u - (abs(u + self.width) - abs(u - self.width)) / 2


@dataclass(frozen=True)
class ParameterError(PlantEffect):
    """A number of the model file that is off by `value`; JSON has the right one, by the number's own name."""

    value: Any = parameter("U", "signed")

    name: ClassVar[str] = "parameter_error"
    title: ClassVar[str] = "a wrong parameter"
    sentence_template: ClassVar[str] = "is off by {value}"
    acts: ClassVar[str] = "parameter"
