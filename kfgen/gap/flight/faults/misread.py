"""Channels of a flight that are read wrongly: another axis, the opposite sign, another unit; put right, the filter follows.

A filter whose gyro turns the other way follows nothing, and what a fit would then name means nothing. So where it does not
follow, it flies the log again with every pair of channels of a triad exchanged, every channel negated, every sensor
in the units that are taken for its own; what makes the log likelier stays, until nothing does any more.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import groupby

import numpy as np

from kfgen.core.errors import InputError
from kfgen.core.units import STANDARD_GRAVITY
from kfgen.effects import Effect
from kfgen.effects.faults.axes import SignError, axis_faults
from kfgen.effects.faults.samples import UnitError, unit_factors
from kfgen.emit.routines import Program
from kfgen.gap.core.drivers import recorded
from kfgen.gap.flight.first_flight import flight_score
from kfgen.gap.flight.flight_log import FlightLog, flight_log
from kfgen.gap.flight.rows import rows_of
from kfgen.gap.scene.scene import Placed
from kfgen.log.log import Log
from kfgen.model.filter import FilterModel
from kfgen.model.filter_equations import FilterEquations

MIN_GAIN_NATS_PER_READING = 0.1
"""Of log-likelihood, by which a log that is read otherwise must be likelier."""
MIN_GAIN_NATS = 100.0
NATS_PER_FAULT = 1.0
"""Paid for each channel: a magnetometer turned over, or all that is on board instead, are equally likely in the filter."""
MAX_MISREAD = 4
"""Triads and sensors that are misread in one log, at most."""
BODY, EARTH = "xyz", "NED"
USUAL_LENGTH = {"mag": (15e-6, 100e-6), "accel": (0.3 * STANDARD_GRAVITY, 3.0 * STANDARD_GRAVITY)}
"""Between which the median length of what a triad shows is where people fly: of the Earth's field [T], iron on board
included, with whose own a filter agrees in any unit, and of the specific force [m/s^2], which clipping makes larger."""

Turn = Mapping[int, tuple[int, float]]
"""Of which axis each of some axes of a triad is to be read, and with which sign."""
BOARD_TURNS: tuple[Turn, ...] = tuple(
    turn
    for a, b in ((0, 1), (1, 2), (2, 0))
    for turn in ({a: (a, -1.0), b: (b, -1.0)}, {a: (b, 1.0), b: (a, -1.0)}, {a: (b, -1.0), b: (a, 1.0)})
)
"""Turns of a whole board: half and quarter turns about its axes."""
SENSOR_TURNS: tuple[Turn, ...] = (
    *BOARD_TURNS,
    *({k: (k, -1.0)} for k in range(3)),
    *({a: (b, 1.0), b: (a, 1.0)} for a, b in ((0, 1), (1, 2), (2, 0))),
)
"""Those, an axis that is negated, two that are exchanged."""
EARTH_TURNS: tuple[Turn, ...] = ({2: (2, -1.0)}, {0: (1, 1.0), 1: (0, 1.0)})
"""Up for down, and east for north."""


@dataclass(frozen=True)
class Misreading:
    """What channels read wrongly, and from which channel and with which factor each is to be read."""

    faults: tuple[Placed, ...]
    read: Mapping[str, tuple[str, float]]

    def put_right(self, log: Log) -> Log:
        """The log as it should have been."""
        right = {
            c: replace(log.channels[c], values=factor * log.channels[source].values)
            for c, (source, factor) in self.read.items()
        }
        return replace(log, channels={**log.channels, **right})

    def cost_nats(self, log: FlightLog) -> float:
        """Paid for its faults, and what aiding readings gain by being made smaller: the density of as many smaller ones."""
        by = {c: -np.log(abs(factor)) for c, (_, factor) in self.read.items() if abs(factor) < 1.0}
        shrunk = sum(a.t.size * by.get(c, 0.0) for a in log.aiding for c in a.sensor.channels)
        return float(shrunk + NATS_PER_FAULT * len(self.faults))


def misread(log: Log, program: Program) -> tuple[tuple[Placed, ...], Log]:
    """What a log reads wrongly, and the log without it; nothing where it is likeliest as it is.

    Parameters
    ----------
    log : Log
    program : Program
        Of the filter, at the log's rate.

    Raises
    ------
    InputError
        As of `kfgen.gap.flight.flight_log.flight_log`.
    """
    known = recorded(log)  # no driver is read wrongly
    as_flown = partial(flight_log, program=program, known=known)
    as_logged = as_flown(log)
    equations = FilterEquations(as_logged.discrete)
    least = max(MIN_GAIN_NATS, MIN_GAIN_NATS_PER_READING * rows_of(as_logged).t.size)
    faults, best = tuple[Placed, ...](), flight_score(as_logged, equations)
    for _ in range(MAX_MISREAD):
        wanted, found = best + least, None
        for m in _misreadings(log, program.discrete.model):
            right = m.put_right(log)
            lost = m.cost_nats(as_logged)
            score = _score(as_flown, right, equations, wanted + lost) - lost
            if score > wanted:
                wanted, found = score, m
        if found is None:
            break
        best = wanted + found.cost_nats(as_logged)  # as it is compared from here on
        log, faults = found.put_right(log), (*faults, *found.faults)
    return faults, log


def _score(of: Callable[[Log], FlightLog], log: Log, equations: FilterEquations, least: float) -> float:
    try:
        return flight_score(of(log), equations, least)
    except InputError:
        return -np.inf


def _misreadings(log: Log, model: FilterModel) -> Iterator[Misreading]:
    """All that may be read wrongly: in one sensor, in all of one receiver, in the inertial ones, in all on board."""
    sensors = [tuple(i.channels) for i in model.motion.inputs]
    sensors += [tuple(s.channels) for s in model.sensors]
    sensors = [s for s in sensors if all(c in log.channels for c in s)]
    receivers = [[*g] for _, g in groupby(sorted(sensors), key=lambda s: s[0].partition("_")[0])]
    on_board = [s for s in sensors if _axes(s) == BODY]
    inertial = [s for s in on_board if any(s == tuple(i.channels) for i in model.motion.inputs)]
    for group in [[s] for s in sensors] + [g for g in (*receivers, inertial, on_board) if len(g) > 1]:
        if all(_axes(s) in (BODY, EARTH) for s in group):
            turns = (
                EARTH_TURNS if _axes(group[0]) == EARTH else BOARD_TURNS if len(group) > 1 else SENSOR_TURNS
            )
            yield from (_turned(group, t) for t in turns)
        elif len(group) == 1 and len(group[0]) == 1:
            channel = group[0][0]
            yield Misreading((Placed(SignError(), channel),), {channel: (channel, -1.0)})
        yield from _in_other_units(group, log)


def _axes(channels: Sequence[str]) -> str:
    """The letters of a sensor's axes."""
    return "".join(c.rpartition("_")[2] for c in channels)


