"""The biases of a filter by the input or sensor that they belong to, and the random walks that move them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import sympy as sp

from kfgen.model.noise_driven import Named, alone, name_alike
from kfgen.model.parts.motion import Input
from kfgen.model.parts.sensor import Sensor

if TYPE_CHECKING:
    from kfgen.model.filter import FilterModel


def parts(model: FilterModel) -> dict[str, Input | Sensor]:
    """Inputs and sensors by name."""
    found: list[Input | Sensor] = [*model.motion.inputs, *model.sensors]
    return {p.name: p for p in found}


def _by_channel(model: FilterModel) -> dict[str, dict[str, tuple[int, ...]]]:
    """Bias states of every channel, by the input or sensor that it belongs to."""
    owners = {c: name for name, part in parts(model).items() for c in part.channels}
    found: dict[str, dict[str, tuple[int, ...]]] = {}
    for effect in model.attached:
        if effect.channel in owners:
            own = found.setdefault(owners[effect.channel], {})
            held = [place for place, state in zip(effect.states, effect.form.states) if state.shared]
            own[effect.channel] = tuple(sorted({*own.get(effect.channel, ()), *held}))
    return found


def biases(model: FilterModel) -> dict[str, tuple[int, ...]]:
    """Bias states by input or sensor: constants and what wanders from them; not what decays by itself.

    Parameters
    ----------
    model : FilterModel
    """
    gathered = {name: tuple(sorted(sum(own.values(), ()))) for name, own in _by_channel(model).items()}
    return {name: states for name, states in gathered.items() if states}


def name_walks(model: FilterModel, W: sp.Matrix) -> Named:
    """Put symbols for the densities of the biases' random walks into the densities of a filter's noises.

    A density that depends on a driver or is shared with another noise, or of a bias that other dynamics move, stays as it
    is; the others are named as `name_alike` says.

    Parameters
    ----------
    model : FilterModel
    W : Matrix, shape (q, q)
        Of `FilterModel.noise_symbols`, the effects' states last; changed in place.

    Returns
    -------
    dict of str to (Symbol, Expr)
        Symbol and density ``K^2`` [SI^2/s].
    """
    A, _ = model.effect_dynamics
    to_noise, to_effect = W.rows - len(model.states), A.rows - len(model.states)
    named: Named = {}
    for owner, channels in _by_channel(model).items():
        walks: dict[str, int] = {}
        for channel, states in channels.items():
            for state in states:
                k = state + to_noise
                if alone(W, k) and not any(A[state + to_effect, :]):
                    walks[channel] = k
        named |= name_alike(W, walks, owner, parts(model)[owner].channels, "K2")
    return named
