"""`UserModel`: a plant of the user's own, in equations.

The file is TOML, ``format = "kfgen-model-1"``: parameters, states, inputs, time derivatives and measurements.
Everything inside an expression is SI; the effects of a measurement stand as in a noise file, those inside the
equations under ``[dynamics_effects]``, by the state or input on which they act.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType

from kfgen.core.errors import InputError
from kfgen.core.expression import Expression
from kfgen.core.files.toml_document import text_of
from kfgen.core.units import parse_unit
from kfgen.effects import Effect
from kfgen.effects.noise_model import ChannelNoise, Term
from kfgen.effects.plant.process_noise import ProcessNoise, root_density
from kfgen.effects.plant.terms import PlantEffect, StateTerm

FORMAT = "kfgen-model-1"


@dataclass(frozen=True)
class ModelParameter:
    """A parameter: the user's unit, its value [SI], the standard deviation of what is assumed about it (0: trusted)."""

    unit: str
    value: float
    sd: float = 0.0


@dataclass(frozen=True)
class StateStart:
    """A state: the user's unit, where it starts [SI], the standard deviation of that (infinite: unknown)."""

    unit: str
    initial: float = 0.0
    sd: float = float("inf")


@dataclass(frozen=True)
class Measurement:
    """A channel of the log: its value (SI) in symbols, its unit and its effects."""

    expression: Expression
    noise: ChannelNoise

    @property
    def unit(self) -> str:
        """The user's unit."""
        return self.noise.unit


@dataclass(frozen=True)
class Acting:
    """An effect inside the equations, on a state or an input."""

    where: str
    term: Term

    @property
    def effect(self) -> Effect:
        """The effect."""
        return self.term.effect


@dataclass(frozen=True)
class UserModel:
    """A model file.

    Parameters
    ----------
    name : str
    parameters : mapping of str to Number
    states : mapping of str to StateStart
    inputs : mapping of str to str
        The user's unit of each. Names that begin with ``ref_`` are samples of smooth signals, others are held.
    dynamics : mapping of str to Expression
        The time derivative of every state.
    measurements : mapping of str to Measurement
        By the channel of the log.
    dynamics_effects : tuple of Acting
    path : str
        Said in errors.

    Raises
    ------
    InputError
        An equation is missing or belongs to no state, a name is unknown, there is no measurement, or an effect
        does not act where it stands.
    """

    name: str
    parameters: Mapping[str, ModelParameter]
    states: Mapping[str, StateStart]
    inputs: Mapping[str, str]
    dynamics: Mapping[str, Expression]
    measurements: Mapping[str, Measurement]
    dynamics_effects: tuple[Acting, ...] = ()
    path: str = field(default="model", compare=False)

    def __post_init__(self) -> None:
        for part in ("parameters", "states", "inputs", "dynamics", "measurements"):
            object.__setattr__(self, part, MappingProxyType(dict(getattr(self, part))))
        self._check_equations()
        for name, expression in self._expressions():
            unknown = sorted(expression.names - set(self.names))
            if unknown:
                raise InputError(f"'{unknown[0]}' is not known", where=f"{self.path}: {name}")
        if not self.measurements:
            raise InputError(
                "there is no measurement in it", where=self.path, remedy="Add a table [measurements.CHANNEL]"
            )
        for acting in self.dynamics_effects:
            check_place(self, acting.effect, acting.where)

    def _check_equations(self) -> None:
        for name in self.dynamics:
            if name not in self.states:
                raise InputError(
                    f"'{name}' is no state, but has an equation",
                    where=f"{self.path}: [dynamics]",
                    remedy=f'Declare it under [states], as {name} = "rad"; known are {", ".join(self.states) or "none"}',
                )
        for name in self.states:
            if name not in self.dynamics:
                raise InputError(
                    f"the state '{name}' has no equation",
                    where=f"{self.path}: [dynamics]",
                    remedy=f'Add its derivative; an unknown constant is {name} = "0"',
                )

    def _expressions(self) -> list[tuple[str, Expression]]:
        equations = [(f"[dynamics] {n}", e) for n, e in self.dynamics.items()]
        return equations + [(f"[measurements.{n}]", m.expression) for n, m in self.measurements.items()]

    @property
    def names(self) -> tuple[str, ...]:
        """What expressions may use: states, parameters, inputs."""
        return (*self.states, *self.parameters, *self.inputs)

    def position_of(self, state: str) -> str | None:
        """The state whose derivative is exactly this state, where there is one."""
        from kfgen.core.expression import symbol

        return next((p for p, e in self.dynamics.items() if e.value == symbol(state)), None)

    @property
    def process_noise(self) -> dict[str, float]:
        """Root density of the white noise that drives states, of those that it drives [SI/sqrt(Hz)]."""
        own: dict[str, list[PlantEffect]] = {}
        for a in self.dynamics_effects:
            if isinstance(a.effect, ProcessNoise):
                own.setdefault(a.where, []).append(a.effect)
        return {n: root_density(effects) for n, effects in own.items()}

    def unit_at(self, where: str, effect: PlantEffect | type[PlantEffect]) -> str:
        """The unit `U` of an effect's parameters at a place: SI of a state's derivative, else the user's."""
        if effect.acts == "state":
            return parse_unit(f"({parse_unit(self.states[where].unit).si})/s").si
        if effect.acts == "input":
            return self.inputs[where]
        return self.parameters[where].unit if effect.acts == "parameter" else self.measurements[where].unit


def check_place(model: UserModel, effect: Effect, where: str) -> None:
    """Raise `InputError` where an effect does not act inside the equations at that place."""
    place = f"{model.path}: [dynamics_effects] {where}"
    if not isinstance(effect, PlantEffect) or effect.acts not in ("state", "input"):
        raise InputError(
            f"{effect.name} does not act on the dynamics",
            where=place,
            remedy="It belongs to a measurement's effects or to a parameter's value",
        )
    known = model.states if effect.acts == "state" else model.inputs
    if where not in known:
        raise InputError(
            f"{effect.name} acts on no {effect.acts} '{where}'",
            where=place,
            remedy=f"Known are {', '.join(known) or 'none'}",
        )
    if isinstance(effect, StateTerm) and effect.positional and model.position_of(where) is None:
        raise InputError(
            f"{effect.name} needs a state whose derivative is '{where}', and there is none",
            where=place,
            remedy=f'Add a state with the equation "{where}"',
        )


def read_model(path: str | Path) -> UserModel:
    """Read a model file.

    Raises
    ------
    InputError
        No such file, no TOML, another format, an unknown name, effect, parameter or unit.
    """
    from kfgen.model.plant.file import parse_model

    return parse_model(text_of(path), str(path))
