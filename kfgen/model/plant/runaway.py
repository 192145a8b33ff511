"""Why a simulation cannot go on: a state that runs away, an equation that is no number there."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from kfgen.core.errors import InputError
from kfgen.core.units import from_si

if TYPE_CHECKING:
    from kfgen.model.plant.plant import Batch, Plant, Run

Array = NDArray[np.float64]

PARTS = 1000
"""Into which the last step is cut, to see whether its state grows or its equation ends."""
LARGE = 1e6
"""What a state is usually, times this, is no state any more at which an equation should hold."""
REMEDY = (
    "Check signs, units and values of its equations, start its states where they can be, and keep roots and "
    "logarithms from what they cannot take, as in sqrt(max(x, 0))"
)


def refuse(
    plant: Plant, t: Array, inputs: Mapping[str, Array], batch: Batch, run: Run, beyond: NDArray[np.bool_]
) -> None:
    """Raise `InputError` with time and state where a simulation is no number, or beyond all bounds.

    Parameters
    ----------
    t : ndarray, shape (n,)
        [s]
    inputs : mapping of str to ndarray, shape (n,)
        SI.
    batch, run : Batch, Run
        Of one column.
    beyond : ndarray of bool, shape (n,)
        Samples at which a channel is so far from the data that it cannot be a matter of a missing effect.
    """
    states = run.states[:, :, 0]
    lost = np.asarray(~np.isfinite(states).all(axis=1))
    blank = [n for n, h in run.channels.items() if not np.isfinite(h).all()]
    shown = np.column_stack([h[:, 0] for h in run.channels.values()])
    bad = lost | beyond | ~np.isfinite(shown).all(axis=1)
    if not bad.any():
        return
    k = int(np.argmax(bad))
    if lost[k]:
        words = _words(plant, batch, t, {n: float(u[max(k - 1, 0)]) for n, u in inputs.items()}, states, k)
    elif beyond[k]:
        words = f"runs away: at t = {t[k]:.6g} s {_state(plant, states[k])}, far beyond the data"
    else:
        words = f"cannot go on: at t = {t[k]:.6g} s, with {_state(plant, states[k])}, {blank[0]} is no number"
    raise InputError(f"the simulation of {plant.model.name} {words}", where=plant.model.path, remedy=REMEDY)


def _words(plant: Plant, batch: Batch, t: Array, inputs: Mapping[str, float], states: Array, k: int) -> str:
    """What happens on the way to sample k: an equation that is no number, or a state that runs away."""
    given = [float(v[0]) for v in plant.given(batch)]
    if k == 0:
        return f"cannot begin: at t = {t[0]:.6g} s there is no start for it"
    bound = LARGE * np.maximum(np.median(np.abs(states[:k]), axis=0), 1.0)
    k = 1 + int(np.flatnonzero((np.abs(states[:k]) < bound).all(axis=1))[-1])
    x, h = states[k - 1].copy(), float(t[k] - t[k - 1]) / PARTS
    with np.errstate(all="ignore"):
        for part in range(PARTS):
            rates = np.array([float(v) for v in plant.rates.values([*x, *inputs.values(), *given])])
            if not np.isfinite(rates).all() and np.all(np.abs(x) < bound):
                name = plant.states[int(np.argmin(np.isfinite(rates)))]
                now = t[k - 1] + part * h
                return f"cannot go on: at t = {now:.6g} s, with {_state(plant, x)}, the derivative of {name} is no number"
            if not np.isfinite(x + h * rates).all():
                break
            x = x + h * rates
    return f"diverges at t = {t[k]:.6g} s, from {_state(plant, states[k - 1])} at t = {t[k - 1]:.6g} s on"


def _state(plant: Plant, x: Array) -> str:
    """A state in words, in the model file's units."""
    pairs = zip(plant.model.states.items(), x.tolist())
    words = ", ".join(f"{n} = {from_si(v, s.unit):.4g} {s.unit}".rstrip() for (n, s), v in pairs)
    return words or "the inputs as they are"
