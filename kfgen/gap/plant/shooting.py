"""How long one simulation can follow a record, and where the plant was: initial states by least squares."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from kfgen.core.expression import symbol
from kfgen.core.time_budget import fit_is_over
from kfgen.effects.plant.terms import PlantEffect
from kfgen.model.plant.plant import Batch, Plant, Run, stacked
from kfgen.model.plant.runaway import refuse

Array = NDArray[np.float64]

MIN_FIRST_WINDOW_SAMPLES = 24
"""Samples of the first window at least."""
MAX_SEGMENTS = 40
"""Segments at most."""
MAX_FOLLOWED_SHARE = 0.5
"""Share of a channel's standard deviation that may be left where the model follows."""
MAX_FOLLOWED_NOISE_SD = 2.0
"""Or this many standard deviations of its noise."""
MAX_LEFT_SHARE_IN_ONE_PIECE = 0.75
"""Share of a channel's standard deviation that may be left over a whole record, where errors of a start do not grow."""
MAX_ERROR_GROWTH = 1e3
"""How much an error of the initial state may grow."""
MAX_TOTAL_ERROR_GROWTH = 30.0
"""How much an error of every initial state may grow."""
MAX_DISTANCE_SD = 1e6
"""Standard deviations at which a simulation that diverges is held."""
MAX_RANGES = 1e3
"""Ranges of a channel beyond which, and so many standard deviations, a simulation runs away."""
MAX_HIDDEN_SD = 1e-6
"""Standard deviations of the noise below which a change of a state by its size is not seen."""
DRAWS_OF_PARAMETERS = 32
"""Within what is assumed of them, from the best of which a whole record is fitted."""
MAX_ITERATIONS = 12
RELATIVE_GAIN_TOLERANCE = 1e-3
"""Relative gain at which an iteration ends."""
DAMPING_FACTORS = np.geomspace(1e-6, 1e3, 7)


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
        Inverse standard deviation of the noise of a sample [1/SI].

    A column of what is fitted has the initial states first, then the parameters that are not trusted.
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

    @cached_property
    def _swing(self) -> dict[str, float]:
        """Standard deviation of each channel within short windows [SI]: one that runs away over the record swings no wider."""
        size, out = max(MIN_FIRST_WINDOW_SAMPLES, self.t.size // MAX_SEGMENTS), {}
        for name, full in self._full.items():
            windows = [full[i : i + size] for i in range(0, max(full.size - size, 0) + 1, size)]
            inside = [float(np.var(w[np.isfinite(w)])) for w in windows if np.isfinite(w).sum() > 1]
            out[name] = float(np.sqrt(np.mean(inside))) if inside else np.inf
        return out

    @cached_property
    def free(self) -> dict[str, tuple[float, float]]:
        """The parameters that are not trusted: value and standard deviation [SI]."""
        return {n: (p.value, p.sd) for n, p in self.plant.model.parameters.items() if p.sd > 0.0}

    @property
    def states(self) -> int:
        """How many."""
        return len(self.plant.states)

    @cached_property
    def trusted(self) -> Array:
        """The values of those parameters [SI]."""
        return np.array([v for v, _ in self.free.values()])

    def _pulls(self, X0: Array) -> Array:
        """How far parameters are from what is assumed, in standard deviations, shape (parameters, batch)."""
        deviations = np.array([sd for _, sd in self.free.values()])
        return np.asarray((X0[self.states :] - self.trusted[:, None]) / deviations[:, None])

    def cost(self, X0: Array, a: int, b: int) -> Array:
        """Sums of squares over samples a to b, and of what is assumed, shape (batch,)."""
        return np.asarray((self.left(X0, a, b) ** 2).sum(axis=(0, 1)) + (self._pulls(X0) ** 2).sum(axis=0))

    def _simulated(self, X0: Array, a: int, b: int) -> tuple[Array, Array]:
        """Weighted residuals (channels, b - a, batch) and last states (states, batch) of what is fitted."""
        run = self._run(X0, a, b)[1]
        out = []
        for name, full in self._full.items():
            seen, shown = full[a:b, None], run.channels[name]
            with np.errstate(over="ignore"):  # of a simulation that runs away
                r = np.where(np.isfinite(shown), (seen - shown) * self.weights[name], MAX_DISTANCE_SD)
            out.append(np.where(np.isfinite(seen), np.clip(r, -MAX_DISTANCE_SD, MAX_DISTANCE_SD), 0.0))
        return np.array(out), run.states[-1]

    def simulated(self, x0: Array) -> dict[str, Array]:
        """The channels over the whole record of what is fitted, each of shape (n,)."""
        run = self._run(x0[:, None], 0, self.t.size)[1]
        return {n: run.channels[n][:, 0] for n in self.data}

    def _run(self, X0: Array, a: int, b: int) -> tuple[Batch, Run]:
        """Columns of what is fitted, and their simulation over samples a to b."""
        size, k = X0.shape[1], self.states
        parameters = {n: np.full(size, p.value) for n, p in self.plant.model.parameters.items()}
        parameters |= dict(zip(self.free, X0[k:]))
        effects = tuple((w, stacked([e] * size)) for w, e in self.effects)
        inputs = {n: u[a:b] for n, u in self.inputs.items()}
        batch = Batch(parameters, effects, X0[:k][None])
        return batch, self.plant.simulate(self.t[a:b], inputs, batch)

    def drawn(self, x0: Array) -> Array:
        """The same with parameters drawn evenly within a standard deviation, shape (fitted, draws); none without any."""
        deviations = np.array([sd for _, sd in self.free.values()])
        if not deviations.size:
            return np.empty((x0.size, 0))
        from scipy.stats import qmc

        even = qmc.Sobol(deviations.size, scramble=False).random(DRAWS_OF_PARAMETERS)
        out = np.repeat(x0[:, None], DRAWS_OF_PARAMETERS, axis=1)
        out[self.states :] += deviations[:, None] * (2.0 * even.T - 1.0)
        return out

    def check(self, x0: Array, a: int, b: int) -> None:
        """Raise `InputError` where what is fitted cannot be simulated from sample a to b, or runs away."""
        batch, run = self._run(x0[:, None], a, b)
        beyond = np.zeros(b - a, dtype=bool)
        for name, full in self._full.items():
            seen = full[np.isfinite(full)]
            far = max(MAX_DISTANCE_SD / self.weights[name], MAX_RANGES * float(np.ptp(seen)))
            beyond |= np.abs(run.channels[name][:, 0] - float(seen.mean())) > far
        refuse(self.plant, self.t[a:b], {n: u[a:b] for n, u in self.inputs.items()}, batch, run, beyond)

    def left(self, X0: Array, a: int, b: int) -> Array:
        """Weighted residuals in samples a to b, shape (channels, b - a, batch), of columns of what is fitted."""
        return self._simulated(X0, a, b)[0]

    def last(self, x0: Array, a: int, b: int) -> Array:
        """What is fitted, its states at sample b - 1, from those at sample a."""
        return np.concatenate([self._simulated(x0[:, None], a, b)[1][:, 0], x0[self.states :]])

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
        last = max(self.t.size - MIN_FIRST_WINDOW_SAMPLES, 0)
        found = np.abs([self.guess(int(s), MIN_FIRST_WINDOW_SAMPLES) for s in np.linspace(0, last, 8)]).max(
            axis=0
        )
        return np.where(found > 0.0, found, 1.0)

    def slope(self, x0: Array, a: int, b: int) -> tuple[Array, Array]:
        """Residuals, shape (channels, m), and their derivatives by what is fitted, shape (channels, m, fitted)."""
        sizes = np.concatenate([self.scale, [sd for _, sd in self.free.values()]])
        step = 1e-5 * np.maximum(np.abs(x0), sizes)
        R = self.left(np.column_stack([x0, x0[:, None] + np.diag(step)]), a, b)
        return R[:, :, 0], (R[:, :, 1:] - R[:, :, :1]) / step

    def fit(self, x0: Array, a: int, b: int) -> Array:
        """What is fitted by damped least squares over samples a to b."""
        deviations = np.array([sd for _, sd in self.free.values()])
        prior = np.eye(x0.size)[self.states :] / deviations[:, None]
        for _ in range(MAX_ITERATIONS):
            r, J = self.slope(x0, a, b)
            pulls = self._pulls(x0[:, None])[:, 0]
            cost = float(np.sum(r**2) + pulls @ pulls)
            J = np.concatenate([J.reshape(-1, x0.size), prior])
            tried = x0[:, None] + _damped(J, np.concatenate([r.ravel(), pulls]))
            costs = self.cost(tried, a, b)
            best = int(np.argmin(costs))
            if costs[best] >= cost:
                break
            x0 = tried[:, best]
            if cost - costs[best] < RELATIVE_GAIN_TOLERANCE * cost or fit_is_over():
                break
        return x0

    def follows(self, x0: Array, a: int, b: int) -> bool:
        """Whether a simulation stays with the data, and answers not too much to where it starts."""
        r, J = self.slope(x0, a, b)
        most = {n: MAX_FOLLOWED_SHARE * min(self._spread(n, a, b), self._swing[n]) for n in self._full}
        return self._within(r, a, b, most) and self._forgets(J, a, b)

    def follows_whole(self, x0: Array, a: int, b: int) -> bool:
        """Whether one simulation over samples a to b looks like the data, and answers not too much to where it starts.

        What it leaves may be large: a plant that forgets where it started needs no more starts, however wrong its model is,
        and with more of them the parameters would be lost to them.
        """
        r, J = self.slope(x0, a, b)
        most = {c: MAX_LEFT_SHARE_IN_ONE_PIECE * self._spread(c, a, b) for c in self._full}
        return self._within(r, a, b, most) and self._forgets(J, a, b)

    def _spread(self, name: str, a: int, b: int) -> float:
        """Standard deviation of a channel over samples a to b [SI]; zero of fewer than two."""
        seen = self._full[name][a:b]
        seen = seen[np.isfinite(seen)]
        return float(np.std(seen)) if seen.size > 1 else 0.0

    def _within(self, r: Array, a: int, b: int, most: Mapping[str, float]) -> bool:
        """Whether weighted residuals, shape (channels, b - a), have a root mean square of at most `most` [SI]."""
        for (name, full), part in zip(self._full.items(), r):
            good = np.isfinite(full[a:b])
            limit = max(most[name] * self.weights[name], MAX_FOLLOWED_NOISE_SD)
            if good.sum() > 1 and float(np.sqrt(np.mean(part[good] ** 2))) > limit:
                return False
        return True

    def _forgets(self, J: Array, a: int, b: int) -> bool:
        """Whether errors of what is fitted do not grow, of derivatives of shape (channels, b - a, fitted)."""
        tenth, J = max(1, (b - a) // 10), J[:, :, : self.states]
        first, early, most = (
            np.abs(J[:, :k]).max(axis=(0, 1)) for k in (MIN_FIRST_WINDOW_SAMPLES, tenth, b - a)
        )
        if (most > MAX_ERROR_GROWTH * np.maximum(early, 1e-300)).any():
            return False
        # A position answers ever more to where a speed began; where every state does so, the motion is unstable.
        return not bool((most > MAX_TOTAL_ERROR_GROWTH * np.maximum(first, 1e-300)).all() and most.size)

    def hidden(self, x0: Array) -> tuple[bool, ...]:
        """Which initial states, shape (states,), change no channel of the assumed model."""
        if not x0.size:
            return ()
        J = self.slope(np.concatenate([x0, self.trusted]), 0, self.t.size)[1][:, :, : self.states]
        shown = np.abs(J).max(axis=(0, 1)) * self.scale
        return tuple(bool(v < MAX_HIDDEN_SD) for v in shown)


def _damped(J: Array, r: Array) -> Array:
    """Steps for every damping, shape (states, dampings)."""
    JJ, Jr = J.T @ J, J.T @ r
    diagonal = np.diag(JJ)
    scale = np.sqrt(np.maximum(diagonal, 1e-12 * max(float(diagonal.max()), 1e-300)))
    A = JJ / np.outer(scale, scale)
    steps = [-np.linalg.solve(A + d * np.eye(scale.size), Jr / scale) / scale for d in DAMPING_FACTORS]
    return np.array(steps).T
