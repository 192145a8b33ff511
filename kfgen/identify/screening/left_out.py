"""What was left out of a record before it was fitted, so that a result can say it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from kfgen.effects.samples.event import Outliers


@dataclass(frozen=True)
class LeftOut:
    """Shocks and outliers of a record.

    Parameters
    ----------
    shocks : tuple of (from, to)
        Times [s].
    outliers : Outliers, optional
        Share and size of those that were estimated as a law of their own.
    ci95 : mapping of str to (float, float)
        95 % intervals of the parameters of `outliers` [SI].
    widening : float
        Factor on the logarithmic width of the interval of the white noise.
    """

    shocks: tuple[tuple[float, float], ...] = ()
    outliers: Outliers | None = None
    ci95: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    widening: float = 1.0
