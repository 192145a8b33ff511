"""What a plant's log can show and physics allows of an effect with its values: a limit within the inputs, friction that brakes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from kfgen.effects.plant.sensor import Backlash
from kfgen.effects.plant.terms import InputDeadZone, Saturation, StateTerm
from kfgen.gap.scene.scene import Placed
from kfgen.model.plant.plant import Plant

Array = NDArray[np.float64]


def unreached(placed: Placed, inputs: Mapping[str, Array], channels: Mapping[str, Array]) -> str:
    """Why an effect is nothing that can be there or be seen; empty where it is.

    Parameters
    ----------
    placed : Placed
    inputs, channels : mapping of str to ndarray, shape (n,)
        What drives the plant and what it shows [SI].
    """
    effect, where = placed.effect, placed.where
    if isinstance(effect, Saturation) and float(effect.limit) >= _largest(inputs[where]):
        return f"{where} never reaches its limit"
    if isinstance(effect, InputDeadZone) and float(effect.width) >= _largest(inputs[where]):
        return f"{where} never leaves its width"
    if isinstance(effect, Backlash) and float(effect.width) >= float(np.ptp(channels[where])):
        return f"{where} never crosses its width"
    return ""


def does_drive(placed: Placed, plant: Plant, given: Sequence[Array], sizes: Array) -> bool:
    """Whether with friction of these values a state gains energy: less of it than a model has is no contradiction.

    Parameters
    ----------
    placed : Placed
    plant : Plant
        As it is assumed.
    given : sequence of ndarray, shape (1,)
        Its numbers, in the order of its equations.
    sizes : ndarray, shape (states,)
        Of the states, with which the state that it acts on is tried in both directions, all else at zero [SI].
    """
    effect, i = placed.effect, plant.states.index(placed.where)
    assert isinstance(effect, StateTerm)
    x = np.zeros((len(plant.states), 2))
    x[i] = sizes[i], -sizes[i]
    with np.errstate(all="ignore"):
        rates = plant.rates.values([*x, *np.zeros((len(plant.inputs), 2)), *given])[i]
    ahead, back = np.broadcast_to(rates, (2,))
    return bool(0.5 * (ahead - back) + float(effect.term(sizes[i], None)) > 0.0)


def rms(x: Array) -> float:
    """Root mean square of what is finite; zero of nothing."""
    good = x[np.isfinite(x)]
    return float(np.sqrt(np.mean(good**2))) if good.size else 0.0


def _largest(u: Array) -> float:
    return float(np.abs(u).max(initial=0.0))
