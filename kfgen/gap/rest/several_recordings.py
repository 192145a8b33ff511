"""Several recordings of one sensor, and one model of them.

What lasts is fitted to all of them together: noise, and shapes, which must come again with the same size in each (a ramp,
a warm-up, a temperature term), where a random walk goes another way each time. What happens once, lines (whose phase is
another one each time) and what changes single samples are found in each recording by itself, and removed where
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
from kfgen.gap.core.holdout import Gap, HeldOut, divergence, judged
from kfgen.gap.core.result import BAD_DATA
from kfgen.gap.core.search import refused_of, searched
from kfgen.gap.rest.channel_gap import (
    Prepared,
    as_written,
    channel_gap,
    checked,
    limits_of,
    prepared,
    terms_of,
    tests_of,
    verdict_of,
)
from kfgen.gap.rest.comparison import ChannelGap
from kfgen.gap.rest.evidence import Candidate
from kfgen.gap.rest.explanation import search_limits
from kfgen.gap.rest.second_recording import lasts
from kfgen.gap.rest.trust import merged, moved
from kfgen.identify.evidence.joint import JointRecord
from kfgen.identify.evidence.record import Record

Array = NDArray[np.float64]

ONCE_MIN_PROBABILITY = 0.95
"""Probability above which what happened once is removed from its recording; below, it may be slow noise."""


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
        As of `kfgen.gap.rest.channel_gap.channel_gap`.
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


def joint_gap(
    channel: str, recordings: Sequence[Recording], noise: ChannelNoise, channels: int = 1
) -> JointGap:
    """Compare several recordings of one channel with the noise that is assumed about it.

    Parameters
    ----------
    channel : str
    recordings : sequence of Recording
    noise : ChannelNoise
    channels : int
        That are compared in these recordings.

    Returns
    -------
    JointGap

    Raises
    ------
    InputError
        No recording can be used, or as of `channel_gap`.
    """
    alone = [
        (r.name, channel_gap(channel, r.record, noise, r.stamps, r.stated, channels)) for r in recordings
    ]
    good = [(r, g) for r, (_, g) in zip(recordings, alone) if g.verdict != BAD_DATA]
    if not good:
        raise InputError(
            f"the samples of {channel} are faulty in every recording", remedy="See each by itself"
        )
    if len(good) == 1:
        return JointGap(good[0][1], tuple(alone))
    ready = [prepared(_steady(r.record, g), noise.in_record(r.record.dt, r.record.duration)) for r, g in good]
    return JointGap(_of_all(channel, ready, good[0][1], noise, channels), tuple(alone))


def _steady(record: Record, found: ChannelGap) -> Record:
    """A recording without what surely happened once in it."""
    sure = [
        f.effect for f in found.findings if f.probability > ONCE_MIN_PROBABILITY and not lasts(type(f.effect))
    ]
    clean = found.clean if found.clean is not None else record
    return replace(clean, y=clean.y - clean.drift([e for e in sure if e.coefficients()]), block=1)


def _of_all(
    channel: str, ready: Sequence[Prepared], first: ChannelGap, noise: ChannelNoise, channels: int
) -> ChannelGap:
    joint = JointRecord(tuple(p.raw for p in ready))
    at = ready[0]
    passing = frozenset(name for name, cls in catalogue().items() if not lasts(cls))
    start = replace(at.search, record=joint, without=at.search.without | passing)
    before = tests_of(channel, as_written(joint, at.random.effects))
    search = searched(start, search_limits(channels)).without_vanished()
    base = search.base
    after = tests_of(channel, base)
    retuned = search.is_retuned or moved(base.problem, base.fit, at.random.effects)
    findings, terms = terms_of(channel, search, at.random, retuned, before)
    findings, checks = checked(search, findings)
    return replace(
        first,
        verdict=verdict_of(findings, retuned, after, 0.0),
        findings=tuple(findings),
        before=tuple(before),
        after=tuple(after),
        gap=_in_turn(base, at.random.effects),
        updated=replace(noise, terms=(*merged(at.trusted, terms), *at.altering), covariance=None),
        limits=limits_of(channel, noise.unit, base, at.trusted),
        comb_hz=0.0,
        retuned=retuned,
        own_noise_objection="",
        refused=tuple(replace(r, where=channel) for r in refused_of(search)),
        white=np.zeros(0),
        checks=checks,
    )


def _in_turn(base: Candidate, assumed: Sequence[Effect]) -> Gap:
    """Each recording under what is assumed, and under the updated model fitted to the others."""
    problem, joint = base.problem, base.problem.record
    assert isinstance(joint, JointRecord)
    parts = []
    for k, left_out in enumerate(joint.records):
        rest = joint.records[:k] + joint.records[k + 1 :]
        updated = replace(problem, effects=base.fit.effects)
        parts.append(judged(left_out, left_out, rest, assumed, updated))
    r0, r1, m = (np.concatenate(x) for x in zip(*((p.before, p.after, p.m) for p in parts)))
    return divergence(HeldOut(r0, r1, m), "each recording in turn")
