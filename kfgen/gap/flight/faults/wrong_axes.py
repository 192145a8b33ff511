"""Channels of a flight that read another axis of their triad, or the opposite: the filter follows the log with them exchanged.

A filter whose gyro turns the other way follows nothing, and what a fit would then name means nothing. So where it does not
follow, it flies the log again with every pair of channels of a triad exchanged and every channel negated.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from kfgen.core.errors import InputError
from kfgen.effects import Effect
from kfgen.effects.faults.axes import axis_faults
from kfgen.emit.routines import Program
from kfgen.gap.flight.first_flight import flight_score
from kfgen.gap.flight.flight_log import flight_log
from kfgen.gap.flight.rows import rows_of
from kfgen.gap.scene.scene import Placed
from kfgen.log.log import Log
from kfgen.model.filter_equations import FilterEquations

MIN_GAIN_NATS_PER_READING = 0.1
"""Of log-likelihood, by which a log with other axes must be likelier."""
MIN_GAIN_NATS = 100.0
Turn = tuple[tuple[int, float], ...]
"""The channel of which each axis of a triad is read, and its sign."""


def wrong_axes(log: Log, program: Program) -> tuple[tuple[Placed, ...], Log]:
    """What is wrong with the axes of a log, and the log without it; nothing where it is likeliest as it is.

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
    as_logged = flight_log(log, program)
    equations = FilterEquations(as_logged.discrete)
    least = max(MIN_GAIN_NATS, MIN_GAIN_NATS_PER_READING * rows_of(as_logged).t.size)
    best, found, likeliest = flight_score(as_logged, equations) + least, tuple[Placed, ...](), log
    for channels in _triads(log, program):
        for turn in _turns():
            read = _turned(log, channels, turn)
            reached = _score(read, program, equations)
            if reached > best:
                best, found, likeliest = reached, tuple(_faults(channels, turn)), read
    return found, likeliest


def _triads(log: Log, program: Program) -> list[Sequence[str]]:
    """The channels of each sensor that reads three body axes."""
    model = program.discrete.model
    every = [i.channels for i in model.motion.inputs] + [s.channels for s in model.sensors]
    bodies = [c for c in every if [n.rpartition("_")[2] for n in c] == ["x", "y", "z"]]
    return [c for c in bodies if all(n in log.channels for n in c)]


def _turns() -> Iterator[Turn]:
    """One channel negated, or two exchanged with either sign."""
    for k in range(3):
        yield tuple((i, -1.0 if i == k else 1.0) for i in range(3))
        a, b = (k + 1) % 3, (k + 2) % 3
        for signs in ((1.0, 1.0), (1.0, -1.0), (-1.0, 1.0)):
            source = {a: (b, signs[0]), b: (a, signs[1]), k: (k, 1.0)}
            yield tuple(source[i] for i in range(3))


def _turned(log: Log, channels: Sequence[str], turn: Turn) -> Log:
    """The log with a triad read otherwise."""
    read = {
        channels[i]: replace(log.channels[channels[i]], values=sign * log.channels[channels[j]].values)
        for i, (j, sign) in enumerate(turn)
    }
    return replace(log, channels={**log.channels, **read})


def _score(log: Log, program: Program, equations: FilterEquations) -> float:
    try:
        return flight_score(flight_log(log, program), equations)
    except InputError:
        return -np.inf


def _faults(channels: Sequence[str], turn: Turn) -> list[Placed]:
    """Of each channel whose readings are those of another axis."""
    faults: list[Placed] = []
    for i, (j, sign) in enumerate(turn):
        row = np.zeros(3)
        row[i] = sign
        found: list[Effect] = axis_faults(row, j)  # channel j reads what axis i should have read
        faults += [Placed(f, channels[j]) for f in found]
    return faults
