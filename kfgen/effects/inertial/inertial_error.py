"""`InertialError`: an error of a sensor that moves, as one expression of what the sensor should have read.

The expression is evaluated by numpy where data are compared and by sympy where filters are derived. At rest there is
nothing of it but a constant, so a record at rest never shows it. Entries of a matrix or a vector that stand at exactly
zero are not there: `free` names those that a fit may change.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import MISSING, dataclass, fields
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from kfgen.core.channel_names import AXES
from kfgen.effects.effect import AddsNothingAtRest, Effect, Parameter
from kfgen.effects.filter_role import FilterPlace, FilterRole, ReadingError
from kfgen.effects.inertial.felt import Felt, Signals

Array = NDArray[np.float64]


@dataclass(frozen=True)
class InertialError(AddsNothingAtRest):
    """An effect that only motion shows."""

    sensors: ClassVar[tuple[str, ...]] = ("gyro", "accel")
    needs: ClassVar[tuple[str, ...]] = ()
    filter_drivers: ClassVar[tuple[str, ...]] = ()

    def error(self, felt: Felt, axis: int) -> Any:
        """The addition [U] to one axis of the triad: the one expression that every layer uses.

        Parameters
        ----------
        felt : Felt
            What the triad should have felt, in numbers over time or in symbols.
        axis : int
            0, 1 or 2.
        """
        raise NotImplementedError

    def output(self, signals: Signals, axis: int) -> Array:
        """The addition [U] to one axis of the triad over time, shape (n,); zero where what it needs is unknown.

        Parameters
        ----------
        signals : Signals
        axis : int
            0, 1 or 2.
        """
        if any(getattr(signals, n) is None for n in self.needs):
            return np.zeros(signals.t.size)
        return np.asarray(
            np.broadcast_to(self.error(signals.felt, axis), (signals.t.size,)), dtype=np.float64
        )

    def in_filter(self, place: FilterPlace) -> FilterRole:
        """Its own expression, known or with its parameters as states."""
        return ReadingError()

    def sentence(self, channel: str, unit: str) -> str:
        """The effect in words: the entries that are there, with their units."""
        row = self.row(unit)
        shown = {k: f"{v:.3g} {u}".rstrip() for k, (v, u) in row.items()}
        there = [p.name for p in free(self)] or [p.name for p in self.estimated()]
        entries = ", ".join(f"{k} = {shown[k]}" for k in there)
        return f"{channel} {self.sentence_template.format(entries=entries, **shown)}"


def free(effect: Effect) -> tuple[Parameter, ...]:
    """The parameters that a fit may change: the estimated ones, but no entries at their default of zero."""
    held = {
        f.name
        for f in fields(effect)
        if f.default is not MISSING
        and f.metadata["kind"] != "setting"
        and getattr(effect, f.name) == f.default
    }
    fitted = (p for p in effect.estimated() if p.kind not in ("solved", "place"))
    return tuple(p for p in fitted if p.name not in held)


def row_of(effect: InertialError, u: Sequence[Any], axis: int) -> Any:
    """One row of an effect's matrix (entries ``xx`` ... ``zz``) times a triad.

    Parameters
    ----------
    effect : InertialError
        Whose entries are named by output and input axis.
    u : sequence of 3
        The triad, in numbers or symbols.
    axis : int
        The row.
    """
    entries = ((getattr(effect, AXES[axis] + AXES[j], 0.0), u[j]) for j in range(3))
    return sum((entry * x for entry, x in entries if entry != 0), 0)


def arm_rate(r: Sequence[Any], omega: Sequence[Any], alpha: Sequence[Any], order: int) -> tuple[Any, ...]:
    """The derivative of given order of a point at `r` on a turning body, in body axes, shape (3,).

    ``r``, ``omega x r``, ``omega x (omega x r) + alpha x r``: what a lever arm adds to a position, a velocity, an acceleration.

    Parameters
    ----------
    r : sequence of 3
        The arm [m].
    omega, alpha : sequence of 3
        Body rate [rad/s] and its derivative [rad/s^2]; unused where the order does not need them.
    order : int
        0, 1 or 2.
    """
    if order == 0:
        return tuple(r)
    if order == 1:
        return tuple(
            omega[(i + 1) % 3] * r[(i + 2) % 3] - omega[(i + 2) % 3] * r[(i + 1) % 3] for i in range(3)
        )
    out = []
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        inward = (
            omega[i] * (omega[j] * r[j] + omega[k] * r[k])
            - (omega[j] * omega[j] + omega[k] * omega[k]) * r[i]
        )
        out.append(inward + alpha[j] * r[k] - alpha[k] * r[j])
    return tuple(out)
