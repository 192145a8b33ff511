"""Times at which a log has no row at all: a logger that stops while the vehicle is disarmed leaves one file of two flights."""

from __future__ import annotations

import numpy as np

from kfgen.core.numbers import how_many, moment
from kfgen.log.log import Log

MAX_HELD_S = 1.0
"""For which a filter may hold the last reading of its inputs [s]: within it, inertial sensors may miss a whole turn."""
MAX_HELD_PERIODS = 10.0
"""The same in periods of a log that is slower."""


def pauses(log: Log) -> list[tuple[int, int]]:
    """The pauses of a log, each as its last row before it and its first row after it.

    Parameters
    ----------
    log : Log

    Returns
    -------
    list of (int, int)
        Of those longer than `MAX_HELD_S` and `MAX_HELD_PERIODS`.
    """
    long = np.flatnonzero(np.diff(log.t) > max(MAX_HELD_S, MAX_HELD_PERIODS * log.dt))
    return [(int(k), int(k) + 1) for k in long]


def longest_part(log: Log) -> Log:
    """The longest part of a log between its pauses; the log itself where it has none.

    Parameters
    ----------
    log : Log
    """
    paused = pauses(log)
    if not paused:
        return log
    starts, stops = [0, *(after for _, after in paused)], [*(after for _, after in paused), log.n]
    first, stop = max(zip(starts, stops), key=lambda part: float(log.t[part[1] - 1] - log.t[part[0]]))
    return log.cut(first, stop)


def in_words(log: Log) -> str:
    """The pauses of a log that has some: the longest, and how many more.

    Parameters
    ----------
    log : Log
    """
    paused = pauses(log)
    before, after = max(paused, key=lambda p: float(log.t[p[1]] - log.t[p[0]]))
    more = f", and {how_many(len(paused) - 1, 'other pause')}" if len(paused) > 1 else ""
    return f"the log has no row for {log.t[after] - log.t[before]:.4g} s from {moment(float(log.t[before]))} s on{more}"


def longest_part_of(log: Log, part: Log) -> str:
    """That the longest part of a log between its pauses is what a filter is compared with.

    Parameters
    ----------
    log, part : Log
        The whole, and the part.

    Returns
    -------
    str
        A sentence.
    """
    return (
        f"{in_words(log)}: compared is its longest part, {moment(float(part.t[0]))} to {moment(float(part.t[-1]))} s, "
        "for through a pause no filter follows the vehicle"
    )
