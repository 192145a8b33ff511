"""Process noises that a log of a plant asks for, each with its most likely density, by one pass for all of them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kfgen.effects.plant.process_noise import ProcessNoise
from kfgen.gap.plant.noise.linear_path import LinearPath
from kfgen.gap.plant.noise.path_filter import PathFilter, gains
from kfgen.gap.scene.random_error import FittedRandomError
from kfgen.gap.scene.scene import Placed

Array = NDArray[np.float64]

DECADES_OF_DENSITY = 6
"""Below a density that moves a state by its size within the whole log."""
POINTS_PER_DECADE = 2
FINER_FACTORS = np.geomspace(10.0**-0.5, 10.0**0.5, 9)
"""Of the most likely density, at which it is looked at again."""
LOUDER_FACTORS = 10.0 ** np.arange(0.0, 4.5, 0.5)
"""Of densities, with which a path is smoothed that must follow the readings while the model does not."""
MAX_PATHS = 4
"""Times that a path is smoothed, and the plant linear about it."""
CLOSE_NATS = 0.1
"""Rise of the likelihood at which a path stays."""
MAX_SD_OF_LOG = 2.0
"""Of a density of which the log says little."""
START_SIZES = 10.0
"""Standard deviation of where states begin that nobody knows, in their sizes."""


@dataclass(frozen=True)
class Peak:
    """The most likely density of a state's noise.

    Parameters
    ----------
    density : float
        [SI/sqrt(Hz)].
    value, gain : float
        Logarithm of its likelihood, and of that over the one without it [nats].
    sd_of_log : float
        Standard deviation of its logarithm.
    """

    density: float
    value: float
    gain: float
    sd_of_log: float


@dataclass(frozen=True)
class NoisyPlant:
    """A plant that may be driven by noise, about any path.

    Parameters
    ----------
    about : callable
        The plant about a path, shape (n, states).
    states : sequence of str
    sizes : ndarray, shape (states,)
        Of the states [SI].
    Q : ndarray, shape (n - 1, states, states)
        What rows that are lost do to the states in each step.
    densities : ndarray, shape (states,)
        Root densities of the noises that drive the states anyway [SI/sqrt(Hz)].
    """

    about: Callable[[Array], LinearPath]
    states: Sequence[str]
    sizes: Array
    Q: Array
    densities: Array

    @property
    def _P0(self) -> Array:
        return np.diag((START_SIZES * self.sizes) ** 2)

    def smoothed(self, X: Array) -> Array:
        """A path near which the plant was, shape (n, states), from another one: with its noises, or louder ones if the model is off."""
        value, tried = -np.inf, LOUDER_FACTORS[:, None] * self.densities
        for _ in range(MAX_PATHS):
            path = self.about(X)
            each = self._log_likelihoods(path, tried)
            best = int(np.argmax(each))
            if not each[best] > value + CLOSE_NATS:
                break
            value, X = float(each[best]), self._smoothed(path, tried[best])
        return X

    def _smoothed(self, path: LinearPath, densities: Array) -> Array:
        return PathFilter(path, self.Q + path.driving(densities), self._P0).smoothed()

    def _log_likelihoods(self, path: LinearPath, sets: Array) -> Array:
        """Of several sets of densities, shape (sets, states), shape (sets,) [nats]; all are filtered side by side."""
        x, value = np.zeros(sets.shape), np.zeros(sets.shape[0])
        variances, G = path.steps[:, None, None] * sets**2, path.directions

        def driving(i: int) -> Array:
            return np.asarray(self.Q[i] + (G[i] * variances[i][:, None, :]) @ G[i].T)

        roots = 0.5 * np.log(path.R).sum(axis=1)
        for i, (_, K, W) in enumerate(gains(path, driving, np.tile(self._P0, (sets.shape[0], 1, 1)))):
            e = path.y[i] - x @ path.C[i].T
            z = (W @ e[:, :, None])[:, :, 0]
            value += (
                np.log(np.diagonal(W, axis1=1, axis2=2)).sum(axis=1) + roots[i] - 0.5 * (z**2).sum(axis=1)
            )
            if i < path.steps.size:
                x = (x + (K @ e[:, :, None])[:, :, 0]) @ path.A[i].T + path.d[i]
        return value

    def likely(self, X: Array, among: Sequence[str], width: float) -> tuple[list[FittedRandomError], Array]:
        """The process noises of states, by evidence, and a path near which the plant is with the most likely one.

        Parameters
        ----------
        X : ndarray, shape (n, states)
            A path near which the plant is without any.
        among : sequence of str
            States that noise may drive.
        width : float
            Of the prior of the logarithm of a density.
        """
        path, best = self.about(X), -np.inf
        at = {s: self._coarse(path, self.states.index(s)) for s in among}
        if max(gain for _, gain in at.values()) < ProcessNoise(1.0).rarer_by_nats():
            return [], X
        found: dict[str, Peak] = {}
        for _ in range(MAX_PATHS):
            peaks = {s: self._fine(path, self.states.index(s), q) for s, (q, _) in at.items()}
            state = max(peaks, key=lambda s: peaks[s].gain)
            if not peaks[state].value > best + CLOSE_NATS:
                break
            found, best = peaks, peaks[state].value
            at = {s: (p.density, p.gain) for s, p in peaks.items()}
            densities = self._with(self.states.index(state), np.array([peaks[state].density]))[0]
            X = self._smoothed(path, densities)
            path = self.about(X)
        choice = float(np.log(len(among) + 1))
        return sorted((_fitted(s, p, width, choice) for s, p in found.items()), key=lambda f: -f.evidence), X

    def _coarse(self, path: LinearPath, state: int) -> tuple[float, float]:
        """About the most likely density of a state's noise, and what it gains over none [nats]."""
        largest = self.sizes[state] / np.sqrt(path.steps.min())
        least = self.sizes[state] / np.sqrt(path.steps.sum()) * 10.0**-DECADES_OF_DENSITY
        count = int(np.log10(largest / least) * POINTS_PER_DECADE) + 2
        tried = np.geomspace(least, largest, count)
        none, *values = self._log_likelihoods(path, self._with(state, np.append(0.0, tried)))
        return float(tried[int(np.argmax(values))]), float(max(values) - none)

    def _fine(self, path: LinearPath, state: int, near: float) -> Peak:
        """The most likely density of a state's noise near one."""
        tried = near * FINER_FACTORS
        none, *values = self._log_likelihoods(path, self._with(state, np.append(0.0, tried)))
        i = int(np.clip(np.argmax(values), 1, len(values) - 2))
        x, (a, b, c) = np.log(tried[i - 1 : i + 2]), values[i - 1 : i + 2]
        h = x[1] - x[0]
        bend = max((2.0 * b - a - c) / h**2, MAX_SD_OF_LOG**-2)
        shift = float(np.clip((c - a) / (2.0 * h) / bend, -h, h))
        top = float(max(a, b, c))
        return Peak(float(np.exp(x[1] + shift)), top, top - float(none), float(bend**-0.5))

    def _with(self, state: int, densities: Array) -> Array:
        """Sets of densities, shape (sets, states), of which a state has another noise beside its own."""
        sets = np.tile(self.densities, (densities.size, 1))
        sets[:, state] = np.hypot(sets[:, state], densities)
        return sets


def _fitted(state: str, peak: Peak, width: float, choice: float) -> FittedRandomError:
    q, sd = peak.density, peak.sd_of_log
    effect = ProcessNoise(q)
    cost = choice + effect.rarer_by_nats() + float(np.log(width / sd)) - 0.5 * float(np.log(2.0 * np.pi))
    ci95 = {"N": (q * float(np.exp(-1.96 * sd)), q * float(np.exp(1.96 * sd)))}
    return FittedRandomError(Placed(effect, state), ci95, peak.gain - cost, -cost)
