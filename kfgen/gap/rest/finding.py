"""What was found: missing effects, and the answer for one channel."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from kfgen.effects import Effect
from kfgen.effects.noise_model import ChannelNoise
from kfgen.gap.core.battery import Test
from kfgen.gap.core.holdout import Gap
from kfgen.gap.rest.checks import Checks
from kfgen.gap.rest.distinguishability import Distinguishability
from kfgen.gap.rest.search import SET
from kfgen.identify.evidence.record import Record


@dataclass(frozen=True)
class Finding:
    """A missing effect.

    Parameters
    ----------
    effect : Effect
        With its fitted values.
    ci95 : mapping
        Intervals of its parameters [SI].
    probability : float
        Among all candidates and none.
    evidence : float
        Nats.
    alternatives : tuple of (name, probability)
    worst : Test
        The test that showed most disagreement before it was added.
    others : tuple of Apart
        How far the names are that are not ruled out, and what would tell.
    """

    effect: Effect
    ci95: Mapping[str, tuple[float, float]]
    probability: float
    evidence: float
    alternatives: tuple[tuple[str, float], ...]
    worst: Test
    others: tuple[Distinguishability, ...] = ()

    @property
    def indistinguishable(self) -> tuple[str, ...]:
        """Alternatives that the record does not rule out."""
        return tuple(n for n, p in self.alternatives if p > SET and n != "none")


@dataclass(frozen=True)
class ChannelGap:
    """The answer for one channel.

    Parameters
    ----------
    verdict : str
        ``no_gap``, ``effects_found``, ``unknown_effect`` or ``bad_data``.
    before, after : tuple of Test
        The battery under the believed and under the mended model.
    limits : tuple of (Effect, parameter, value)
        What would not have been seen.
    white : ndarray, shape (n,)
        What the mended model leaves, fast part: white and of unit variance.
    checks : Checks, optional
        Of what was added.
    clean : Record, optional
        The record without what changes single samples.
    """

    channel: str
    unit: str
    verdict: str
    findings: tuple[Finding, ...]
    before: tuple[Test, ...]
    after: tuple[Test, ...]
    gap: Gap
    believed: tuple[Effect, ...]
    mended: ChannelNoise
    limits: tuple[tuple[Effect, str, float], ...]
    record: Record
    retuned: bool = False
    white: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))
    checks: Checks | None = None
    clean: Record | None = None
