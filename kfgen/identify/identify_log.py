"""`identify`: from logs of a sensor at rest to the noise of its channels, in one call."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from kfgen.core.elapsed import counted
from kfgen.core.errors import InputError
from kfgen.core.time_budget import SHARE_OF_IDENTIFICATION, time_budget
from kfgen.core.units import parse_unit
from kfgen.effects import effect_named
from kfgen.effects.driven.proportional import DRIVERS
from kfgen.identify.channels import BAND_ENDS, checked, default_channels, recorded_drivers
from kfgen.identify.evidence.joint import JointRecord
from kfgen.identify.evidence.long import Stream, condense
from kfgen.identify.evidence.published import Published
from kfgen.identify.evidence.record import Evidence, Record
from kfgen.identify.evidence.sampling import evidence
from kfgen.identify.identification import Identification, IdentifiedChannel
from kfgen.identify.identify import MIN_SAMPLES
from kfgen.identify.identify import identify as identify_record
from kfgen.identify.screening.motion import motion_in
from kfgen.identify.screening.rests import at_rest_only, longest_rest
from kfgen.identify.words import COUNTS_AS_NOISE, of_channels
from kfgen.log.log import Channel, Log, StoredLog
from kfgen.log.readers import read_long

AnyLog = Log | StoredLog


def identify(
    logs: AnyLog | str | Path | Sequence[AnyLog | str | Path],
    *,
    channels: Sequence[str] | str | None = None,
    effects: Sequence[str] | str | None = None,
    method: str | None = None,
) -> Identification:
    """Identify the noise of a sensor at rest.

    Parameters
    ----------
    logs : Log, StoredLog or path, or a sequence of them
        One log; several of one sensor, which are fitted together; or a published Allan curve (axis ``tau``).
    channels : sequence of str, or str with commas, optional
        The channels to identify; the sensor channels of the log when left out.
    effects : sequence of str, or str with commas, optional
        Exactly these effects; chosen by the data when left out.
    method : str, optional
        A key of `kfgen.identify.methods.likelihood.METHODS`; ``ml`` when left out, ``allan`` for a curve.

    Returns
    -------
    Identification

    Raises
    ------
    InputError
        There is nothing to identify, an effect or a method is unknown, or a channel cannot be identified; the log
        and the channel are said.
    """
    given = [logs] if isinstance(logs, (Log, StoredLog, str, Path)) else logs
    data = [read_long(log) if isinstance(log, (str, Path)) else log for log in given]
    if not data:
        raise InputError("there is no log to identify", remedy="Give one")
    first = data[0]
    curve = next((d for d in data if d.axis == "tau"), None)
    if curve is not None and len(data) > 1:
        raise InputError("an Allan curve is identified alone", where=curve.source)
    method = method or ("ml" if curve is None else "allan")
    wanted = checked(effects)
    for name in wanted or ():
        effect_named(name, where="--effects")
    names, said = checked(channels), list[str]()
    asked = names is not None
    if names is None:
        names, said = default_channels(first)
    data, moving = _at_rest(data, names)
    found, left_out = {}, list[InputError]()
    with time_budget(share=SHARE_OF_IDENTIFICATION) as budget:
        for k, name in enumerate(counted(names, "channels", alike=False)):
            with time_budget(parts=len(names) - k):
                try:
                    found[name] = _identify_channel(data, name, wanted, method)
                except InputError as error:
                    if asked or len(names) == 1:
                        raise
                    left_out.append(error)
    if not found:
        raise left_out[0]
    said += [f"not identified: {error}" for error in left_out]
    warnings = (
        *(w for d in data for w in d.warnings),
        *moving,
        *said,
        *of_channels({name: c.warnings for name, c in found.items()}),
        *budget.warnings,
    )
    sources = tuple((d.source, d.sha256) for d in data)
    return Identification(found, sources, method, warnings, (*moving, *budget.warnings))


def _at_rest(data: Sequence[AnyLog], names: Sequence[str]) -> tuple[list[AnyLog], list[str]]:
    """The logs, those whose sensors moved in their longest rest; and what is to be said of them."""
    out, said = list[AnyLog](), list[str]()
    for log in data:
        how = motion_in(log, names) if isinstance(log, Log) and log.axis != "tau" else ""
        rest = _rest_of(log) if how and isinstance(log, Log) else None
        out.append(log if rest is None else rest)
        if how:
            said.append(
                COUNTS_AS_NOISE.format(how=how) if rest is None else at_rest_only(rest, how, "identified")
            )
    return out, said


def _rest_of(log: Log) -> Log | None:
    """The longest rest; none where it is too short for a fit, or not known for samples that are no numbers."""
    try:
        rest = longest_rest(log)
    except InputError:
        return None
    return rest if rest is not None and rest.n >= MIN_SAMPLES else None


def identify_samples(
    y: ArrayLike | Mapping[str, ArrayLike],
    *,
    rate: float,
    unit: str,
    effects: Sequence[str] | str | None = None,
    method: str | None = None,
) -> Identification:
    """Identify the noise of evenly sampled numbers.

    Parameters
    ----------
    y : array_like, shape (n,), or mapping of str to such
        Samples in `unit`, not a number where one is missing: of one channel, which is called ``y``, or of channels
        by name. A name of `kfgen.effects.driven.proportional.DRIVERS` is a driver of the others, in its SI unit.
    rate : float
        Sampling rate [Hz].
    unit : str
        Unit of the samples, ``deg/s`` for example.
    effects, method
        As in `identify`.

    Returns
    -------
    Identification

    Raises
    ------
    InputError
        The samples are no row of numbers, the rate is not positive, or they cannot be identified.
    """
    given = y if isinstance(y, Mapping) else {"y": y}
    samples = {name: np.asarray(v, dtype=np.float64) for name, v in given.items()}
    for name, v in samples.items():
        if v.ndim != 1:
            raise InputError(
                f"{name} of shape {v.shape} is no row of numbers",
                remedy="Give one channel, shape (n,), or a mapping of names to channels",
            )
    if not 0.0 < rate < float("inf"):
        raise InputError(f"rate must be positive (got {rate:g})", remedy="Give the sampling rate in hertz")
    channels = {k: Channel.of(v, DRIVERS[k].unit if k in DRIVERS else unit) for k, v in samples.items()}
    t = np.arange(max((v.size for v in samples.values()), default=0)) / rate
    names = [name for name in channels if name not in DRIVERS]
    return identify(Log(t, channels, "samples"), channels=names, effects=effects, method=method)


def _identify_channel(
    logs: Sequence[AnyLog], name: str, wanted: Sequence[str] | None, method: str
) -> IdentifiedChannel:
    """One channel of the logs; errors say the log and the channel."""
    try:
        record, said = channel_evidence(logs, name)
        found = identify_record(record, wanted, method)
    except InputError as error:
        where = error.where or f"{logs[0].source}: channel {name}"
        raise InputError(error.what, where=where, remedy=error.remedy) from None
    unit = logs[0].channel(name).unit
    return IdentifiedChannel(name, unit, replace(found, warnings=(*said, *found.warnings)))


def channel_evidence(logs: Sequence[AnyLog], name: str) -> tuple[Evidence, list[str]]:
    """A channel of logs as evidence for a fit.

    Parameters
    ----------
    logs : sequence of Log or StoredLog
        One log, several of one sensor, or a published curve.
    name : str
        The channel.

    Returns
    -------
    evidence : Evidence
    warnings : list of str
        What is to be said of its sampling.

    Raises
    ------
    InputError
        A log is given twice, lacks the channel or has it in another kind of unit, or cannot be fitted together
        with others.
    """
    first = logs[0]
    if len(logs) == 1 and isinstance(first, StoredLog):
        channel = first.channel(name)
        return condense(Stream(channel.chunks, channel.n, first.dt)), []
    if isinstance(first, Log) and first.axis == "tau":
        return _published(first, name), []
    hashes = [log.sha256 for log in logs if log.sha256]
    if len(set(hashes)) < len(hashes):
        raise InputError("a log is given twice", where=first.source, remedy="Give each log once")
    records, said = [], []
    for log in logs:
        _check_alike(log, first, name)
        if not isinstance(log, Log):
            raise InputError("a log too long for memory is identified alone", where=log.source)
        record, words = evidence(log.t, log.channel(name).values, recorded_drivers(log, but=name))
        said += [f"{log.source}: {w}" if len(logs) > 1 else w for w in words]
        records.append(record)
    if len(records) == 1:
        return records[0], said
    even = tuple(r for r in records if isinstance(r, Record))
    if len(even) < len(records):
        raise InputError(
            "a log with gaps or uneven time cannot be fitted together with others",
            remedy="Identify it alone, cut it at its gaps, or give the sensor's own rate with --rate HZ where it "
            "samples evenly and only the stamps are late",
        )
    return JointRecord(even), said


def _check_alike(log: AnyLog, first: AnyLog, name: str) -> None:
    """A channel must have the same kind of unit in every log."""
    unit, expected = log.channel(name).unit, first.channel(name).unit
    if not parse_unit(unit).same_dimension(parse_unit(expected)):
        raise InputError(
            f"channel {name} is in {unit} here, in {expected} in {first.source}", where=log.source
        )


def _published(log: Log, name: str) -> Evidence:
    """A published Allan curve, with its band where the log has one."""
    band = [log.channels[name + end].values for end in BAND_ENDS if name + end in log.channels]
    if len(band) == 1:
        raise InputError(f"the band of {name} has one end", where=log.source, remedy="Give both, or none")
    return Published.of(log.t, log.channel(name).values, *band)
