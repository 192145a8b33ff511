"""How long one simulation can follow a record, and where the plant was: initial states by least squares.

The window grows from the first samples by doubling. It stops where the model, as it is believed, no longer
follows the data, or where the initial state would have to be known too well.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from kfgen.effects.plant import PlantEffect
from kfgen.model.expression import symbol
from kfgen.model.plant import Batch, Plant

Array = NDArray[np.float64]

FIRST = 24
"""Samples of the first window at least."""
SEGMENTS = 40
"""Segments at most."""
FOLLOWED = 0.25
"""Share of a channel's deviation that may be left where the model follows."""
NOISE = 2.0
"""Or this many deviations of its noise."""
GROWTH = 1e3
"""How much an error of the initial state may grow."""
ITERATIONS = 12
DAMPING = np.geomspace(1e-6, 1e3, 7)


@dataclass(frozen=True)
class Shooting:
    """What is fitted.

    Parameters
    ----------
    plant : Plant
    effects : tuple of (where, PlantEffect)
    t : ndarray, shape (n,)
    inputs : mapping of str to ndarray, shape (n,)
    data : mapping of str to (samples, values)
        By channel [SI].
    weights : mapping of str to float
        Inverse deviation of the noise of a sample [1/SI].
    """

    plant: Plant
    effects: tuple[tuple[str, PlantEffect], ...]
    t: Array
    inputs: Mapping[str, Array]
    data: Mapping[str, tuple[NDArray[np.intp], Array]]
    weights: Mapping[str, float]

    @cached_property
    def _full(self) -> dict[str, Array]:
        """Channels over all times, not a number where they have no sample, each of shape (n,)."""
        out = {}
        for name, (at, values) in self.data.items():
            out[name] = np.full(self.t.size, np.nan)
            out[name][at] = values
        return out

    def left(self, X0: Array, starts: Sequence[int], stop: int) -> Array:
        """Weighted residuals, shape (channels, stop, batch), of initial states (segments, states, batch)."""
        from kfgen.model.plant import stacked

        size = X0.shape[2]
        parameters = {n: np.full(size, p.value) for n, p in self.plant.model.parameters.items()}
        effects = tuple((w, stacked([e] * size)) for w, e in self.effects)
        inputs = {n: u[:stop] for n, u in self.inputs.items()}
        run = self.plant.simulate(self.t[:stop], inputs, Batch(parameters, effects, X0), starts)
        out = []
        for name, full in self._full.items():
            r = (full[:stop, None] - run.channels[name]) * self.weights[name]
            r = np.where(np.isfinite(run.channels[name]), r, 1e6)
            out.append(np.where(np.isfinite(full[:stop, None]), np.clip(r, -1e6, 1e6), 0.0))
        return np.array(out)

    def guess(self, starts: Sequence[int], length: int) -> Array:
        """Initial states from the channels that show a state or its integral, shape (segments, states)."""
        model = self.plant.model
        shown = {m.expression.value: n for n, m in model.measurements.items() if n in self.data}
        out = np.zeros((len(starts), len(model.states)))
        for i, (name, state) in enumerate(model.states.items()):
            position = model.position_of(name)
            out[:, i] = state.initial
            for order, source in ((0, name), (1, position)):
                if source is not None and symbol(source) in shown:
                    out[:, i] = [self._local(shown[symbol(source)], s, length, order) for s in starts]
                    break
        return out

    def _local(self, channel: str, start: int, length: int, order: int) -> float:
        """A channel's value or slope at a sample, by a parabola through the next ones."""
        at, values = self.data[channel]
        a, b = np.searchsorted(at, [start, start + length])
        t, y = self.t[at[a:b]] - self.t[start], values[a:b]
        if t.size < 4:
            return float(y[0]) if t.size and order == 0 else 0.0
        scale = float(t[-1]) or 1.0
        c = np.polynomial.polynomial.polyfit(t / scale, y, min(3, t.size - 1))
        return float(c[order] / scale**order)

    def fit(self, X0: Array, starts: Sequence[int], stop: int) -> tuple[Array, Array]:
        """Initial states by damped least squares, all segments at once, and their residuals at the end.

        Parameters
        ----------
        X0 : ndarray, shape (segments, states)
        """
        segs, k = X0.shape
        owner = np.searchsorted(np.asarray(starts), np.arange(stop), side="right") - 1
        r = self.left(X0[:, :, None], starts, stop)[:, :, 0]
        cost = _by_segment(r[:, :, None] ** 2, owner, segs)[:, 0]
        for _ in range(ITERATIONS if k else 0):
            J = self.slope(X0, starts, stop, r)
            JJ = np.array(
                [
                    [_by_segment((J[i] * J[j])[:, :, None], owner, segs)[:, 0] for j in range(k)]
                    for i in range(k)
                ]
            )
            Jr = np.array([_by_segment((J[i] * r)[:, :, None], owner, segs)[:, 0] for i in range(k)])
            steps = _damped(JJ.transpose(2, 0, 1), Jr.T)
            tried = self.left(X0[:, :, None] + steps, starts, stop)
            costs = _by_segment(tried**2, owner, segs)
            best = np.argmin(costs, axis=1)
            rows = np.arange(segs)
            better = costs[rows, best] < cost
            gained = float(np.max((cost - costs[rows, best]) / np.maximum(cost, 1e-12), initial=0.0))
            X0 = np.where(better[:, None], X0 + steps[rows, :, best], X0)
            chosen = best[owner]
            r = np.where(better[owner], tried[:, np.arange(stop), chosen], r)
            cost = np.where(better, costs[rows, best], cost)
            if gained < 1e-3:
                break
        return X0, r

    def slope(self, X0: Array, starts: Sequence[int], stop: int, r: Array) -> Array:
        """Derivative of the residuals by each initial state of the own segment, shape (states, channels, stop)."""
        k = X0.shape[1]
        step = 1e-5 * np.maximum(np.abs(X0).max(axis=0), self.scale)
        moved = np.repeat(X0[:, :, None], k, axis=2) + np.diag(step)
        return np.asarray(((self.left(moved, starts, stop) - r[:, :, None]) / step).transpose(2, 0, 1))

    @cached_property
    def scale(self) -> Array:
        """A size of each state [SI], shape (states,)."""
        found = np.abs(self.guess([int(s) for s in np.linspace(0, self.t.size - FIRST, 8)], FIRST)).max(
            axis=0
        )
        return np.where(found > 0.0, found, 1.0) if found.size else found

    def follows(self, r: Array) -> bool:
        """Whether residuals, shape (channels, m), are small against the data or like the noise."""
        for (name, full), part in zip(self._full.items(), r):
            good = np.isfinite(full[: part.size])
            if good.sum() < 2:
                continue
            spread = float(np.std(full[: part.size][good])) * self.weights[name]
            if float(np.sqrt(np.mean(part[good] ** 2))) > max(FOLLOWED * spread, NOISE):
                return False
        return True


