"""A log under the names of a filter: the barometer ``baro`` of a filter reads what a log calls ``baro_height``."""

from __future__ import annotations

from dataclasses import replace

from kfgen.core.channel_names import acts_on
from kfgen.core.units import parse_unit
from kfgen.log.log import Log
from kfgen.log.own_rows import with_own_samples
from kfgen.model.filter import FilterModel
from kfgen.model.parts.sensors import sensors


def as_named_by(model: FilterModel, log: Log) -> Log:
    """A log in which a sensor of one channel has the filter's name for it, and sensors have their own samples alone.

    Where the log lacks the channel, it is the only one of the log that begins with the sensor's name and is of its kind.
    A value that the log holds over its rows is one measurement; a filter would take it for as many as it has rows.

    Parameters
    ----------
    model : FilterModel
    log : Log
    """
    names = {}
    for sensor in (s for s in model.sensors if len(s.channels) == 1 and s.channels[0] not in log.channels):
        own = _channels_of(sensor.channels[0], model.channel_units[sensor.channels[0]], log)
        if len(own) == 1:
            names[own[0]] = sensor.channels[0]
    if names:
        unplaced = {names.get(c, c): v for c, v in log.unplaced.items()}
        log = replace(log, channels={names.get(c, c): v for c, v in log.channels.items()}, unplaced=unplaced)
    return with_own_samples(log, (s.channels for s in model.sensors), by_filter=True)


def unused_sensors(model: FilterModel, log: Log) -> tuple[str, ...]:
    """Library sensors, of those whose channels no navigation frame names, that a log has and a filter does not.

    Parameters
    ----------
    model : FilterModel
    log : Log

    Returns
    -------
    tuple of str
        As a filter file names them in ``sensors``.
    """
    used = {s.name for s in model.sensors} | {i.name for i in model.motion.inputs}
    declared = [(s, s.channels) for s in sensors().values() if s.name not in used and not s.is_constraint]
    fixed = [(s, channels) for s, channels in declared if isinstance(channels, tuple) and channels]
    return tuple(s.name for s, channels in fixed if all(_channels_of(c, s.unit, log) for c in channels))


def _channels_of(channel: str, unit: str, log: Log) -> list[str]:
    """Channels of a log that may stand for one of a sensor: of its kind, and their names begin with it."""
    wanted = parse_unit(unit)
    return [
        c
        for c, v in log.channels.items()
        if acts_on(channel, c) and parse_unit(v.unit).same_dimension(wanted)
    ]
