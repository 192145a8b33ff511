"""Delays of sensors that a filter knows: its samples belong to an earlier time, and are best fused there."""

from __future__ import annotations

from kfgen.effects.filter_role import ReadingLag
from kfgen.model.filter import FilterModel
from kfgen.model.parts.attached_error import AttachedError, ErrorParameter
from kfgen.model.parts.sensor import Sensor


def known_delays(model: FilterModel, sensor: Sensor) -> dict[str, float]:
    """Delays [s] that all rows of a sensor share, by the names of their constants.

    Parameters
    ----------
    model : FilterModel
    sensor : Sensor
        One of its own.
    """
    own = [e for e in model.errors if e.known and all(e.acts_on(c) for c in sensor.channels)]
    return {p.name: p.value for e in own for p in _delays(e)}


def shifts(model: FilterModel) -> dict[str, float]:
    """By how much the samples of sensors come after their own times [s], where they are fused at these; by sensor.

    What keeps samples of a late input steps on from sample to sample only: there a delay is of first order.
    """
    if model.motion.late:
        return {}
    found = {s.name: sum(known_delays(model, s).values()) for s in model.sensors}
    return {name: delay for name, delay in found.items() if delay}


def without_shifts(model: FilterModel) -> dict[str, float]:
    """The constants of the delays of `shifts`, as they are at a sample's own time: zero."""
    return {n: 0.0 for s in shifts(model) for n in known_delays(model, model.sensor(s))}


def longest_delay(model: FilterModel) -> float:
    """The longest delay of a sensor that a filter knows [s]; zero where there is none."""
    return max((p.value for e in model.errors if e.known for p in _delays(e)), default=0.0)


def _delays(error: AttachedError) -> list[ErrorParameter]:
    """Parameters of an attached error that are a delay of what is read."""
    lag = isinstance(error.role, ReadingLag)
    return [p for p in error.parameters if lag and p.parameter == "delay"]
