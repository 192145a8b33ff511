"""`RandomError`: a random error of one channel as states of a filter."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kfgen.effects.linear_system import LinearSystem, discretise, initial_covariance
from kfgen.gap.scene.scene import Placed

Array = NDArray[np.float64]


@dataclass(frozen=True)
class RandomError:
    """A random error of one channel: ``x' = Phi x + w``, ``E[w w'] = Qd``, the reading has ``C x`` more.

    Parameters
    ----------
    channel : str
    Phi, Qd, P0 : ndarray, shape (k, k)
        Of a step of the filter, and at the start.
    C : ndarray, shape (k,)
    """

    channel: str
    Phi: Array
    Qd: Array
    P0: Array
    C: Array

    @property
    def order(self) -> int:
        """States."""
        return int(self.C.size)


def random_error_of(placed: Placed, dt: float) -> RandomError:
    """The states of a random effect of a channel.

    Parameters
    ----------
    placed : Placed
        A linear process that is driven by noise: a random walk, a Gauss-Markov process.
    dt : float
        Step of the filter [s].
    """
    form: LinearSystem = placed.effect.form()
    Phi, Qd = discretise(form, dt)
    C = np.array(form.C, dtype=np.float64)
    return RandomError(placed.where, Phi, Qd, initial_covariance(form), C)
