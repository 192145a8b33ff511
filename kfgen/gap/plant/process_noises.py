"""Process noises that a log of a plant asks for, each with its most likely density, by one pass for all of them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kfgen.effects.plant.process_noise import ProcessNoise
from kfgen.gap.plant.linear_path import LinearPath
from kfgen.gap.plant.path_filter import PathFilter
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
        What drives the states in each step anyway.
    """

    about: Callable[[Array], LinearPath]
    states: Sequence[str]
    sizes: Array
    Q: Array

    @property
    def _P0(self) -> Array:
        return np.diag((START_SIZES * self.sizes) ** 2)

    def smoothed(self, X: Array, densities: Array) -> Array:
        """A path near which the plant was, shape (n, states), from another one.

        With noises of these root densities, shape (states,), or with louder ones where the model is so far off.
        """
        value, tried = -np.inf, LOUDER_FACTORS[:, None] * densities
        for _ in range(MAX_PATHS):
            path = self.about(X)
            each = _log_likelihoods(path, self.Q, self._P0, tried)
            best = int(np.argmax(each))
            if not each[best] > value + CLOSE_NATS:
                break
            value = float(each[best])
            X = PathFilter(path, self.Q + path.driving(tried[best]), self._P0).smoothed()
        return X

    def likely(self, X: Array, among: Sequence[str], width: float) -> list[FittedRandomError]:
        """The process noises of states, by evidence.

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
        found: dict[str, tuple[float, float, float]] = {}
        for _ in range(MAX_PATHS):
            at = {s: self._most_likely(path, self.states.index(s)) for s in among}
            state = max(at, key=lambda s: at[s][1])
            densities = np.where(np.array(self.states) == state, at[state][0], 0.0)
            value = float(_log_likelihoods(path, self.Q, self._P0, densities[None])[0])
            if not value > best + CLOSE_NATS:
                break
            found, best = at, value
            path = self.about(PathFilter(path, self.Q + path.driving(densities), self._P0).smoothed())
        choice = float(np.log(len(among) + 1))
        return sorted((_fitted(s, *a, width, choice) for s, a in found.items()), key=lambda f: -f.evidence)

    def _most_likely(self, path: LinearPath, state: int) -> tuple[float, float, float]:
        """The most likely density of a state's noise, what it gains over none [nats], and the standard deviation of its logarithm."""
        largest = self.sizes[state] / np.sqrt(path.steps.min())
        least = self.sizes[state] / np.sqrt(path.steps.sum()) * 10.0**-DECADES_OF_DENSITY
        count = int(np.log10(largest / least) * POINTS_PER_DECADE) + 2
        coarse = np.geomspace(least, largest, count)
        q = coarse[int(np.argmax(self._gains(path, state, coarse)[1:]))]
        fine = q * FINER_FACTORS
        gains = self._gains(path, state, fine)[1:]
        i = int(np.clip(np.argmax(gains), 1, gains.size - 2))
        x, (a, b, c) = np.log(fine[i - 1 : i + 2]), gains[i - 1 : i + 2]
        h = x[1] - x[0]
        bend = max((2.0 * b - a - c) / h**2, MAX_SD_OF_LOG**-2)
        shift = float(np.clip((c - a) / (2.0 * h) / bend, -h, h))
        none = self._gains(path, state, fine[:1])[0]
        return float(np.exp(x[1] + shift)), float(max(a, b, c) - none), float(bend**-0.5)

    def _gains(self, path: LinearPath, state: int, densities: Array) -> Array:
        """Logarithm of the likelihood of no noise, then of each density of a state's noise."""
        sets = np.zeros((densities.size + 1, len(self.states)))
        sets[1:, state] = densities
        return _log_likelihoods(path, self.Q, self._P0, sets)


def _fitted(state: str, q: float, gain: float, sd: float, width: float, choice: float) -> FittedRandomError:
    effect = ProcessNoise(q)
    cost = choice + effect.rarer_by_nats() + float(np.log(width / sd)) - 0.5 * float(np.log(2.0 * np.pi))
    ci95 = {"N": (q * float(np.exp(-1.96 * sd)), q * float(np.exp(1.96 * sd)))}
    return FittedRandomError(Placed(effect, state), ci95, gain - cost, -cost)


def _log_likelihoods(path: LinearPath, Q: Array, P0: Array, densities: Array) -> Array:
    """Of several sets of densities, shape (sets, states), shape (sets,) [nats]; all are filtered side by side."""
    sets, k = densities.shape
    m = path.C.shape[1]
    P, x, value = np.tile(P0, (sets, 1, 1)), np.zeros((sets, k)), np.zeros(sets)
    G = path.directions
    variances = path.steps[:, None, None] * densities**2
    for i in range(path.X.shape[0]):
        for j in range(m):
            c = path.C[i, j]
            if not c.any():
                continue
            PC = P @ c
            S = PC @ c + path.R[i, j]
            e = path.y[i, j] - x @ c
            value -= 0.5 * (e**2 / S + np.log(S / path.R[i, j]))
            K = PC / S[:, None]
            x += K * e[:, None]
            P -= K[:, :, None] * PC[:, None, :]
        if i < path.steps.size:
            A, g = path.A[i], G[i]
            P = A @ P @ A.T + Q[i] + (g * variances[i][:, None, :]) @ g.T
            x = x @ A.T + path.d[i]
    return value
