"""A model file with what was found in it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from kfgen.core.channel_names import acts_on
from kfgen.effects import Effect
from kfgen.effects.noise_model import Term
from kfgen.effects.plant.process_noise import ProcessNoise, root_density
from kfgen.effects.plant.terms import ParameterError, PlantEffect
from kfgen.gap.scene.scene import Placed
from kfgen.model.plant.user import Acting, Measurement, UserModel


def updated_model(
    model: UserModel, placed: Sequence[Placed], values: Mapping[str, float] | None = None
) -> UserModel:
    """The model with effects added and parameters as they were found.

    Parameters
    ----------
    model : UserModel
        As it is assumed.
    placed : sequence of Placed
        A wrong parameter or start of a state is corrected in its place; of an effect that the model has, coefficients add.
    values : mapping of str to float, optional
        Parameters that were fitted [SI].
    """
    parameters = {
        n: replace(p, value=float((values or {}).get(n, p.value))) for n, p in model.parameters.items()
    }
    acting, measurements = list(model.dynamics_effects), dict(model.measurements)
    states = dict(model.states)
    for p in placed:
        effect = p.effect
        if not isinstance(effect, PlantEffect):
            for name in [n for n in measurements if acts_on(p.where, n)]:
                measurements[name] = _with(measurements[name], effect)
        elif isinstance(effect, ParameterError) and p.where in states:
            start = states[p.where]
            states[p.where] = replace(start, initial=start.initial + float(effect.value))
        elif isinstance(effect, ParameterError):
            old = parameters[p.where]
            parameters[p.where] = replace(old, value=old.value + float(effect.value))
        elif effect.acts == "channel":
            measurements[p.where] = _with(measurements[p.where], effect)
        else:
            same = [k for k, a in enumerate(acting) if a.where == p.where and type(a.effect) is type(effect)]
            if same:
                acting[same[0]] = Acting(p.where, Term(_sum(acting[same[0]].effect, effect)))
            else:
                acting.append(Acting(p.where, Term(effect)))
    return replace(
        model,
        parameters=parameters,
        states=states,
        measurements=measurements,
        dynamics_effects=tuple(acting),
    )


def _with(measurement: Measurement, effect: Effect) -> Measurement:
    """A measurement with one more effect."""
    noise = measurement.noise
    return replace(measurement, noise=replace(noise, terms=(*noise.terms, Term(effect))))


def _sum(a: Effect, b: Effect) -> Effect:
    """Two effects of one kind: coefficients and delays add, noises as independent ones."""
    if isinstance(a, ProcessNoise) and isinstance(b, ProcessNoise):
        return ProcessNoise(root_density([a, b]))
    names = [p.name for p in a.estimated()]
    return replace(a, **{n: float(getattr(a, n)) + float(getattr(b, n)) for n in names})
