"""What a record does not say of the time before it: where a slow sensor stood, what an input was that acts late.

Each is a unit normal deviate times a whitened column, which is integrated out of the residuals.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import reduce

import numpy as np
from numpy.typing import NDArray

from kfgen.effects.plant.sensor import SensorChange
from kfgen.effects.plant.terms import InputChange
from kfgen.gap.plant.recorded_channel import RecordedChannel
from kfgen.gap.scene.scene import ScenePoint
from kfgen.model.plant.plant import Batch

Array = NDArray[np.float64]

MAX_COLUMN_SQUARE_SUM = 1e18
"""Sum of squares of a column that a simulation has run away with."""


def of_sensors(
    recorded: Mapping[str, RecordedChannel], batch: Batch, t: Array, shown: Mapping[str, Array]
) -> list[Array]:
    """One column for each sensor that does not show at once what there is, shape (N, batch).

    Parameters
    ----------
    recorded : mapping of str to RecordedChannel
    batch : Batch
    t : ndarray, shape (n,)
        Times [s].
    shown : mapping of str to ndarray, shape (n, points)
        Simulated channels [SI].
    """
    out = []
    for where, effect in batch.effects:
        if isinstance(effect, SensorChange):
            parts = [
                r.begun(effect, t, shown[n]) if n == where else np.zeros((r.at.size, batch.size))
                for n, r in recorded.items()
            ]
            out.append(np.concatenate(parts))
    return out


def unsettled(batch: Batch, inputs: Mapping[str, Array]) -> dict[str, float]:
    """The inputs that act late, and one standard deviation of what they were before: as they are later, from the
    first on.

    Parameters
    ----------
    batch : Batch
    inputs : mapping of str to ndarray, shape (n,)
        [SI].
    """
    late = {w for w, e in batch.effects if isinstance(e, InputChange) and (np.any(e.lag) or np.any(e.late))}
    found = {n: float(np.sqrt(np.mean((inputs[n] - inputs[n][0]) ** 2))) for n in inputs if n in late}
    return {n: size for n, size in found.items() if size > 0.0}


def changed(
    recorded: Mapping[str, RecordedChannel], shown: Mapping[str, Array], anew: Mapping[str, Array]
) -> Array:
    """Whitened, how far simulated channels move, shape (N, columns).

    Parameters
    ----------
    recorded : mapping of str to RecordedChannel
    shown, anew : mapping of str to ndarray, shape (n, columns)
        Before and after [SI].
    """
    parts = []
    for name, r in recorded.items():
        with np.errstate(over="ignore", invalid="ignore"):  # of a simulation that runs away
            step = anew[name][r.at] - shown[name][r.at]
            parts.append(r.whitener.ordinates(np.where(np.isfinite(step), step, 0.0)))
    out = np.concatenate(parts)
    power = np.sum(np.minimum(np.abs(out), MAX_COLUMN_SQUARE_SUM) ** 2, axis=0)
    whole = np.all([np.isfinite(v).all(axis=0) for w in (shown, anew) for v in w.values()], axis=0)
    return np.where(whole & (power < MAX_COLUMN_SQUARE_SUM), out, 0.0)


def distinct(points: Sequence[ScenePoint], first: int) -> tuple[list[int], list[int]]:
    """Which points differ in more than so many `first` unknowns, and for each point the place of its own among them."""
    keys = [(p.placed, p.unknowns[first:].tobytes()) for p in points]
    place = {k: i for i, k in enumerate(dict.fromkeys(keys))}
    return [keys.index(k) for k in place], [place[k] for k in keys]


def integrated(left: Array, E: Array) -> Array:
    """Whitened residuals whose squares are what is left of the likelihood without a unit normal deviate times `E`."""
    power = np.sum(E**2, axis=0)
    kept = 1.0 / np.sqrt(1.0 + power)
    return np.asarray(left - E * (np.sum(E * left, axis=0) / np.maximum(power, 1e-300) * (1.0 - kept)))


def independent(columns: Sequence[Array]) -> list[Array]:
    """The columns as they are once those before them are integrated out."""
    out: list[Array] = []
    for column in columns:
        out.append(reduce(integrated, out, column))
    return out
