"""Points of a plant's scene as the columns of one simulation."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np
from numpy.typing import NDArray

from kfgen.effects.plant.terms import ParameterError, PlantEffect
from kfgen.gap.scene.scene import Placed, ScenePoint
from kfgen.model.plant.plant import Batch, stacked
from kfgen.model.plant.user import UserModel

Kinds = tuple[tuple[str, type[PlantEffect]], ...]


def kinds_of(placed: Sequence[Placed]) -> Kinds:
    """Where effects act and what they are; the order is theirs.

    Parameters
    ----------
    placed : sequence of Placed
    """
    return tuple((p.where, type(p.effect)) for p in placed if isinstance(p.effect, PlantEffect))


def columns_of(
    model: UserModel,
    as_written: Collection[str],
    unknowns: tuple[Sequence[str], int],
    own: Sequence[tuple[str, PlantEffect]],
    points: Sequence[ScenePoint],
) -> Batch:
    """A column for each point.

    Parameters
    ----------
    model : UserModel
    as_written : collection of str
        States that start where the model file says.
    unknowns : (sequence of str, int)
        Their names: initial states of every segment, then parameters; and how many segments there are.
    own : sequence of (where, PlantEffect)
        The effects that the model file has.
    points : sequence of ScenePoint
        With the same effects at the same places.
    """
    names, segments = unknowns
    states = len(model.states)
    values = np.array([p.unknowns for p in points]).T.reshape(-1, len(points))
    initial = values[: states * segments].reshape(segments, states, len(points)).copy()
    for i, (name, state) in enumerate(model.states.items()):
        if name in as_written:
            initial[0, i] = state.initial
    fitted = dict(zip(names[states * segments :], values[states * segments :]))
    parameters = {
        n: np.array(fitted.get(n, np.full(len(points), p.value))) for n, p in model.parameters.items()
    }
    effects = [(w, stacked([e] * len(points))) for w, e in own]
    for column in zip(*(p.placed for p in points)):
        kind = [p.effect for p in column]
        where = column[0].where
        if isinstance(kind[0], ParameterError):
            error = np.array([float(e.value) for e in kind])
            if where in parameters:
                parameters[where] = parameters[where] + error
            else:
                initial[0, list(model.states).index(where)] += error
        else:
            effects.append((where, stacked([e for e in kind if isinstance(e, PlantEffect)])))
    return Batch(parameters, tuple(effects), initial)


def shared(points: Sequence[ScenePoint], segs: int, states: int) -> tuple[list[ScenePoint], NDArray[np.intp]]:
    """Fewer points with all the segments of many, since segments do not know of one another.

    Points that differ only in where segments start share simulations, each segment of which starts at another of the
    wanted places.

    Parameters
    ----------
    points : sequence of ScenePoint
    segs, states : int
        How many segments and states there are.

    Returns
    -------
    columns : list of ScenePoint
    source : ndarray, shape (points, segs)
        In which of them each segment of each point is; empty where nothing can be shared.
    """
    alike: dict[tuple[object, bytes], list[int]] = {}
    for j, p in enumerate(points):
        alike.setdefault((p.placed, p.unknowns[segs * states :].tobytes()), []).append(j)
    if segs == 1 or len(alike) == len(points):
        return [], np.zeros((0, segs), dtype=np.intp)
    columns: list[ScenePoint] = []
    source = np.zeros((len(points), segs), dtype=np.intp)
    for members in alike.values():
        first = points[members[0]]
        starts = np.array([points[j].unknowns[: segs * states] for j in members])
        starts = starts.reshape(len(members), segs, states)
        wanted = [np.unique(starts[:, s], axis=0, return_inverse=True) for s in range(segs)]
        source[members] = len(columns) + np.column_stack([np.ravel(w[1]) for w in wanted])
        for c in range(max(len(w[0]) for w in wanted)):
            initial = np.concatenate([w[0][min(c, len(w[0]) - 1)] for w in wanted])
            columns.append(
                ScenePoint(first.placed, np.concatenate([initial, first.unknowns[segs * states :]]))
            )
    return columns, source
