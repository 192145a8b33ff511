"""How placed effects act on what a triad feels: what they need, when they come, by how much it lags."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kfgen.effects import Effect
from kfgen.effects.inertial.felt import Signals
from kfgen.effects.inertial.inertial_error import InertialError
from kfgen.effects.inertial.lag import Bandwidth, ClockDrift, Lag, TimeDelay

Array = NDArray[np.float64]

NOTICED_SHARE = 0.05
MIN_MOTION_SIGMAS = 3.0
"""Standard deviations by which that share of a motion must stand above the noise for it to count as motion."""


def needs_of(effects: Sequence[Effect]) -> tuple[str, ...]:
    """The drivers that effects need."""
    return tuple(sorted({n for e in effects if isinstance(e, InertialError) for n in e.needs}))


def with_errors(felt: Signals, axis: int, effects: Sequence[Effect], drive: Mapping[str, Array]) -> Array:
    """What one axis reads of what its triad felt, late already [U], shape (n,).

    Parameters
    ----------
    felt : Signals
    axis : int
        0, 1 or 2.
    effects : sequence of Effect
        On that channel; what is random in them is not in it.
    drive : mapping of str to ndarray, shape (n,)
        Recorded drivers [SI].
    """
    y = felt.y[:, axis].copy()
    for effect in effects:
        if isinstance(effect, InertialError):
            y += 0.0 if isinstance(effect, Lag) else effect.output(felt, axis)
        elif effect.coefficients():
            y += effect.mean(felt.t - felt.t[0], drive)
    return y


def is_motion(norm: float) -> bool:
    """Whether 5 % of a motion would be noticed.

    Parameters
    ----------
    norm : float
        Of the motion over its noise, all samples together.
    """
    return bool(NOTICED_SHARE * norm > MIN_MOTION_SIGMAS)


def edges_of(effects: Sequence[Effect]) -> list[tuple[float, float]]:
    """Times [s] within which effects come or go, and nobody knows how."""
    out = []
    for e in effects:
        edge = float(getattr(e, "edge", 0.0))
        if edge > 0.0:
            first, last = float(getattr(e, "time", 0.0)), float(getattr(e, "duration", 0.0))
            out += [(first, first + edge), (first + last - edge, first + last)]
    return out


def delayed(felt: Signals, effects: Sequence[Effect]) -> Signals:
    """What a triad feels after its delays and then its bandwidths; drivers too where an effect needs them.

    Parameters
    ----------
    felt : Signals
        What a triad should have read.
    effects : sequence of Effect
        Of the triad, lags among them.
    """
    lags: list[Lag] = [e for e in effects if isinstance(e, TimeDelay | ClockDrift)]
    lags += [e for e in effects if isinstance(e, Bandwidth)]
    needed = needs_of(effects)
    for lag in lags:
        moved: dict[str, Any] = {
            name: lag.passed(value, felt.dt, felt.spline)
            for name in ("y", *needed)
            if (value := getattr(felt, name)) is not None
        }
        felt = replace(felt, **moved)
    return felt
