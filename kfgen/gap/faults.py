"""Integrity first: faults of the samples and their times, before any fit."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from kfgen.effects import catalogue
from kfgen.effects.series import Raw, Spotted
from kfgen.gap.battery import Test
from kfgen.gap.finding import ChannelGap, Finding
from kfgen.gap.proof import Gap
from kfgen.identify.record import Record
from kfgen.noise import ChannelNoise

Array = NDArray[np.float64]


def spotted_in(
    record: Record, noise: ChannelNoise, stamps: Array | None = None, stated: float = 0.0
) -> list[Spotted]:
    """The faults that a channel shows, those that spoil it first."""
    white = sum(float(e.form().V) / record.dt + 2.0 * float(e.form().Z) / record.dt**2 for e in noise.effects)
    known = {e.name for e in noise.effects}
    if stamps is None or stamps.size == record.n:
        raw = Raw(record.t if stamps is None else stamps, record.y, float(np.sqrt(white)), stated)
    else:
        raw = Raw(stamps, np.interp(stamps, record.t, record.y), float(np.sqrt(white)), stated)
    found = [cls.spotted(raw) for name, cls in catalogue().items() if name not in known]
    faults = [f for f in found if f is not None]
    if len(faults) > 1:  # values on a faulty lattice repeat by themselves
        faults = [f for f in faults if f.effect.name != "repeated_samples" or f.samples > 0.2 * raw.n]
    return sorted(faults, key=lambda f: not f.spoils)


def said_of(fault: Spotted, record: Record) -> Finding:
    """A fault as a finding."""
    test = Test(fault.effect.title, 0.0, (0.0, 0.5 / record.dt), 1.0)
    return Finding(fault.effect, {}, 1.0, fault.samples, (), test)


def spoilt(channel: str, record: Record, noise: ChannelNoise, faults: Sequence[Spotted]) -> ChannelGap:
    """The answer where a fit would mean nothing: the faults alone."""
    findings = tuple(said_of(f, record) for f in faults)
    tests = tuple(f.worst for f in findings)
    nothing = Gap(0.0, 0.0, 0.0, (0.0, 0.0), "nothing: no fit was made")
    return ChannelGap(
        channel, noise.unit, "bad_data", findings, tests, tests, nothing, noise.effects, noise, (), record
    )
