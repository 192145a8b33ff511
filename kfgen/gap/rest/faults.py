"""Integrity first: faults of the samples and their times, before any fit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from kfgen.effects import Effect, catalogue
from kfgen.effects.faults.samples import (
    MIN_STEPS_FOR_REPEATS,
    Clipping,
    Fault,
    UnitError,
    is_between_units,
)
from kfgen.effects.noise_model import ChannelNoise
from kfgen.effects.series import DetectedFault, RawSamples
from kfgen.gap.core.battery import Test
from kfgen.gap.core.holdout import Gap, ratios
from kfgen.gap.core.result import BAD_DATA, Finding
from kfgen.gap.rest.comparison import ChannelGap, span_of
from kfgen.gap.rest.second_recording import lasts
from kfgen.identify.evidence.record import Record

Array = NDArray[np.float64]

MAX_LOG_POWER_OFF = 1.1
"""Of a band's power from that of the scaled model, as a logarithm: a factor of three."""
MIN_SCALED_SHARE = 0.9
"""Of the ordinates, and half of the bands of equal logarithmic width, that are scaled so."""


def spotted_in(
    record: Record, noise: ChannelNoise, stamps: Array | None = None, stated: float = 0.0
) -> list[DetectedFault]:
    """The faults that a channel shows, those that spoil it first; means of samples show none.

    Parameters
    ----------
    record : Record
    noise : ChannelNoise
        Assumed; of its effects only those that spoil the samples are said again: no model can have them.
    stamps : ndarray, optional
        Time stamps as they were logged [s].
    stated : float
        How long the log's header says that it lasted [s].
    """
    if record.averaged > 1:
        return []
    known = {e.name for e in noise.effects}
    assumed = assumed_sd(noise.effects, record.dt)
    if stamps is None or stamps.size == record.n:
        raw = RawSamples(record.t if stamps is None else stamps, record.y, assumed, stated)
    else:
        raw = RawSamples(stamps, np.interp(stamps, record.t, record.y), assumed, stated)
    found = [f for f in _of(raw, list(catalogue().values())) if f.spoils or f.effect.name not in known]
    return [f for f in found if not isinstance(f.effect, UnitError) or _scales(f.effect, record, noise)]


def _scales(error: UnitError, record: Record, noise: ChannelNoise) -> bool:
    """Whether a wrong unit explains a record: it scales all frequencies alike, by a factor between units of its quantity."""
    if not is_between_units(float(error.factor), noise.unit):
        return False
    random = [e for e in noise.effects if not e.coefficients() and not e.changes_samples]
    r, m = ratios(record, random, np.zeros(0))
    alike = np.abs(np.log(r / float(error.factor) ** 2)) < MAX_LOG_POWER_OFF
    return float(m[alike].sum()) > MIN_SCALED_SHARE * float(m.sum()) and bool(np.median(alike) > 0.5)


def _of(raw: RawSamples, effects: Sequence[type[Effect]]) -> list[DetectedFault]:
    """The faults among effects that samples show, those that spoil them first."""
    faults = [f for cls in effects if (f := cls.detect_fault(raw)) is not None]
    if len(faults) > 1:  # values on a faulty ADC grid repeat by themselves
        faults = [f for f in faults if f.effect.name != "repeated_samples" or f.samples > 0.2 * raw.n]
    return sorted(faults, key=lambda f: not f.spoils)


def assumed_sd(effects: Sequence[Effect], dt: float) -> float:
    """Standard deviation of the white part of a sample [SI].

    Parameters
    ----------
    effects : sequence of Effect
    dt : float
        Sampling period [s].
    """
    white = sum(float(e.form().V) / dt + 2.0 * float(e.form().Z) / dt**2 for e in effects)
    return float(np.sqrt(white))


def spotted_moving(t: Array, y: Array, effects: Sequence[Effect], dt: float) -> list[DetectedFault]:
    """The faults that the samples of a sensor show that moves, those that spoil them first; both ends of a clipping.

    Clipped samples can be left out, and spoil nothing if they are no more than half of all.

    Parameters
    ----------
    t : ndarray, shape (n,)
        [s].
    y : ndarray, shape (n,)
        [SI].
    effects : sequence of Effect
        Assumed of the channel.
    dt : float
        Sampling period [s].
    """
    known = {e.name for e in effects}
    looked = [c for n, c in catalogue().items() if n not in known and issubclass(c, Fault) and c.moving]
    raw = RawSamples(t, y, assumed_sd(effects, dt), moves=True)
    clipped, raw = clipped_in(raw) if Clipping.name not in known else ([], raw)
    spoilt = sum(c.samples for c in clipped) > 0.5 * y.size
    others = [c for c in looked if c is not Clipping]
    return [
        *(replace(c, spoils=spoilt) for c in clipped),
        *(_of(raw, others) if raw.n >= MIN_STEPS_FOR_REPEATS else ()),
    ]


def clipped_in(raw: RawSamples) -> tuple[list[DetectedFault], RawSamples]:
    """Both ends at which samples are clipped, and the samples that are not.

    Parameters
    ----------
    raw : RawSamples
        Of a sensor that moves.
    """
    clipped: list[DetectedFault] = []
    while (one := Clipping.detect_fault(raw)) is not None and len(clipped) < 2:
        clipped.append(one)
        assert isinstance(one.effect, Clipping)
        inside = raw.y != float(one.effect.limit)
        raw = replace(raw, t=raw.t[inside], y=raw.y[inside])
        if raw.n < MIN_STEPS_FOR_REPEATS:
            break
    return clipped, raw


def fault_finding(fault: DetectedFault, channel: str, record: Record, unit: str) -> Finding:
    """A fault as a finding; its evidence is the number of samples that show it.

    Parameters
    ----------
    fault : DetectedFault
    channel : str
    record : Record
        Of the channel.
    unit : str
        Of the channel.
    """
    test = Test(fault.effect.title, 0.0, (0.0, 0.5 / record.dt), 1.0, channel=channel)
    once = not lasts(type(fault.effect))
    return Finding(fault.effect, channel, unit, evidence_nats=fault.samples, test=test, once=once)


def spoilt(channel: str, record: Record, noise: ChannelNoise, faults: Sequence[DetectedFault]) -> ChannelGap:
    """The answer where a fit would mean nothing: the faults alone.

    Parameters
    ----------
    channel : str
    record : Record
    noise : ChannelNoise
    faults : sequence of DetectedFault
    """
    findings = tuple(fault_finding(f, channel, record, noise.unit) for f in faults)
    tests = tuple(f.test for f in findings if f.test)
    return ChannelGap(
        channels=(channel,),
        unit=noise.unit,
        verdict=BAD_DATA,
        findings=findings,
        before=tests,
        after=tests,
        gap=Gap(0.0, 0.0, 0.0, (0.0, 0.0), "nothing: no fit was made"),
        span_s=span_of(record),
        assumed=noise.effects,
        updated=noise,
        record=record,
    )
