"""Whether what was found in one recording holds in another one of the same sensor.

Noise and what has a driver are taken as they were found. What happened once (a step, a change of the noise) says
nothing of another recording and is left out; of a line only the frequency comes again, its amplitude and phase are fitted.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from kfgen.effects import Effect
from kfgen.gap.core.holdout import Gap, HeldOut, divergence, is_line, ratios
from kfgen.gap.rest.comparison import ChannelGap
from kfgen.identify.evidence.record import Record


def gap_on(found: ChannelGap, other: Record, words: str) -> Gap:
    """The gap over another recording under the assumed and the updated model.

    Parameters
    ----------
    found : ChannelGap
        Of the first recording.
    other : Record
        With the drivers of what was found.
    words : str
        What the other recording is called.
    """
    lasting = [e for e in found.updated.effects if not happens_once(e) and not e.changes_samples]
    lines = [e for e in lasting if e.coefficients() and is_line(e)]
    shapes = [e for e in lasting if e.coefficients() and not is_line(e)]
    noise = [e for e in lasting if not e.coefficients()]
    trusted = [e for e in found.assumed if e.coefficients()]
    before = _less(other, trusted)
    r0, m = ratios(before, [e for e in found.assumed if not e.coefficients()], np.zeros(0))
    after, updated = _less(other, shapes), (*noise, *lines)
    theta = after.ordinates(updated).log_likelihood(updated).coefficients
    r1, _ = ratios(after, updated, theta)
    return divergence(HeldOut(r0, r1, m), words)


def happens_once(effect: Effect | type[Effect]) -> bool:
    """Whether an effect has a time at which it happened."""
    placed = any(p.kind == "place" for p in effect.parameters())
    return placed and not effect.driver and not is_line(effect)


def lasts(cls: type[Effect]) -> bool:
    """Whether an effect is the same in each recording: no event, no change of single samples, no line with its phase."""
    return not (cls.changes_samples or happens_once(cls) or is_line(cls))


def _less(record: Record, effects: list[Effect]) -> Record:
    """A record without what deterministic effects give it."""
    return replace(record, y=record.y - record.drift(effects))
