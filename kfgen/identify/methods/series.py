"""What the methods of time series need: the samples of a record, and an estimate from effects that they found."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from kfgen.core.errors import InputError
from kfgen.effects import Effect
from kfgen.identify.evidence.record import Evidence, Record
from kfgen.identify.evidence.whittle import SpectralFit
from kfgen.identify.fit.estimate import Estimate
from kfgen.identify.fit.fit import Fit, Key, Problem, inverse
from kfgen.identify.fit.interval import NORMAL_975

Array = NDArray[np.float64]

BLIND = 1e-6
"""Information of a logarithm below which nothing is known of it."""
WIDEST = 300.0
"""Half width in a logarithm beyond which an interval is without bounds."""


def samples(record: Evidence, method: str) -> Array:
    """The samples [SI] of one even record, shape (n,).

    Parameters
    ----------
    record : Evidence
        What is identified.
    method : str
        Said in the error.

    Raises
    ------
    InputError
        Several records, one with gaps, one too long to be kept, or a curve.
    """
    if not isinstance(record, Record):
        raise InputError(
            f"the method {method} takes one evenly sampled log that fits into memory",
            where=f"--method {method}",
            remedy="Cut the log, or use --method ml",
        )
    return record.y


def warned(record: Evidence) -> tuple[str, ...]:
    """What is said where bands were to be left out, which a method in the time domain cannot do."""
    if not record.skip:
        return ()
    return ("this method takes the samples as they are: lines and an internal low-pass stay in them",)


def stated(
    record: Evidence, effects: Sequence[Effect], warnings: Sequence[str], covariance: Array | None = None
) -> Estimate:
    """An estimate of these effects; where no covariance is given, that of maximum likelihood.

    Parameters
    ----------
    covariance : ndarray, shape (k, k), optional
        Of the logarithms of all searched parameters in order.
    """
    problem = Problem(record, tuple(effects))
    keys = problem.free
    point = np.log([float(getattr(effects[i], name)) for i, name in keys])
    C = _covariance(problem, point) if covariance is None else covariance
    fit = Fit(tuple(effects), 0.0, SpectralFit(0.0, np.zeros(0), np.zeros((0, 0))), keys, point)
    return Estimate(fit, frozenset(), log_intervals(keys, point, C), (), C, (*warnings, *warned(record)))


def _covariance(problem: Problem, point: Array) -> Array:
    """The inverse of the information, endless where there is none."""
    J = problem.information(point)
    C, blind = inverse(J), np.diag(J) < BLIND
    C[blind] = C[:, blind] = 0.0
    C[blind, blind] = WIDEST**2
    return C


def log_intervals(keys: Sequence[Key], point: Array, C: Array) -> dict[Key, tuple[float, float]]:
    """The 95 % intervals [SI] of parameters whose logarithms are normal; without end where nothing is known.

    Parameters
    ----------
    keys : sequence of Key
        Parameters: index of the effect, name.
    point : ndarray, shape (k,)
        Logarithms of the parameters.
    C : ndarray, shape (k, k)
        Their covariance.
    """
    half = NORMAL_975 * np.sqrt(np.maximum(np.diag(C), 0.0))
    return {
        key: (float(np.exp(x - h)), float(np.exp(x + h))) if h < WIDEST else (0.0, float("inf"))
        for key, x, h in zip(keys, point.tolist(), half.tolist())
    }
