"""Samples of inertial sensors: means over the interval that a sample stands for.

A gyro sample is ``Log(R_k' R_k+1) / dt`` of what the triad turned by; an accelerometer sample is the mean specific force in
the axes of the middle of the interval. With them ``R <- R Exp(w dt)`` and ``v <- v + (R_k Exp(w dt/2) f + g) dt`` give the
motion back, coning and sculling included.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kfgen.manoeuvre.rotations import cumulative, exponential, inverse, logarithm, product, rotated
from kfgen.manoeuvre.truth import PIECE, WEIGHTS, Path, turned
from kfgen.model.parts.motion import AFTER, AT, BEFORE, INCREMENTS, Input

Array = NDArray[np.float64]

RATE, FORCE = "rad/s", "m/s^2"


def interval_samples(path: Path, edges: Array) -> dict[str, Array]:
    """What every input shows as a mean over intervals, without effects.

    Parameters
    ----------
    path : Path
        Its grid has the edges.
    edges : ndarray, shape (n + 1,)
        Where the intervals begin, and the last one ends [s].

    Returns
    -------
    dict of str to ndarray, shape (n,)
        By channel [SI].
    """
    inputs = path.model.motion.inputs
    at = path.places(edges)
    share = max(1, int(PIECE * (edges.size - 1) / max(at[-1] - at[0], 1)))
    pieces = [
        _piece(path, inputs, at[k : k + share + 1], edges[k : k + share + 1])
        for k in range(0, edges.size - 1, share)
    ]
    return {c: np.concatenate([p[c] for p in pieces]) for i in inputs for c in i.channels}


def by_convention(means: Array, instants: Array, samples: str) -> Array:
    """Samples (n, ...) by what they stand for: the interval after, the one before, or the instant.

    Before the first sample nothing is known: it is that of the interval after it.
    """
    if samples == AT:
        return instants
    return means if samples == AFTER else np.concatenate([means[:1], means[:-1]])


def middle(samples: str) -> float:
    """Where in time the middle of a sample's interval is, in periods from the sample."""
    return {AFTER: 0.5, AT: 0.0, BEFORE: -0.5, INCREMENTS: -0.5}[samples]


@dataclass(frozen=True)
class _Steps:
    """The steps of some intervals: their lengths, and where the intervals begin and end among them."""

    h: Array
    first: NDArray[np.intp]
    dt: Array

    def integral(self, values: Array) -> Array:
        """Over each interval, of values at nodes (steps, 3, ...)."""
        weights = self.h[:, None] * WEIGHTS
        inner = np.einsum("kj,kj...->k...", weights, values)
        return np.asarray(np.add.reduceat(inner, self.first, axis=0))


def _piece(path: Path, inputs: tuple[Input, ...], at: NDArray[np.intp], edges: Array) -> dict[str, Array]:
    part = slice(int(at[0]), int(at[-1]))
    values = path.nodes(part)
    steps = _Steps(np.diff(path.t)[part], at[:-1] - at[0], np.diff(edges))
    triads = {i.name: np.stack([values[c] for c in i.channels], axis=-1) for i in inputs}
    gyro = next((i for i in inputs if i.unit == RATE and not i.scalar), None)
    run = np.broadcast_to(np.array([1.0, 0.0, 0.0, 0.0]), (steps.h.size + 1, 4))
    if gyro is not None:
        whole, inside = turned(triads[gyro.name], steps.h)
        run = cumulative(exponential(whole))
    ends = at - at[0]
    phi = logarithm(product(inverse(run[ends[:-1]]), run[ends[1:]]))
    out: dict[str, Array] = {}
    for i in inputs:
        if i is gyro:
            found = phi / steps.dt[:, None]
        elif i.unit == FORCE and gyro is not None and not i.scalar:
            owner = np.repeat(np.arange(ends.size - 1), np.diff(ends))
            since = product(inverse(run[ends[:-1]])[owner], run[:-1])
            turning = product(since[:, None, :], exponential(inside))
            mean = steps.integral(rotated(turning, triads[i.name])) / steps.dt[:, None]
            found = rotated(exponential(-0.5 * phi), mean)
        else:
            found = steps.integral(triads[i.name]) / steps.dt[:, None]
        out |= {c: found[:, k] for k, c in enumerate(i.channels)}
    return out
