"""The gap of sensors at rest: each channel by itself, and the noise that channels share."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from kfgen.core.elapsed import counted
from kfgen.core.time_budget import time_budget
from kfgen.effects.noise_model import NoiseModel
from kfgen.gap.core.drivers import drivers_of
from kfgen.gap.core.result import BAD_DATA
from kfgen.gap.rest.channel_gap import channel_gap
from kfgen.gap.rest.comparison import ChannelGap
from kfgen.gap.rest.cross_axis import with_pairs
from kfgen.gap.rest.even_record import regular
from kfgen.gap.rest.long_log import LongLog, with_means
from kfgen.gap.rest.second_recording import gap_on, happens_once
from kfgen.gap.rest.trust import check_model
from kfgen.gap.result import GapResult, LogSource, Proof, RecordingGap
from kfgen.log.log import Log

SAMPLES_OF_A_WHOLE_SEARCH = 10_000
"""In all channels of a log at rest, from which on its search may take all of the time."""
MIN_SHARE_OF_SEARCH = 0.1
"""Of the time, that the search over a shorter log has."""


def at_rest(
    assumed: NoiseModel, log: Log, names: Sequence[str], others: Sequence[Log], said: Sequence[str]
) -> GapResult:
    """Of sensors at rest, each channel by itself, and the noise that channels share."""
    for name in names:
        check_model(name, assumed.channel(name))
    drive, words = drivers_of(log)
    warnings = [*said, *words]
    gaps = {}
    with time_budget(
        share=min(max(log.n * len(names) / SAMPLES_OF_A_WHOLE_SEARCH, MIN_SHARE_OF_SEARCH), 1.0)
    ):
        for k, name in enumerate(counted(names, "channels", alike=False)):
            noise = assumed.channel(name)
            record, stamps, words = regular(log, name, noise.effects, drive)
            warnings += [w for w in words if w not in warnings]
            with time_budget(parts=len(names) - k):
                gaps[name] = channel_gap(name, record, noise, stamps, log.stated, len(names))
        gaps = with_pairs(gaps)
    proofs = tuple(p for other in others for p in _proofs(gaps, other))
    updated = updated_by(assumed, gaps)
    return GapResult(
        (source_of(log),), tuple(gaps.values()), assumed, updated, tuple(warnings), proofs=proofs
    )


def long_at_rest(
    assumed: NoiseModel, log: LongLog, names: Sequence[str], others: Sequence[Log], said: Sequence[str]
) -> GapResult:
    """Of sensors at rest whose log is too long to be searched at its full rate."""
    with time_budget(parts=2):
        first = at_rest(assumed, log.beginning, names, (), [*said, *log.warnings, log.said])
    before = {c.channels[0]: c for c in first.comparisons if isinstance(c, ChannelGap)}
    records, gaps, again = log.records(list(names)), {}, {}
    for k, name in enumerate(counted(names, "channels", alike=False)):
        with time_budget(parts=len(names) - k):
            noise = assumed.channel(name)
            gaps[name], again[name] = with_means(before[name], records[name], noise, len(names))
    return replace(
        first,
        comparisons=tuple(gaps.values()),
        updated=updated_by(assumed, gaps),
        recordings=(RecordingGap(log.name, tuple(again.values())),),
        proofs=tuple(p for other in others for p in _proofs(gaps, other)),
    )


def updated_by(assumed: NoiseModel, gaps: Mapping[str, ChannelGap]) -> NoiseModel:
    """The noise model with every finding added."""
    channels = {n: gaps[n].updated if n in gaps else c for n, c in assumed.channels.items()}
    return NoiseModel(channels, assumed.provenance)


def _proofs(gaps: Mapping[str, ChannelGap], other: Log) -> list[Proof]:
    """The gap of every channel with a finding over another recording."""
    drive, _ = drivers_of(other)
    out = []
    for name, g in gaps.items():
        if g.verdict != BAD_DATA and (g.findings or g.retuned):
            record, _, _ = regular(other, name, g.updated.effects, drive)
            gap = gap_on(g, record, Path(other.source).name)
            once = tuple(f.effect.title for f in g.findings if happens_once(f.effect))
            out.append(Proof(source_of(other), name, gap, once))
    return out


def source_of(log: Log) -> LogSource:
    """What a log is called, and the hash of its file."""
    return LogSource(log.source, log.sha256)