def _by_segment(x: Array, owner: NDArray[np.intp], segs: int) -> Array:
    """Sums over channels and the samples of each segment, shape (segments, batch)."""
    total = x.sum(axis=0)
    out = np.zeros((segs, total.shape[1]))
    np.add.at(out, owner, total)
    return out


def _damped(JJ: Array, Jr: Array) -> Array:
    """Steps of every segment for every damping, shape (segments, states, dampings)."""
    k = JJ.shape[1]
    diagonal = np.einsum("sii->si", JJ)
    top = np.maximum(diagonal.max(axis=1, keepdims=True), 1e-300)
    scale = np.sqrt(np.maximum(diagonal, 1e-12 * top))
    A = JJ / (scale[:, :, None] * scale[:, None, :])
    steps = [-np.linalg.solve(A + d * np.eye(k), (Jr / scale)[:, :, None])[:, :, 0] / scale for d in DAMPING]
    return np.stack(steps, axis=2)


def segments(shooting: Shooting) -> tuple[tuple[int, ...], Array]:
    """Where segments start, and their initial states, shape (segments, states)."""
    n, k = shooting.t.size, len(shooting.plant.states)
    if k == 0:
        return (0,), np.zeros((1, 0))
    window = min(n, max(FIRST, n // 200))
    X0, _ = shooting.fit(shooting.guess([0], window), [0], window)
    reached = window
    while reached < n:
        longer = min(n, 2 * reached)
        tried, r = shooting.fit(X0, [0], longer)
        if not shooting.follows(r) or _grows(shooting, tried, longer, r):
            break
        X0, reached = tried, longer
    if reached == n:
        return (0,), X0
    count = min(SEGMENTS, int(np.ceil(n / reached)))
    starts = tuple(int(s) for s in np.linspace(0, n, count + 1)[:-1])
    guess = shooting.guess(starts, window)
    guess[0] = X0[0]
    fitted, _ = shooting.fit(guess, starts, n)
    return starts, fitted


def _grows(shooting: Shooting, X0: Array, stop: int, r: Array) -> bool:
    """Whether the channels answer far more to the initial state at the end than at the beginning."""
    J = np.abs(shooting.slope(X0, [0], stop, r))
    tenth = max(1, stop // 10)
    early, late = J[:, :, :tenth].max(axis=(1, 2)), J[:, :, -tenth:].max(axis=(1, 2))
    return bool((late > GROWTH * np.maximum(early, 1e-300)).any())
