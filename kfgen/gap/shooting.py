"""How long one simulation can follow a record, and where the plant was: initial states by least squares.

A window grows from the first sample by doubling. It ends where the model, as it is believed, no longer follows the
data, or where the initial state would have to be known too well; there the next segment begins.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from kfgen.effects.plant import PlantEffect
from kfgen.model.expression import symbol
from kfgen.model.plant import Batch, Plant, stacked

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
FAR = 1e6
"""Deviations at which a simulation that diverges is held."""
HIDDEN = 1e-6
"""Deviations of the noise below which a change of a state by its size is not seen."""
ITERATIONS = 12
CONVERGED = 1e-3
"""Relative gain at which an iteration ends."""
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

    def _simulated(self, X0: Array, a: int, b: int) -> tuple[Array, Array]:
        """Weighted residuals (channels, b - a, batch) and last states (states, batch) of initial states."""
        size = X0.shape[1]
        parameters = {n: np.full(size, p.value) for n, p in self.plant.model.parameters.items()}
        effects = tuple((w, stacked([e] * size)) for w, e in self.effects)
        inputs = {n: u[a:b] for n, u in self.inputs.items()}
        run = self.plant.simulate(self.t[a:b], inputs, Batch(parameters, effects, X0[None]))
        out = []
        for name, full in self._full.items():
            seen, shown = full[a:b, None], run.channels[name]
            r = np.where(np.isfinite(shown), (seen - shown) * self.weights[name], FAR)
            out.append(np.where(np.isfinite(seen), np.clip(r, -FAR, FAR), 0.0))
        return np.array(out), run.states[-1]

    def left(self, X0: Array, a: int, b: int) -> Array:
        """Weighted residuals in samples a to b, shape (channels, b - a, batch), of initial states (states, batch)."""
        return self._simulated(X0, a, b)[0]

    def last(self, x0: Array, a: int, b: int) -> Array:
        """The states at sample b - 1, shape (states,), from those at sample a."""
        return np.asarray(self._simulated(x0[:, None], a, b)[1][:, 0])

    def guess(self, start: int, length: int) -> Array:
        """Initial states from the channels that show a state or its integral, shape (states,)."""
        model = self.plant.model
        shown = {m.expression.value: n for n, m in model.measurements.items() if n in self.data}
        out = np.array([s.initial for s in model.states.values()])
        for i, name in enumerate(model.states):
            for order, source in enumerate((name, model.position_of(name))):
                if source is not None and symbol(source) in shown:
                    out[i] = self._local(shown[symbol(source)], start, length, order)
                    break
        return out

    def _local(self, channel: str, start: int, length: int, order: int) -> float:
        """A channel's value or slope at a sample, by a cubic through the next ones."""
        at, values = self.data[channel]
        a, b = np.searchsorted(at, [start, start + length])
        t, y = self.t[at[a:b]] - self.t[start], values[a:b]
        if t.size < 4:
            return float(y[0]) if t.size and order == 0 else 0.0
        scale = float(t[-1])
        c = np.polynomial.polynomial.polyfit(t / scale, y, 3)
        return float(c[order] / scale**order)

    @cached_property
    def scale(self) -> Array:
        """A size of each state [SI], shape (states,)."""
        last = max(self.t.size - FIRST, 0)
        found = np.abs([self.guess(int(s), FIRST) for s in np.linspace(0, last, 8)]).max(axis=0)
        return np.where(found > 0.0, found, 1.0)

    def slope(self, x0: Array, a: int, b: int) -> tuple[Array, Array]:
        """Residuals, shape (channels, m), and their derivatives, (channels, m, states), by the initial states."""
        step = 1e-5 * np.maximum(np.abs(x0), self.scale)
        R = self.left(np.column_stack([x0, x0[:, None] + np.diag(step)]), a, b)
        return R[:, :, 0], (R[:, :, 1:] - R[:, :, :1]) / step

    def fit(self, x0: Array, a: int, b: int) -> Array:
        """Initial states by damped least squares over samples a to b, shape (states,)."""
        for _ in range(ITERATIONS):
            r, J = self.slope(x0, a, b)
            cost, k = float(np.sum(r**2)), x0.size
            tried = x0[:, None] + _damped(J.reshape(-1, k), r.ravel())
            costs = (self.left(tried, a, b) ** 2).sum(axis=(0, 1))
            best = int(np.argmin(costs))
            if costs[best] >= cost:
                break
            x0 = tried[:, best]
            if cost - costs[best] < CONVERGED * cost:
                break
        return x0

    def follows(self, x0: Array, a: int, b: int) -> bool:
        """Whether a simulation stays with the data, and answers not too much to where it starts."""
        r, J = self.slope(x0, a, b)
        for (name, full), part in zip(self._full.items(), r):
            good = np.isfinite(full[a:b])
            if good.sum() < 2:
                continue
            spread = float(np.std(full[a:b][good])) * self.weights[name]
            if float(np.sqrt(np.mean(part[good] ** 2))) > max(FOLLOWED * spread, NOISE):
                return False
        tenth = max(1, (b - a) // 10)
        early, late = (np.abs(part).max(axis=(0, 1)) for part in (J[:, :tenth], J[:, -tenth:]))
        return not bool((late > GROWTH * np.maximum(early, 1e-300)).any())

    def hidden(self, x0: Array) -> tuple[bool, ...]:
        """Which initial states change no channel as the model is believed."""
        if not x0.size:
            return ()
        shown = np.abs(self.slope(x0, 0, self.t.size)[1]).max(axis=(0, 1)) * self.scale
        return tuple(bool(v < HIDDEN) for v in shown)


def _damped(J: Array, r: Array) -> Array:
    """Steps for every damping, shape (states, dampings)."""
    JJ, Jr = J.T @ J, J.T @ r
    diagonal = np.diag(JJ)
    scale = np.sqrt(np.maximum(diagonal, 1e-12 * max(float(diagonal.max()), 1e-300)))
    A = JJ / np.outer(scale, scale)
    steps = [-np.linalg.solve(A + d * np.eye(scale.size), Jr / scale) / scale for d in DAMPING]
    return np.array(steps).T


def segments(shooting: Shooting) -> tuple[tuple[int, ...], Array]:
    """Where segments start, and their initial states, shape (segments, states)."""
    n, k = shooting.t.size, len(shooting.plant.states)
    if k == 0:
        return (0,), np.zeros((1, 0))
    least = min(n, max(FIRST, -(-n // SEGMENTS)))
    starts, initial, a = [0], [], 0
    before: Array | None = None
    while True:
        x0, b = _segment(shooting, a, least, before)
        initial.append(x0)
        if b == n:
            return tuple(starts), np.array(initial)
        before = shooting.last(x0, a, b + 1)
        starts.append(b)
        a = b


def _segment(shooting: Shooting, a: int, least: int, before: Array | None) -> tuple[Array, int]:
    """Initial states at sample a, and the sample up to which they are followed; at least so many."""
    n = shooting.t.size
    window = min(n - a, max(FIRST, least // 4))
    guesses = [shooting.guess(a, window)]
    if before is not None and np.isfinite(before).all():
        guesses.append(before)
    costs = (shooting.left(np.array(guesses).T, a, a + window) ** 2).sum(axis=(0, 1))
    x0 = shooting.fit(guesses[int(np.argmin(costs))], a, a + window)
    while a + window < n:
        longer = min(n - a, 2 * window)
        tried = shooting.fit(x0, a, a + longer)
        if longer > least and not shooting.follows(tried, a, a + longer):
            break
        x0, window = tried, longer
    if a + window == n or n - a < 2 * least:
        return x0, n
    return x0, min(a + max(window, least), n - least)
