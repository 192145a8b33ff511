"""The convention of an attitude: whether its conjugate, or another order of its columns, moves as the gyros do."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from kfgen.effects import Effect
from kfgen.effects.faults.reference import ReversedAttitude, ScalarLastAttitude
from kfgen.gap.motion.likeness import Likeness
from kfgen.gap.motion.truth import truth_of
from kfgen.log.log import Log

Array = NDArray[np.float64]

MAX_REMAINING_SHARE = 0.1
"""Share of what is left under the given convention that another must leave, to be said ..."""
MIN_BAND_POWER_SHARE = 0.5
"""... in a band that holds no less than this share of the power."""

OTHERS: tuple[tuple[tuple[Effect, ...], str, float], ...] = (
    ((ReversedAttitude(),), "wxyz", -1.0),
    ((ScalarLastAttitude(),), "zwxy", 1.0),
    ((ScalarLastAttitude(), ReversedAttitude()), "zwxy", -1.0),
)
"""What is wrong, the names of the columns that hold w, x, y, z, and the sign of the vector."""


def misread(
    log: Log, bandwidth: Mapping[str, float], given: Likeness, compare: Callable[[Array, float], Likeness]
) -> tuple[Effect, ...]:
    """What is wrong with the convention of a log's attitude; nothing where no other fits far better.

    Parameters
    ----------
    given : Likeness
        Of the gyros under the attitude as it is given.
    compare : callable
        The likeness of the gyros under a rate, shape (n, 3), known up to a frequency [Hz].
    """
    best: tuple[Effect, ...] = ()
    error = MAX_REMAINING_SHARE * given.error
    for wrong, order, sign in OTHERS:
        truth = truth_of(_as(log, order, sign), bandwidth)
        assert truth is not None
        found = compare(truth.read["gyro"], truth.bandwidth["gyro"])
        if found.total > MIN_BAND_POWER_SHARE * given.total and found.error < error:
            best, error = wrong, found.error
    return best


def _as(log: Log, order: str, sign: float) -> Log:
    """The log with its attitude in another convention."""
    read = {c: log.channels[f"ref_q_{name}"] for name, c in zip(order, "wxyz")}
    new = {f"ref_q_{c}": replace(q, values=q.values * (1.0 if c == "w" else sign)) for c, q in read.items()}
    return replace(log, channels={**log.channels, **new})
