"""What follows in a log from moves of a plant's states that nobody saw, by linear responses from hole to hole."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from kfgen.gap.plant.lost_rows import Disturbed, LostRows
from kfgen.gap.plant.recorded_channel import RecordedChannel
from kfgen.model.plant.plant import Batch, Plant, Run, stacked

Array = NDArray[np.float64]
Counts = NDArray[np.intp]

MEAN_PART, PART_SD = 0.5, float(np.sqrt(1.0 / 12.0))
"""Part of the lost rows in which an input was already what it is after them: any is as likely."""
STEP = 1e-4
"""By which a state is moved to see what follows from it, in its sizes."""
FARTHEST_SIZES = 3.0
"""Standard deviation of where states are after a long hole, in their sizes."""


@dataclass(frozen=True)
class Responses:
    """What follows from a state that was moved, by segments that start after every hole.

    Parameters
    ----------
    starts : sequence of int
        The first sample of each.
    channels : ndarray, shape (channels, n, states)
        Change of each channel by a change of each state at the start of the segment [SI].
    onwards : ndarray, shape (segments, states, states)
        Change of the states at the start of the next segment; zero where that starts anew anyway.
    """

    starts: Sequence[int]
    channels: Array
    onwards: Array

    def columns(self, moves: Mapping[int, Array]) -> Array:
        """Changes of the channels by moves of the states, shape (states, k), at starts, shape (channels, n, columns)."""
        total = sum(m.shape[1] for m in moves.values())
        there = np.zeros((self.channels.shape[2], total))
        out = np.zeros((*self.channels.shape[:2], total))
        used = 0
        ends = (*self.starts[1:], self.channels.shape[1])
        for a, b, onwards in zip(self.starts, ends, self.onwards):
            if a in moves:
                k = moves[a].shape[1]
                there[:, used : used + k] = moves[a]
                used += k
            out[:, a:b, :used] = self.channels[:, a:b] @ there[:, :used]
            there[:, :used] = onwards @ there[:, :used]
        return out


@dataclass(frozen=True)
class Simulation:
    """A plant over the times of a log.

    Parameters
    ----------
    plant : Plant
    batch : Batch
        One column, or as many as are run at once.
    t : ndarray, shape (n,)
        [s].
    starts : sequence of int
        At which segments start.
    """

    plant: Plant
    batch: Batch
    t: Array
    starts: Sequence[int]

    def run(self, inputs: Mapping[str, Array], starts: Sequence[int], initial: Array) -> Run:
        """From initial states, shape (segments, states, k), under inputs, each of shape (n,)."""
        k = initial.shape[2]
        if self.batch.size == k:
            return self.plant.simulate(self.t, inputs, replace(self.batch, initial=initial), starts)
        many = replace(
            self.batch,
            parameters={n: np.repeat(v, k) for n, v in self.batch.parameters.items()},
            effects=tuple((w, stacked([e] * k)) for w, e in self.batch.effects),
            initial=initial,
        )
        return self.plant.simulate(self.t, inputs, many, starts)

    def reached(self, inputs: Mapping[str, Array], starts: Counts, initial: Array, at: Counts) -> Array:
        """States, shape (segments, states, k), at samples `at`, each of them before the next but one of the starts."""
        out = np.zeros(initial.shape)
        for turn in (0, 1):  # a segment that starts at a sample hides what arrives there
            mine = np.arange(turn, starts.size, 2)
            if not mine.size:
                continue
            first = [] if starts[mine[0]] == 0 else [0]
            X0 = np.concatenate([initial[: len(first)], initial[mine]])
            run = self.run(inputs, [*first, *starts[mine].tolist()], X0)
            out[mine] = run.states[at[mine]]
        return out


def responses(
    simulation: Simulation,
    inputs: Mapping[str, Array],
    X: Array,
    ends: Counts,
    sizes: Array,
    channels: Sequence[str],
) -> Responses:
    """What follows from moves of the states at samples.

    Parameters
    ----------
    simulation : Simulation
    inputs : mapping of str to ndarray, shape (n,)
    X : ndarray, shape (n, states)
        States of the simulation.
    ends : ndarray of int
        The samples.
    sizes : ndarray, shape (states,)
        Of the states.
    channels : sequence of str
        Those that are asked for, in order.
    """
    n, k = X.shape
    starts = np.union1d(simulation.starts, ends)
    step = STEP * sizes
    initial = X[starts][:, :, None] + np.concatenate([np.zeros((k, 1)), np.diag(step)], axis=1)
    shown = simulation.run(inputs, starts.tolist(), initial).channels
    change = np.array([(shown[c][:, 1:] - shown[c][:, :1]) / step for c in channels])
    there = simulation.reached(inputs, starts, initial, np.append(starts[1:], n - 1))
    onwards = (there[:, :, 1:] - there[:, :, :1]) / step
    onwards[np.isin(np.append(starts[1:], n), simulation.starts)] = 0.0
    return Responses(starts.tolist(), np.nan_to_num(change), np.nan_to_num(onwards))


def disturbed(
    lost: LostRows,
    simulation: Simulation,
    inputs: Mapping[str, Array],
    sizes: Array,
    recorded: Mapping[str, RecordedChannel],
) -> Disturbed:
    """What holes in a log do to the residuals of its channels.

    Parameters
    ----------
    lost : LostRows
    simulation : Simulation
    inputs : mapping of str to ndarray, shape (n,)
        [SI].
    sizes : ndarray, shape (states,)
        Of the states [SI].
    recorded : mapping of str to RecordedChannel
        By channel.
    """
    lost = lost.moving(inputs)
    if not lost.before.size or not sizes.size:
        return Disturbed()
    X = simulation.run(inputs, simulation.starts, simulation.batch.initial).states[:, :, 0]
    means, moves = moves_in_holes(lost, simulation, inputs, X, sizes)
    there = responses(simulation, inputs, X, lost.before + 1, sizes, list(recorded))
    changes = there.columns(means).sum(axis=2, keepdims=True), there.columns(moves)
    mean, E = (
        np.concatenate([r.whitener.ordinates(c[r.at]) for c, r in zip(part, recorded.values())])
        for part in changes
    )
    return Disturbed(E, mean[:, 0])


def moves_in_holes(
    lost: LostRows, simulation: Simulation, inputs: Mapping[str, Array], X: Array, sizes: Array
) -> tuple[dict[int, Array], dict[int, Array]]:
    """Moves of the states in holes by the first sample after each: their mean, shape (states, 1), and columns, (states, k).

    Each column is one standard deviation of a move that is independent of all others.

    Parameters
    ----------
    lost : LostRows
        Those in which something moves.
    simulation : Simulation
    inputs : mapping of str to ndarray, shape (n,)
        [SI].
    X : ndarray, shape (n, states)
        Where the states are.
    sizes : ndarray, shape (states,)
        Of the states [SI].
    """
    long, short = lost.before[lost.is_long], lost.before[~lost.is_long]
    moves = {int(k) + 1: FARTHEST_SIZES * np.diag(sizes) for k in long if k + 1 not in simulation.starts}
    found = np.nan_to_num(_moves(simulation, inputs, X, short))
    moves |= {int(k) + 1: PART_SD * m[:, np.any(m != 0.0, axis=0)] for k, m in zip(short, found)}
    return {int(k) + 1: MEAN_PART * m.sum(axis=1, keepdims=True) for k, m in zip(short, found)}, moves


def _moves(simulation: Simulation, inputs: Mapping[str, Array], X: Array, before: Counts) -> Array:
    """Changes of the states after holes, shape (holes, states, inputs), were each input after their first row what it is later."""
    out = np.zeros((before.size, X.shape[1], len(inputs)))
    steps = np.diff(simulation.t)
    first, rest = (np.array(steps) for _ in range(2))
    first[before] = float(np.median(steps))
    rest[before] -= first[before]
    early, late = (replace(simulation, t=np.concatenate([[0.0], np.cumsum(s)])) for s in (first, rest))
    begun = early.reached(inputs, before, X[before][:, :, None], before + 1)
    for i, (name, u) in enumerate(inputs.items()):
        later = np.array(u)
        later[before] = u[before + 1]
        there = late.reached({**inputs, name: later}, before, begun, before + 1)
        out[:, :, i] = there[:, :, 0] - X[before + 1]
    return out
