"""`ChannelGap`: one channel at rest compared with the noise that is assumed about it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from kfgen.effects import Effect
from kfgen.effects.noise_model import ChannelNoise
from kfgen.gap.core.result import Comparison
from kfgen.identify.evidence.record import Record


@dataclass(frozen=True, kw_only=True)
class ChannelGap(Comparison):
    """The answer for one channel at rest.

    Parameters
    ----------
    unit : str
        Of the channel.
    assumed : tuple of Effect
    updated : ChannelNoise
    record : Record
    comb_hz : float
        The fundamental of which its lines are harmonics; zero where they are not.
    white : ndarray, shape (n,)
        What the updated model leaves, fast part: white and of unit variance.
    clean : Record, optional
        The record without what changes single samples.
    """

    is_at_rest: ClassVar[bool] = True

    unit: str
    assumed: tuple[Effect, ...]
    updated: ChannelNoise
    record: Record
    comb_hz: float = 0.0
    white: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))
    clean: Record | None = None

    @property
    def channel(self) -> str:
        """Its name."""
        return self.channels[0]


def span_of(record: Record) -> tuple[float, float]:
    """First and last time of a record [s]."""
    return float(record.t[0]), float(record.t[-1])