def _turned(triads: Sequence[Sequence[str]], turn: Turn) -> Misreading:
    """Every triad with each of some axes read of another, or of itself, with a sign."""
    faults = [Placed(f, t[j]) for t in triads for i, (j, s) in turn.items() for f in _said(i, j, s)]
    return Misreading(tuple(faults), {t[i]: (t[j], s) for t in triads for i, (j, s) in turn.items()})


def _said(axis: int, source: int, sign: float) -> list[Effect]:
    """What is wrong with channel `source` of a triad, of which another `axis` is to be read with a sign."""
    row = np.zeros(3)
    row[axis] = sign
    return axis_faults(row, source)


def _in_other_units(sensors: Sequence[Sequence[str]], log: Log) -> Iterator[Misreading]:
    """Sensors whose readings are in a unit that is taken for theirs, all by the same factor."""
    factors = [set(_factors(log, s)) for s in sensors]
    for factor in sorted(set.intersection(*factors)):
        faults = [Placed(UnitError(factor), sensor_of(s)) for s in sensors]
        yield Misreading(tuple(faults), {c: (c, 1.0 / factor) for s in sensors for c in s})


def _factors(log: Log, channels: Sequence[str]) -> Sequence[float]:
    """By which a sensor's readings may be too large; of a triad those with which it shows the Earth's field, or gravity."""
    factors = unit_factors(log.channels[channels[0]].unit)
    if sensor_of(channels) not in USUAL_LENGTH:
        return factors
    lo, hi = USUAL_LENGTH[sensor_of(channels)]
    seen = float(np.nanmedian(np.linalg.norm([log.channels[c].values for c in channels], axis=0)))
    return [] if lo <= seen <= hi else [f for f in factors if lo <= seen / f <= hi]


def sensor_of(channels: Sequence[str]) -> str:
    """The place that holds all channels of a sensor.

    Parameters
    ----------
    channels : sequence of str
        Of one sensor.
    """
    return channels[0] if len(channels) == 1 else channels[0].rpartition("_")[0]
