"""A log through the reference: the calls that firmware would make, and state and covariance after each of them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kfgen.emit.routines import Program
from kfgen.emit.scenario import RecordedCall, scenario
from kfgen.emit.targets.filterpy import class_name
from kfgen.emit.targets.loaded import loaded
from kfgen.emit.targets.plain import module
from kfgen.run.filter_calls import FilterCalls, Given


@dataclass(frozen=True)
class Replay:
    """What a core is given after ``init``, and what it must hold.

    Parameters
    ----------
    start : mapping of str to sequence of float
        Arrays of the filter that are set before the first call.
    calls : tuple of Call
    ends : tuple of int
        How many of the calls were made when the updates of each sample of the log were done.
    refused : mapping of str to int
        How often the reference answered with each status but OK.
    """

    start: Mapping[str, Sequence[float]]
    calls: tuple[RecordedCall, ...]
    ends: tuple[int, ...] = ()
    refused: Mapping[str, int] = field(default_factory=dict)


def simulated(program: Program) -> Replay:
    """The calls of the proof's own scenario."""
    return Replay({}, scenario(program))


class _Reference:
    """The emitted numpy module, which equals the interpreted reference in every bit and is a hundred times as fast."""

    def __init__(self, program: Program) -> None:
        self._filter = getattr(loaded(module(program)), class_name(program))()
        self._program = program
        self.calls: list[RecordedCall] = []
        self.refused: Counter[str] = Counter()

    def put(self, start: Mapping[str, Sequence[float]]) -> None:
        """Set arrays of the filter."""
        for name, values in start.items():
            getattr(self._filter, name)[:] = values

    def call(self, routine: str, given: Given) -> None:
        """Make a call, with its arguments in the program's precision, and keep it."""
        row = np.hstack([np.ravel(v) for v in given.values()]).astype(self._program.type)
        status = getattr(self._filter, routine)(**given).name
        if status != "OK":
            self.refused[status] += 1
        words: NDArray[np.floating[Any]] = np.concatenate(
            [getattr(self._filter, array) for array in self._program.compared]
        )
        self.calls.append(RecordedCall(routine, tuple(row.tolist()), words))


def replay(calls: FilterCalls) -> Replay:
    """The calls of a log, with what the filter must hold after each.

    Firmware sets the same before its first call: the aligned state, the constants that the log shows, and here a
    gates that are open, as in `kfgen.run.run.run`.
    """
    start = {
        "x": calls.start,
        "k": [*calls.constants, *[calls.GATE] * len(calls.program.discrete.model.sensors)],
    }
    reference = _Reference(calls.program)
    reference.put(start)
    ends = []
    for k in range(calls.log.n):
        for call in calls.updates(k):
            reference.call(call.routine, call.given)
        ends.append(len(reference.calls))
        for call in calls.steps(k):
            reference.call(call.routine, call.given)
    return Replay(start, tuple(reference.calls), tuple(ends), dict(reference.refused))
