"""A log at rest that is too long to be searched at its full rate: its beginning at that rate, and means of all of it.

The beginning shows what is fast: quantisation, lines, a low-pass, what changes single samples. What it adds to the noise
is then assumed of the means, which show what is slow over the whole log: random walks, drifts, steps, slow periods. What
is fast and comes after the beginning is not looked for, and that is said.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from kfgen.core.errors import InputError
from kfgen.effects import Effect
from kfgen.effects.noise_model import ChannelNoise, Term
from kfgen.gap.core.drivers import drivers_of
from kfgen.gap.core.result import BAD_DATA, EFFECTS_FOUND, GRAVEST_FIRST, NO_GAP, UNKNOWN_EFFECT, Finding
from kfgen.gap.rest.channel_gap import channel_gap, hidden_in_means
from kfgen.gap.rest.comparison import ChannelGap
from kfgen.gap.rest.even_record import regular
from kfgen.gap.rest.explanation import ABSORBERS
from kfgen.gap.rest.words import compared_in_parts, interpolated_samples
from kfgen.identify.evidence.long import CHUNK_SAMPLES, Long, Stream, condense
from kfgen.identify.evidence.record import Record
from kfgen.log.log import Channel, Log, StoredLog

Array = NDArray[np.float64]

MAX_SAMPLES_AT_FULL_RATE = 4_000_000
"""Of a channel at rest: the search holds some 300 bytes for each."""
BEGINNING_SAMPLES = CHUNK_SAMPLES
"""Samples at the beginning of a longer one that are searched at the full rate."""


@dataclass(frozen=True)
class LongLog:
    """The two parts of a long log.

    Parameters
    ----------
    beginning : Log
        At the full rate.
    means : Log
        Of blocks of all of it.
    averaged : int
        Samples in a block.
    dt : float
        Sampling period [s].
    warnings : tuple of str
        What is to be said of its samples.
    """

    beginning: Log
    means: Log
    averaged: int
    dt: float
    warnings: tuple[str, ...] = ()

    @property
    def duration(self) -> float:
        """Length of all of it [s]."""
        return self.means.n * self.averaged * self.dt

    @property
    def name(self) -> str:
        """What its beginning is called beside the whole."""
        return f"the first {self.beginning.n * self.dt:.4g} s at {1.0 / self.dt:.6g} Hz"

    @property
    def said(self) -> str:
        """What is not looked for."""
        return compared_in_parts(
            self.beginning.n * self.dt, self.duration, self.averaged * self.dt, 1.0 / self.dt
        )

    @staticmethod
    def of_stored(log: StoredLog) -> LongLog:
        """Of a log that stays in its file: one pass over every channel.

        Raises
        ------
        InputError
            Channels have different lengths, or most samples of a piece are no numbers.
        """
        if len({c.n for c in log.channels.values()}) > 1:
            raise InputError(
                "its channels have different lengths",
                where=log.source,
                remedy="Choose channels with --columns",
            )
        streams = {n: Stream(c.chunks, c.n, log.dt) for n, c in log.channels.items()}
        channels = {n: Channel(_first(s, BEGINNING_SAMPLES), log.channel(n).si) for n, s in streams.items()}
        n = next(iter(channels.values())).values.size
        t = np.asarray(np.arange(n) * log.dt, dtype=np.float64)
        beginning = Log(t, channels, log.source, log.sha256, log.warnings)
        return LongLog._of(beginning, streams)

    @staticmethod
    def of_log(log: Log, assumed: Mapping[str, ChannelNoise]) -> LongLog:
        """Of a log in memory, with missing samples drawn as in a short one.

        Parameters
        ----------
        log : Log
        assumed : mapping of str to ChannelNoise
            Of the channels that are compared.

        Raises
        ------
        InputError
            As of `kfgen.gap.rest.even_record.regular`.
        """
        records = {name: regular(log, name, noise.effects)[0] for name, noise in assumed.items()}
        streams = {name: Stream.of(r.y, r.dt) for name, r in records.items()}
        even = next(iter(records.values()))
        for name in log.channels.keys() - records.keys():
            values = log.channel(name).values
            there = np.isfinite(values)
            if there.any():
                streams[name] = Stream.of(np.interp(even.t, log.t[there], values[there]), even.dt)
        return LongLog._of(log.cut(0, BEGINNING_SAMPLES), streams)

    @staticmethod
    def _of(beginning: Log, streams: Mapping[str, Stream]) -> LongLog:
        found = {name: _condensed(beginning.source, name, s) for name, s in streams.items()}
        first = next(iter(found.values()))
        m = min(f.means.size for f in found.values())
        channels = {name: replace(beginning.channel(name), values=f.means[:m]) for name, f in found.items()}
        said = tuple(interpolated_samples(f.lost, name) for name, f in found.items() if f.lost)
        means = Log(beginning.t[0] + first.slow.t[:m], channels, beginning.source, beginning.sha256)
        return LongLog(beginning, means, first.block, first.period, said)

    def records(self, names: list[str]) -> dict[str, Record]:
        """The means of channels as records, with the drivers that may explain them, by channel."""
        drive, _ = drivers_of(self.means)
        return {
            name: Record(
                self.means.t,
                self.means.channel(name).values,
                {k: v for k, v in drive.items() if k != name},
                origin=float(self.beginning.t[0]),
                averaged=self.averaged,
            )
            for name in names
        }


def _first(stream: Stream, n: int) -> Array:
    """The first samples of a stream [SI], at most n."""
    pieces: list[Array] = []
    for piece in stream.chunks():
        pieces.append(np.array(piece[: n - sum(p.size for p in pieces)], dtype=np.float64))
        if sum(p.size for p in pieces) >= n:
            break
    return np.concatenate(pieces)


def _condensed(source: str, name: str, stream: Stream) -> Long:
    try:
        return condense(stream)
    except InputError as error:
        raise InputError(error.what, where=f"{source}: channel {name}", remedy=error.remedy) from None


def with_means(
    beginning: ChannelGap, means: Record, noise: ChannelNoise, channels: int = 1
) -> tuple[ChannelGap, ChannelGap]:
    """The answer for a channel of a long log, from that of its beginning, which is then judged once more.

    Parameters
    ----------
    beginning : ChannelGap
        Of its first samples at the full rate.
    means : Record
        Of all of it.
    noise : ChannelNoise
        Assumed of the channel.
    channels : int
        That are compared in this log.

    Returns
    -------
    whole : ChannelGap
        What happens once in the beginning alone is not in it.
    beginning : ChannelGap
        Beside what the means say of slow noise: what looked like a step may be a piece of a walk.
    """
    if beginning.verdict == BAD_DATA:
        return beginning, beginning
    kept = [f for f in beginning.findings if _lasts_and_is_fast(f, means.dt)]
    samples = tuple(t for t in noise.terms if t.effect.changes_samples)
    slow = channel_gap(beginning.channel, means, _assumed_of_means(beginning, noise, kept), channels=channels)
    updated = replace(slow.updated, terms=(*slow.updated.terms, *samples))
    again = beginning
    if len(kept) < len(beginning.findings) or beginning.verdict == UNKNOWN_EFFECT:
        random = tuple(t for t in updated.terms if not t.effect.coefficients())
        again = channel_gap(
            beginning.channel, beginning.record, replace(updated, terms=random), channels=channels
        )
    is_changed = bool(kept or slow.findings or beginning.retuned or slow.retuned)
    verdicts = {again.verdict, slow.verdict, EFFECTS_FOUND if is_changed else NO_GAP}
    of_means = {m.effect.name for m in slow.limits if not _has_frequency(m.effect)} - hidden_in_means()
    whole = replace(
        slow,
        verdict=next(v for v in GRAVEST_FIRST if v in verdicts),
        findings=(*kept, *slow.findings),
        before=tuple(sorted((*beginning.before, *slow.before), key=lambda t: t.p)),
        after=tuple(sorted((*again.after, *slow.after), key=lambda t: t.p)),
        gap=max(beginning.gap, slow.gap, key=lambda g: g.before),
        assumed=beginning.assumed,
        updated=updated,
        limits=(
            *(m for m in slow.limits if m.effect.name in of_means),
            *(m for m in again.limits if m.effect.name not in of_means),
        ),
        retuned=beginning.retuned or slow.retuned,
        own_noise_objection=slow.own_noise_objection or again.own_noise_objection,
        refused=(*again.refused, *slow.refused),
    )
    return whole, again


def _lasts_and_is_fast(finding: Finding, block_s: float) -> bool:
    """Whether what the beginning shows is noise of all of the log, and too fast for the means to show it themselves."""
    effect = finding.effect
    if finding.once or effect.coefficients() or effect.changes_samples:
        return False
    tau = float(getattr(effect, "tau", np.inf))
    return effect.name not in ABSORBERS or tau < block_s


def _assumed_of_means(beginning: ChannelGap, noise: ChannelNoise, kept: list[Finding]) -> ChannelNoise:
    """What is assumed of the means: what was assumed, with the numbers of the beginning, and the fast noise found there."""
    found = [f.effect for f in beginning.findings if f not in kept]
    random = tuple(
        t
        for t in beginning.updated.terms
        if not (t.effect.coefficients() or t.effect.changes_samples) and not _is_one_of(t.effect, found)
    )
    shapes: tuple[Term, ...] = tuple(t for t in noise.terms if t.effect.coefficients())
    return replace(noise, terms=(*random, *shapes), covariance=None)


def _is_one_of(effect: Effect, others: list[Effect]) -> bool:
    return any(effect is other for other in others)


def _has_frequency(effect: Effect) -> bool:
    """Whether it has a frequency, of which the means show the lowest only."""
    return any(p.kind == "frequency" or p.name == "frequency" for p in effect.parameters())
