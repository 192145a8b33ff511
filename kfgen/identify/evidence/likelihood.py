"""`Likelihood`: what a fit asks of the samples, or of a curve, once the regressors of its effects stand."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from kfgen.effects import Effect
from kfgen.identify.evidence.shapes import Key
from kfgen.identify.evidence.whittle import SpectralFit

Array = NDArray[np.float64]


class Likelihood(Protocol):
    """A likelihood of effects, whose regressors stand."""

    def log_likelihood(self, effects: Sequence[Effect], coefficients: Array | None = None) -> SpectralFit:
        """``ln L``, and the coefficients of the regressors.

        Parameters
        ----------
        effects : sequence of Effect
            With their values [SI].
        coefficients : ndarray, shape (r,), optional
            Of the regressors; solved for when left out.
        """

    def slope(self, effects: Sequence[Effect], keys: Sequence[Key]) -> Array:
        """Its derivative in the logarithms of parameters.

        Parameters
        ----------
        effects : sequence of Effect
            With their values [SI].
        keys : sequence of Key
            Parameters: index of the effect, name.

        Returns
        -------
        ndarray, shape (k,)
        """

    def information(self, effects: Sequence[Effect], keys: Sequence[Key]) -> Array:
        """Fisher information of these logarithms.

        Parameters
        ----------
        effects : sequence of Effect
            With their values [SI].
        keys : sequence of Key
            Parameters: index of the effect, name.

        Returns
        -------
        ndarray, shape (k, k)
        """
