"""`Estimate`: what every method of identification returns."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kfgen.identify.fit.fit import Fit, Key
from kfgen.identify.fit.limits import Limit

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Estimate:
    """What a method says of a record.

    Parameters
    ----------
    fit : Fit
        All terms that the record needs.
    unresolved : frozenset of int
        Indices of the terms of the fit whose kind the record cannot tell.
    intervals : dict
        95 % intervals [SI] by parameter.
    limits : tuple of Limit
        What the record cannot show.
    covariance : ndarray, shape (k, k)
        Of the logarithms of the fitted parameters ``fit.free``.
    warnings : tuple of str
    """

    fit: Fit
    unresolved: frozenset[int]
    intervals: dict[Key, tuple[float, float]]
    limits: tuple[Limit, ...]
    covariance: Array
    warnings: tuple[str, ...] = ()
