"""`LinearPath`: a plant about a path that its states may have taken, step by step.

What a model makes of a step is counted from where the path is, not from where the model alone would have gone: so errors of the
model and noise that drives the states add up over single steps, as in the prediction-error method [1]_, and the plant need be
linear only as far as the path may be off.

References
----------
.. [1] L. Ljung, System Identification: Theory for the User, 2nd ed., 1999, sec. 3.2 and 7.2.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kfgen.gap.plant.hole_responses import STEP, Simulation
from kfgen.gap.plant.recorded_channel import RecordedChannel

Array = NDArray[np.float64]

LOST_SIZES = 1e3
"""Sizes of its states by which a model is off that cannot be simulated over a step."""


@dataclass(frozen=True)
class LinearPath:
    """The path and the plant about it.

    Parameters
    ----------
    steps : ndarray, shape (n - 1,)
        Of time [s].
    X : ndarray, shape (n, states)
        The path [SI].
    A : ndarray, shape (n - 1, states, states)
        Change of the states after a step by their change before it.
    C : ndarray, shape (n, channels, states)
        Change of the channels by that of the states; zero where a channel has no sample.
    y : ndarray, shape (n, channels)
        Measured less what the path shows [SI]; zero where a channel has no sample.
    R : ndarray, shape (n, channels)
        Variance of the noise of a sample.
    d : ndarray, shape (n - 1, states)
        Where the model goes from the path in a step, less where the path is [SI].
    """

    steps: Array
    X: Array
    A: Array
    C: Array
    y: Array
    R: Array
    d: Array

    @property
    def directions(self) -> Array:
        """What noise that is held over a step does to the states, over its value and the step, shape (n - 1, states, states).

        To second order of the step: the mean of where it drives them at its beginning and at its end.
        """
        return 0.5 * (np.eye(self.X.shape[1]) + self.A)

    def driving(self, densities: Array) -> Array:
        """Covariance that white noise gives to the states in each step, shape (n - 1, states, states).

        Parameters
        ----------
        densities : ndarray, shape (states,)
            Root densities of the noise of their derivatives [SI/sqrt(Hz)].
        """
        G = self.directions * densities
        return np.asarray(self.steps[:, None, None] * (G @ G.transpose(0, 2, 1)))


def linear_path(
    simulation: Simulation,
    inputs: Mapping[str, Array],
    X: Array,
    sizes: Array,
    recorded: Mapping[str, RecordedChannel],
) -> LinearPath:
    """The plant of a simulation about a path.

    Parameters
    ----------
    simulation : Simulation
        Of one column.
    inputs : mapping of str to ndarray, shape (n,)
        [SI].
    X : ndarray, shape (n, states)
        The path [SI].
    sizes : ndarray, shape (states,)
        Of the states [SI].
    recorded : mapping of str to RecordedChannel
        By channel.
    """
    n, k = X.shape
    step = STEP * sizes
    moved = X[:, :, None] + np.concatenate([np.zeros((k, 1)), np.diag(step)], axis=1)
    shown, there = along(simulation, inputs, moved)
    C, y = np.zeros((n, len(recorded), k)), np.zeros((n, len(recorded)))
    R = np.ones((n, len(recorded)))
    for j, (name, r) in enumerate(recorded.items()):
        h = shown[name][r.at]
        C[r.at, j] = np.nan_to_num((h[:, 1:] - h[:, :1]) / step)
        y[r.at, j] = r.left(shown[name][:, :1])[:, 0]
        R[r.at, j] = r.noise**2
    A = np.nan_to_num((there[:, :, 1:] - there[:, :, :1]) / step)
    steps = np.diff(simulation.t)
    return LinearPath(steps, X, A, C, y, R, defects(there[:, :, :1], X, sizes)[:, :, 0])


def along(
    simulation: Simulation, inputs: Mapping[str, Array], initial: Array
) -> tuple[Mapping[str, Array], Array]:
    """What the channels show of states at every sample, and where the plant is a step later.

    Parameters
    ----------
    simulation : Simulation
    inputs : mapping of str to ndarray, shape (n,)
        [SI].
    initial : ndarray, shape (n, states, columns)
        The states [SI].

    Returns
    -------
    channels : mapping of str to ndarray, shape (n, columns)
    there : ndarray, shape (n - 1, states, columns)
    """
    n = initial.shape[0]
    shown = simulation.run(inputs, range(n), initial).channels
    before = np.arange(n - 1)
    return shown, simulation.reached(inputs, before, initial[:-1], before + 1)


def defects(there: Array, X: Array, sizes: Array) -> Array:
    """Where a model is after each step, shape (n - 1, states, columns), less the path; finite even where it is not.

    Parameters
    ----------
    there : ndarray, shape (n - 1, states, columns)
        [SI].
    X : ndarray, shape (n, states)
        The path.
    sizes : ndarray, shape (states,)
        Of the states.
    """
    far = LOST_SIZES * sizes[:, None]
    d = there - X[1:, :, None]
    return np.where(np.isfinite(d), np.clip(d, -far, far), far)
