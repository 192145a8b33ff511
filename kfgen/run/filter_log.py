"""A log under the names of a filter: the barometer ``baro`` of a filter reads what a log calls ``baro_height``."""

from __future__ import annotations

from dataclasses import replace

from kfgen.core.channel_names import acts_on
from kfgen.core.units import parse_unit
from kfgen.log.log import Log
from kfgen.model.filter import FilterModel


def as_named_by(model: FilterModel, log: Log) -> Log:
    """A log in which a sensor of one channel has the filter's name for it.

    Where the log lacks the channel, it is the only one of the log that begins with the sensor's name and is of its kind.

    Parameters
    ----------
    model : FilterModel
    log : Log
    """
    names = {}
    for sensor in (s for s in model.sensors if len(s.channels) == 1 and s.channels[0] not in log.channels):
        (channel,) = sensor.channels
        unit = parse_unit(model.channel_units[channel])
        own = [
            c
            for c, values in log.channels.items()
            if acts_on(channel, c) and parse_unit(values.unit).same_dimension(unit)
        ]
        if len(own) == 1:
            names[own[0]] = channel
    if not names:
        return log
    unplaced = {names.get(c, c): v for c, v in log.unplaced.items()}
    return replace(log, channels={names.get(c, c): v for c, v in log.channels.items()}, unplaced=unplaced)
