"""A model file whose process noises are drawn: inputs of its own, held between samples, that only the truth has."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from kfgen.core.expression import Expression, symbol
from kfgen.effects.plant.process_noise import ProcessNoise
from kfgen.model.plant.user import UserModel

Array = NDArray[np.float64]


def with_drawn_process_noise(
    model: UserModel, t: Array, rng: np.random.Generator
) -> tuple[UserModel, dict[str, Array]]:
    """The model with an input for each state that noise drives, and the samples of these inputs, each of shape (n,) [SI].

    A sample that is held over a step h has the variance ``density^2 / h``: its integral is that of the white noise.

    Parameters
    ----------
    model : UserModel
    t : ndarray, shape (n,)
        Times [s]; they may be uneven.
    rng : numpy.random.Generator
    """
    inputs, dynamics, drawn = dict(model.inputs), dict(model.dynamics), {}
    steps = np.diff(t, append=2.0 * t[-1] - t[-2] if t.size > 1 else t[-1] + 1.0)
    for state, density in model.process_noise.items():
        name = f"noise_of_{state}"
        while name in model.names:
            name += "_"
        old = dynamics[state]
        inputs[name] = model.unit_at(state, ProcessNoise)
        dynamics[state] = Expression(f"{old.text} + {name}", old.value + symbol(name))
        drawn[name] = density / np.sqrt(steps) * rng.standard_normal(t.size)
    return replace(model, inputs=inputs, dynamics=dynamics), drawn
