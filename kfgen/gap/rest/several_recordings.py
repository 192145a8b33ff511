"""Several recordings of one sensor, and one model of them.

What lasts is fitted to all of them together: noise, and shapes, which must come again with the same size in each (a ramp,
a warm-up, a temperature term), where a random walk goes another way each time. What happens once, lines (whose phase is
another one each time) and what changes single samples are found in each recording by itself, and taken out where
they are sure. The gap is that of each recording, in turn, under what the others say.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from kfgen.core.errors import InputError
from kfgen.effects import Effect, catalogue
from kfgen.effects.noise_model import ChannelNoise
from kfgen.gap.core.holdout import Gap, divergence, is_line, judged
from kfgen.gap.rest.evidence import Candidate
from kfgen.gap.rest.finding import ChannelGap, Finding
from kfgen.gap.rest.search import RETUNE, searched
from kfgen.gap.rest.second_recording import happens_once
from kfgen.gap.rest.trust import merged, moved
from kfgen.gap.rest.workflow import (
    Prepared,
    checked,
    find_gap,
    limits_of,
    prepared,
    terms_of,
    tests_of,
    verdict_of,
    written,
)
from kfgen.identify.evidence.joint import JointRecord
from kfgen.identify.evidence.record import Record

Array = NDArray[np.float64]

SURE = 0.95
"""Probability above which what happened once is taken out of its recording; below, it may be slow noise."""


@dataclass(frozen=True)
class Recording:
    """One of several recordings of a channel.

    Parameters
    ----------
    name : str
    record : Record
    stamps : ndarray, optional
        Time stamps as logged [s].
    stated : float
        As of `kfgen.gap.rest.workflow.find_gap`.
    """

    name: str
    record: Record
    stamps: Array | None = None
    stated: float = 0.0


@dataclass(frozen=True)
class JointGap:
    """The answer for one channel of several recordings.

    Parameters
    ----------
    gap : ChannelGap
        Of all; its record is the first that could be used.
    alone : tuple of (str, ChannelGap)
        Of each by itself.
    """

    gap: ChannelGap
    alone: tuple[tuple[str, ChannelGap], ...]

    @property
    def once(self) -> list[tuple[str, ChannelGap, Finding]]:
        """What happened in one recording, its name before it."""
        return [(n, g, f) for n, g in self.alone for f in g.findings if not _lasts(type(f.effect))]


def find_together(channel: str, recordings: Sequence[Recording], noise: ChannelNoise) -> JointGap:
    """Compare several recordings of one channel with the noise model that is believed of it.

    Raises
    ------
    InputError
        No recording can be used, or as of `find_gap`.
    """
    alone = [(r.name, find_gap(channel, r.record, noise, r.stamps, r.stated)) for r in recordings]
    good = [(r, g) for r, (_, g) in zip(recordings, alone) if g.verdict != "bad_data"]
    if not good:
        raise InputError(
            f"the samples of {channel} are faulty in every recording", remedy="See each by itself"
        )
    if len(good) == 1:
        return JointGap(good[0][1], tuple(alone))
    ready = [
        prepared(_steady(r.record, g), noise.extended_band(r.record.dt, r.record.duration)) for r, g in good
    ]
    return JointGap(_of_all(channel, ready, good[0][1], noise), tuple(alone))


def _lasts(cls: type[Effect]) -> bool:
    """Whether an effect is the same in each recording."""
    return not (cls.changes_samples or happens_once(cls) or is_line(cls))


def _steady(record: Record, found: ChannelGap) -> Record:
    """A recording without what surely happened once in it."""
    sure = [f.effect for f in found.findings if f.probability > SURE and not _lasts(type(f.effect))]
    clean = found.clean if found.clean is not None else record
    return replace(clean, y=clean.y - clean.drift([e for e in sure if e.coefficients()]), block=1)


def _of_all(channel: str, ready: Sequence[Prepared], first: ChannelGap, noise: ChannelNoise) -> ChannelGap:
    joint = JointRecord(tuple(p.raw for p in ready))
    at = ready[0]
    passing = frozenset(name for name, cls in catalogue().items() if not _lasts(cls))
    start = replace(at.search, record=joint, without=at.search.without | passing)
    before = tests_of(written(joint, at.random.effects))
    search = searched(start)
    base = search.base()
    after = tests_of(base)
    retuned = any(c.name == RETUNE for c in search.chosen) or moved(base.problem, base.fit, at.random.effects)
    findings, terms = terms_of(search, base, at.random, retuned, before)
    return replace(
        first,
        verdict=verdict_of(findings, retuned, after, 0.0),
        findings=tuple(findings),
        before=tuple(before),
        after=tuple(after),
        gap=_in_turn(base, at.random.effects),
        mended=replace(noise, terms=(*merged(at.trusted, terms), *at.altering), covariance=None),
        limits=tuple(m for m in limits_of(base) if m[0].name not in {t.effect.name for t in at.trusted}),
        retuned=retuned,
        white=np.zeros(0),
        checks=checked(search, base, findings) if findings else None,
    )


def _in_turn(base: Candidate, believed: Sequence[Effect]) -> Gap:
    """Each recording under what is believed, and under the mended model fitted to the others."""
    problem, joint = base.problem, base.problem.record
    assert isinstance(joint, JointRecord)
    parts = []
    for k, left_out in enumerate(joint.records):
        rest = joint.records[:k] + joint.records[k + 1 :]
        mended = replace(problem, effects=base.fit.effects)
        parts.append(judged(left_out, left_out, rest, believed, mended))
    r0, r1, m = (np.concatenate(x) for x in zip(*parts))
    return divergence(r0, r1, m, "each recording in turn")
