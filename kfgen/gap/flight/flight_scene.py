"""The flight of a filter over a log, where the log and the filter allow one."""

from __future__ import annotations

from kfgen.gap.flight.flight_log import flight_log
from kfgen.gap.flight.path import flown
from kfgen.gap.flight.scene import FlightScene
from kfgen.log.log import Log
from kfgen.model.filter import FilterModel
from kfgen.run.run import program_over

ATTITUDE_SENSORS = ("accel", "gyro", "mag")
"""Sensors that alone aid no flight: a log of them is one of sensors at rest or in poses."""


def flight_scene(log: Log, model: FilterModel) -> FlightScene | None:
    """The world of a filter in flight; None where the log lacks its inputs or has no aiding sensor of it.

    Parameters
    ----------
    log : Log
        Its references, where it has any, are not looked at.
    model : FilterModel

    Raises
    ------
    InputError
        The filter diverges, or the extra ``kfgen[fast]`` is not installed.
    """
    inputs = [c for i in model.motion.inputs for c in i.channels]
    aiding = [
        s
        for s in model.sensors
        if s.name not in ATTITUDE_SENSORS and all(c in log.channels for c in s.channels)
    ]
    if model.attitude is None or not aiding or not all(c in log.channels for c in inputs):
        return None
    program = program_over(model, log)
    if program.discrete.memories:
        return None
    return FlightScene(flown(flight_log(log, program)))
