"""`pooled`: the answers of many logs put together, number by number."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from kfgen.core.errors import InputError
from kfgen.fleet.answer import SensorNumber
from kfgen.fleet.clock import clock_factors
from kfgen.fleet.population import (
    MIN_SENSORS_FOR_OUTLIER,
    outliers,
    population,
    standard_deviation,
)
from kfgen.fleet.result import (
    FALSE_ALARM_SHARE_OF_FLEETS,
    EffectCount,
    FleetResult,
    Outcome,
    PooledNumber,
    SensorEstimate,
)

Array = NDArray[np.float64]


def pooled(outcomes: Sequence[Outcome]) -> FleetResult:
    """Put outcomes together; their order does not matter.

    Raises
    ------
    InputError
        No log could be used, or a channel has no unit that most logs agree on.
    """
    inspected = _of_one_unit(_without_copies(sorted(outcomes, key=lambda o: o.log)))
    done = tuple(o for o in inspected if o.answer is not None)
    failed = tuple(o for o in inspected if o.answer is None)
    if not done:
        raise InputError(f"none of {len(failed)} logs could be used; the first: {failed[0].complaint}")
    gathered: dict[SensorNumber, list[SensorEstimate]] = defaultdict(list)
    units: dict[SensorNumber, str] = {}
    found: dict[tuple[str, str], list[str]] = defaultdict(list)
    for o in done:
        assert o.answer is not None
        for number, estimate in o.answer.numbers:
            gathered[number].append(SensorEstimate(o.log, estimate))
            units.setdefault(number, estimate.unit)
        for name in o.answer.names:
            found[name].append(o.log)
    closed = {n: [s for s in es if n.lasting and s.is_closed(n.positive)] for n, es in gathered.items()}
    tested = sum(len(es) >= MIN_SENSORS_FOR_OUTLIER for es in closed.values())
    rate = FALSE_ALARM_SHARE_OF_FLEETS / max(tested, 1)
    return FleetResult(
        done,
        failed,
        tuple(
            _pooled_number(PooledNumber(n, units[n], tuple(gathered[n]), None), closed[n], rate)
            for n in sorted(gathered)
        ),
        tuple(
            EffectCount(channel, effect, tuple(logs), _having(done, channel))
            for (channel, effect), logs in sorted(found.items(), key=lambda a: (a[0][0], -len(a[1]), a[0][1]))
        ),
        tested,
        clocks=clock_factors({o.log: o.answer for o in done if o.answer}),
    )


def _pooled_number(plain: PooledNumber, closed: Sequence[SensorEstimate], rate: float) -> PooledNumber:
    """A number with its population, from the estimates whose intervals are closed, and its outliers."""
    if not closed:
        return plain
    y, s = _on_normal_scale(plain.number, closed)
    outlying = tuple((closed[a.index], a) for a in outliers(y, s, rate))
    inside = [k for k in range(y.size) if k not in {a.index for _, a in outlying}]
    return replace(plain, population=population(y[inside], s[inside]), outliers=outlying)


def _on_normal_scale(number: SensorNumber, closed: Sequence[SensorEstimate]) -> tuple[Array, Array]:
    """Estimates and their standard deviations on the scale on which they are normal, shape (k,)."""
    rows = np.array([[s.estimate.value, s.estimate.lo, s.estimate.hi] for s in closed])
    rows = np.log(rows) if number.positive else rows
    return rows[:, 0], np.array([standard_deviation(row[1:]) for row in rows])


def _having(done: Sequence[Outcome], channel: str) -> int:
    """Logs that have a channel; an answer that does not list its channels has them all."""
    return sum(not o.answer.units or channel in o.answer.units for o in done if o.answer)


def _without_copies(outcomes: Sequence[Outcome]) -> list[Outcome]:
    """A log that is given twice under two names counts once."""
    first: dict[str, str] = {}
    for o in outcomes:
        if o.answer is not None and o.sha256:
            first.setdefault(o.sha256, o.log)
    return [
        replace(o, answer=None, error=f"the same file as {first[o.sha256]}")
        if first.get(o.sha256, o.log) != o.log
        else o
        for o in outcomes
    ]


def _of_one_unit(outcomes: Sequence[Outcome]) -> list[Outcome]:
    """Without the logs in which a channel has another unit [SI] than in most."""
    units: dict[str, list[tuple[str, str]]] = defaultdict(list)
    for o in outcomes:
        for channel, unit in (o.answer.units if o.answer else {}).items():
            units[channel].append((unit, o.log))
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
    return [replace(o, answer=None, error=wrong[o.log]) if o.log in wrong else o for o in outcomes]
