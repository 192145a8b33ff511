"""`Fleet`: the answers over many logs put together."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kfgen.core.errors import InputError
from kfgen.fleet.population import TESTED, OutlyingSensor, Population, deviation, outliers, population
from kfgen.fleet.reading import Found, LogReading, ReadNumber, effects_of, readings_of

Array = NDArray[np.float64]

RATE = 0.01
"""Share of fleets without an outlier in which one is named, over all their numbers together."""


@dataclass(frozen=True)
class Outcome:
    """What became of one log.

    Parameters
    ----------
    log : str
        Its path.
    data : mapping or None
        The answer, ``kfgen-identify-1`` or ``kfgen-gap-1``; None where there is none.
    error : str
        Why.
    """

    log: str
    sha256: str = ""
    data: Mapping[str, Any] | None = None
    error: str = ""
    warnings: tuple[str, ...] = ()

    @property
    def complaint(self) -> str:
        """The error with the log that it is about."""
        return self.error if self.error.startswith(self.log) else f"{self.log}: {self.error}"


@dataclass(frozen=True)
class Shared:
    """A number over the sensors that have it.

    Parameters
    ----------
    population : Population or None
        Of the logarithms where the number cannot be negative; None where no interval is closed, and of what
        belongs to a record and not to its sensor.
    outliers : tuple of (Reading, Apart)
    """

    number: ReadNumber
    unit: str
    readings: tuple[LogReading, ...]
    population: Population | None
    outliers: tuple[tuple[LogReading, OutlyingSensor], ...] = ()

    def back(self, value: float) -> float:
        """From the scale of the population to a value [SI]."""
        return float(np.exp(value)) if self.number.positive else value


@dataclass(frozen=True)
class Tally:
    """In which of the logs an effect was found."""

    found: Found
    logs: tuple[str, ...]
    of: int

    @property
    def kind(self) -> str:
        """``common`` to all, ``one-off``, or ``some``."""
        if len(self.logs) == self.of and self.of > 1:
            return "common"
        return "one-off" if len(self.logs) == 1 else "some"


@dataclass(frozen=True)
class Fleet:
    """What was done, what failed, and what the sensors have in common.

    Parameters
    ----------
    done, failed : tuple of Outcome
        In the order of the names of their logs.
    tested : int
        Numbers in which outliers were looked for.
    """

    done: tuple[Outcome, ...]
    failed: tuple[Outcome, ...]
    numbers: tuple[Shared, ...]
    tallies: tuple[Tally, ...]
    tested: int


def fleet_of(outcomes: Sequence[Outcome]) -> Fleet:
    """Put outcomes together; their order does not matter.

    Raises
    ------
    InputError
        No log could be used, or a channel has no unit that most logs agree on.
    """
    inspected = _agreed(_once(sorted(outcomes, key=lambda o: o.log)))
    done = tuple(o for o in inspected if o.data is not None)
    failed = tuple(o for o in inspected if o.data is None)
    if not done:
        raise InputError(f"none of {len(failed)} logs could be used; the first: {failed[0].complaint}")
    gathered: dict[ReadNumber, list[LogReading]] = defaultdict(list)
    found: dict[Found, list[str]] = defaultdict(list)
    for o in done:
        for number, reading in readings_of(o.log, o.data or {}):
            gathered[number].append(reading)
        for effect in effects_of(o.data or {}):
            found[effect].append(o.log)
    known = {n: [r for r in rs if n.lasting and r.known(n.positive)] for n, rs in gathered.items()}
    tested = sum(len(rs) >= TESTED for rs in known.values())
    return Fleet(
        done,
        failed,
        tuple(_shared(n, gathered[n], known[n], RATE / max(tested, 1)) for n in sorted(gathered)),
        tuple(
            Tally(f, tuple(logs), _having(done, f.channel))
            for f, logs in sorted(found.items(), key=lambda a: (a[0].channel, -len(a[1]), a[0].effect))
        ),
        tested,
    )


def _shared(
    number: ReadNumber, every: Sequence[LogReading], known: Sequence[LogReading], rate: float
) -> Shared:
    plain = Shared(number, every[0].unit, tuple(every), None)
    if not known:
        return plain
    y, s = _scaled(number, known)
    apart = tuple((known[a.index], a) for a in outliers(y, s, rate))
    inside = [k for k in range(y.size) if k not in {a.index for _, a in apart}]
    return replace(plain, population=population(y[inside], s[inside]), outliers=apart)


def _scaled(number: ReadNumber, known: Sequence[LogReading]) -> tuple[Array, Array]:
    """Estimates and their deviations on the scale on which they are normal."""
    rows = np.array([[r.value, r.lo, r.hi] for r in known])
    rows = np.log(rows) if number.positive else rows
    return rows[:, 0], np.array([deviation(row[1:]) for row in rows])


def _having(done: Sequence[Outcome], channel: str) -> int:
    """Logs that have a channel; an answer that does not list its channels has them all."""
    return sum(channel in (o.data or {}).get("channels", {channel: None}) for o in done)


def _once(outcomes: Sequence[Outcome]) -> list[Outcome]:
    """A log that is given twice under two names counts once."""
    first: dict[str, str] = {}
    for o in outcomes:
        if o.data is not None and o.sha256:
            first.setdefault(o.sha256, o.log)
    return [
        replace(o, data=None, error=f"the same file as {first[o.sha256]}")
        if first.get(o.sha256, o.log) != o.log
        else o
        for o in outcomes
    ]


def _agreed(outcomes: Sequence[Outcome]) -> list[Outcome]:
    """Without the logs in which a channel has another unit [SI] than in most."""
    units: dict[str, list[tuple[str, str]]] = defaultdict(list)
    for o in outcomes:
        for channel, c in (o.data or {}).get("channels", {}).items():
            units[channel].append((c["unit"], o.log))
    wrong = {}
    for channel, given in units.items():
        counts = Counter(unit for unit, _ in given).most_common(2)
        if len(counts) > 1 and 2 * counts[0][1] <= len(given):
            examples = "; ".join(f"{u} in {next(g for v, g in given if v == u)}" for u, _ in counts)
            raise InputError(
                f"channel {channel} is not of one kind: {examples}",
                remedy="Give the logs of one kind of sensor",
            )
        for unit, log in given:
            if unit != counts[0][0]:
                wrong[log] = f"channel {channel} is in {unit} here, in {counts[0][0]} in most logs"
    return [replace(o, data=None, error=wrong[o.log]) if o.log in wrong else o for o in outcomes]
