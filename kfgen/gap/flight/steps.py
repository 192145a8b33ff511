"""Steps of biases in flight: of every channel the time at which one explains most, by one backward pass for all times.

References
----------
.. [1] P. de Jong and J. Penzer, Diagnosing shocks in time series, J. Amer. Statist. Assoc. 93(442), 1998.
.. [2] A. S. Willsky and H. L. Jones, A generalized likelihood ratio approach to the detection and estimation of jumps in
   linear systems, IEEE Trans. Automatic Control 21(1), 1976.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kfgen.effects.samples.event import BiasStep
from kfgen.effects.series import coefficient_worth, log_mean
from kfgen.gap.flight.path import FlownPath
from kfgen.gap.scene.scene import Placed

Array = NDArray[np.float64]

GRID_POINTS = 24
"""Times at which the energy of a step is computed; between them it is interpolated."""
MIN_STEP_SIGMAS = 3.5
"""Standard deviations of its size below which a step is not offered: what its time costs leaves it no evidence."""
MIN_ENERGY_SHARE = 1e-6
"""Energy of a step over the largest of its channel below which the log does not show it."""


@dataclass(frozen=True)
class StepEnergies:
    """How large unit steps are in the innovations of a flight, less what its unknowns can do.

    Parameters
    ----------
    t : ndarray, shape (k,)
        Times of the steps [s].
    energy : ndarray, shape (channels, k)
        Squared norms [1/U^2].
    """

    t: Array
    energy: Array


def step_energies(path: FlownPath, channels: Sequence[str], unknowns: Array) -> StepEnergies:
    """The energies of steps of every channel, on a grid of times.

    Parameters
    ----------
    path : FlownPath
    channels : sequence of str
        Inputs and channels of aiding sensors.
    unknowns : ndarray, shape (rows, k)
        Orthonormal directions of the innovations, in the order of time, that are fitted anyway.
    """
    start, stop = float(path.log.t[0]), float(path.log.t[-1])
    grid = start + (stop - start) * (np.arange(GRID_POINTS) + 1.0) / (GRID_POINTS + 1.0)
    cases = [(c, t) for c in channels for t in grid.tolist()]
    found: list[Array] = []
    at_once = path.linear.columns_at_once
    for first in range(0, len(cases), at_once):
        some = cases[first : first + at_once]
        du = np.zeros((*path.log.u.shape, len(some)))
        dz = np.zeros((path.rows.t.size, len(some)))
        for k, (channel, t) in enumerate(some):
            if channel in path.equations.channels:
                du[path.log.t >= t, path.equations.channels.index(channel), k] = 1.0
            else:
                at = path.rows.of(channel)
                dz[at[path.rows.t[at] >= t], k] = 1.0
        V = path.linear.columns(du, dz)
        found.append(np.sum(V**2, axis=0) - np.sum((unknowns.T @ V) ** 2, axis=0))
    energy = np.concatenate(found).reshape(len(channels), GRID_POINTS)
    return StepEnergies(np.asarray(grid, dtype=np.float64), np.asarray(energy, dtype=np.float64))


def likely_steps(
    path: FlownPath, channels: Sequence[str], energies: StepEnergies, residual: Array
) -> list[Placed]:
    """Of every channel the step that explains most of what is left, where that is more than chance would.

    Its prior penalty is what it costs to choose the time, by the mean of the likelihood over all times.

    Parameters
    ----------
    path : FlownPath
    channels : sequence of str
        Those of the energies.
    energies : StepEnergies
    residual : ndarray, shape (rows,)
        Normalised innovations in the order of time, less what is fitted anyway.
    """
    of_inputs, of_readings = path.linear.products(residual)
    found = []
    for channel, energy in zip(channels, energies.energy):
        if channel in path.equations.channels:
            t, each = path.log.t, of_inputs[:, path.equations.channels.index(channel)]
        else:
            at = path.rows.of(channel)
            t, each = path.rows.t[at], of_readings[at]
        product = np.cumsum(each[::-1])[::-1]
        inside = (t >= energies.t[0]) & (t <= energies.t[-1])
        floor = MIN_ENERGY_SHARE * max(float(energy.max()), 1e-300)
        size2 = np.maximum(np.interp(t[inside], energies.t, energy), floor)
        score = product[inside] / np.sqrt(size2)
        if not score.size or np.abs(score).max() < MIN_STEP_SIGMAS:
            continue
        k, worth = int(np.argmax(np.abs(score))), coefficient_worth(score)
        step = BiasStep(float(score[k] / np.sqrt(size2[k])), float(t[inside][k] - path.log.t[0]))
        found.append(Placed(step, channel, float(worth[k]) - log_mean(worth)))
    return found
