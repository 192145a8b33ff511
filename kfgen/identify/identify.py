"""Identification of one channel: checked, cleaned, its lines removed, then a method's estimate."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import singledispatch

import numpy as np
from numpy.typing import NDArray

from kfgen.core.errors import InputError
from kfgen.effects import Effect, effect_named
from kfgen.effects.process.sensor_response import SensorResponse
from kfgen.identify import words
from kfgen.identify.evidence.joint import JointRecord
from kfgen.identify.evidence.kalman import Exact
from kfgen.identify.evidence.long import Long, Stream, condense
from kfgen.identify.evidence.peaks import oscillations
from kfgen.identify.evidence.published import Published
from kfgen.identify.evidence.record import Evidence, Record
from kfgen.identify.evidence.sampling import drawn
from kfgen.identify.fit import lines as periodic
from kfgen.identify.fit.bounds import relative_bound
from kfgen.identify.fit.fit import Fit, Key
from kfgen.identify.fit.goodness import widening
from kfgen.identify.fit.interval import stretched
from kfgen.identify.fit.limits import Limit
from kfgen.identify.fit.lines import PeriodicLine, find_lines, is_of, with_harmonics, without_line
from kfgen.identify.fit.response import response_beyond
from kfgen.identify.methods.likelihood import METHODS
from kfgen.identify.screening.cleaning import cleaned, outliers_said
from kfgen.identify.screening.record_faults import (
    amplitude_faults,
    is_outlier,
    noise_change,
    roll_off,
    stuck_in,
)
from kfgen.identify.screening.shocks import bridged, shocks, shocks_said

Array = NDArray[np.float64]

MIN_SAMPLES = 64
"""Samples that a fit needs."""
MAX_NOISE_RATIO_OF_LOGS = 1.1
"""Ratio of the noise of two logs beyond which they are not of one sensor in one state."""
MAX_FREQUENCY_OVER_RATE_OF_DRAWN = 0.1
"""Of the sampling rate: beyond that frequency a record drawn between uneven samples is smooth."""
MIN_WIDENING_SAID = 1.2
"""Factor on an interval that is said."""
MAX_SAMPLES_IN_FULL = 2_000_000
"""A longer record is condensed first."""


@dataclass(frozen=True)
class Identified:
    """The answer for one channel.

    Parameters
    ----------
    fit, unresolved, intervals, limits, covariance
        The method's estimate, see `kfgen.identify.methods.likelihood.Estimate`.
    bounds : dict
        Cramér-Rao bound of each parameter, as a relative standard deviation.
    record : Evidence
        What was fitted: without outliers, with the bands that were left out.
    warnings : tuple of str
    lines : tuple of PeriodicLine
    response : SensorResponse, optional
        The gain above the frequency from which on an internal low-pass takes power away.
    """

    fit: Fit
    unresolved: frozenset[int]
    intervals: dict[Key, tuple[float, float]]
    limits: tuple[Limit, ...]
    bounds: dict[Key, float]
    record: Evidence
    covariance: Array
    warnings: tuple[str, ...] = ()
    lines: tuple[PeriodicLine, ...] = ()
    response: SensorResponse | None = None


def identify(record: Evidence, wanted: Sequence[str] | None = None, method: str = "ml") -> Identified:
    """Identify one channel.

    Parameters
    ----------
    record : Evidence
        The samples (``block`` and ``skip`` are chosen here), several records of one sensor, samples with
        gaps (`kfgen.identify.evidence.sampling.evidence`), or a published curve.
    wanted : sequence of str, optional
        Exactly these effects instead of a choice along the ladder.
    method : str
        A key of `METHODS`.

    Raises
    ------
    InputError
        An unknown method, too few samples, or a channel that never changes.
    """
    if method not in METHODS:
        raise InputError(
            f"there is no method '{method}'", where="--method", remedy=f"Known are {', '.join(METHODS)}"
        )
    clean, warnings = prepared(exactly(record) if method == "kalman" else record)
    # A slow term that is fitted first takes the power of a line for its own; only one that is asked for may.
    own = may_oscillate(clean, wanted or ())
    lines = [] if own else lines_in(clean)
    clean = without_lines(clean, lines)
    found = METHODS[method](clean, wanted)
    if own:
        lines = lines_in(clean, found.fit.effects)
    if own and lines:
        clean = without_lines(clean, lines)
        found = METHODS[method](clean, wanted)
    bounds = {}
    if not isinstance(clean, Published):  # who knows how a curve was made
        bounds = relative_bound(found.fit.effects, clean.dt, *clean.lengths, skip=clean.skip)
    drift = [_drift_warning(found.fit, found.unresolved, clean)] if found.unresolved else []
    factors = widening(clean, found.fit) if method in ("ml", "kalman") else {}
    scale = np.array([factors.get(key, 1.0) for key in found.fit.free])
    intervals = {
        key: stretched(ci, _value(found.fit, key), factors.get(key, 1.0))
        for key, ci in found.intervals.items()
    }
    return Identified(
        found.fit,
        found.unresolved,
        intervals,
        found.limits,
        bounds,
        clean,
        found.covariance * np.outer(scale, scale),
        (*drift, *warnings, *found.warnings, *_misfit(factors)),
        tuple(lines),
        _response(clean, found.fit.effects),
    )


def _response(record: Evidence, effects: Sequence[Effect]) -> SensorResponse | None:
    """Beyond the frequency from which on nothing was fitted, where the records reach beyond it."""
    if isinstance(record, Exact) and record.drawn:
        return None
    records = [r for r in records_within(record) if r.block * r.averaged == 1]
    cuts = [lo for r in records for lo, hi in r.skip if hi == float("inf")]
    return response_beyond(min(cuts), records, effects) if cuts and len(cuts) == len(records) else None


def exactly(record: Evidence) -> Evidence:
    """A record with the exact likelihood in place of Whittle's.

    Raises
    ------
    InputError
        Several records, a condensed one, or a curve.
    """
    if isinstance(record, Exact):
        return record
    if not isinstance(record, Record):
        raise InputError(
            "the exact likelihood takes one log in memory",
            where="--method kalman",
            remedy="Use --method ml for several logs, --method allan for a curve",
        )
    return Exact(record.t, record.y, record.drive, record.dt, record)


@singledispatch
def prepared(record: Evidence) -> tuple[Evidence, list[str]]:
    """The evidence checked and cleaned, and what was found."""
    raise InputError(f"a {type(record).__name__} cannot be identified")


@prepared.register
def _(record: Record) -> tuple[Evidence, list[str]]:
    _check(record.y)
    if record.n > MAX_SAMPLES_IN_FULL:
        return prepared(condense(Stream.of(record.y, record.dt)))
    record, warnings = cleaned(record)
    warnings += [*amplitude_faults(record.y), *stuck_in(record)]
    change = noise_change(record.y)
    if change is not None:
        warnings.append(words.noise_changes(change[1] / change[0]))
    cut = roll_off(record)
    if cut is None:
        return record, warnings
    return record.leaving_out((cut, float("inf"))), [*warnings, words.low_pass(cut)]


@prepared.register
def _(record: JointRecord) -> tuple[Evidence, list[str]]:
    block = max(1, *(r.n // MAX_SAMPLES_IN_FULL for r in record.records))
    blocks = [replace(r, block=block) for r in record.records]
    checked = [prepared(r) for r in blocks]
    records = tuple(r for r, _ in checked if isinstance(r, Record))
    said = list(dict.fromkeys(w for _, warnings in checked for w in warnings))
    ratio = _noise_ratio(records)
    if ratio > MAX_NOISE_RATIO_OF_LOGS:
        said.append(words.logs_differ(ratio))
    return JointRecord(records), said


def _noise_ratio(records: Sequence[Record]) -> float:
    """By how much the fastest noise of records differs."""
    levels = [float(r.octaves.deviation[0]) for r in records]
    return max(levels) / min(levels)


@prepared.register
def _(record: Long) -> tuple[Evidence, list[str]]:
    _check(record.head.y)
    warnings = [words.outlier_share(record.lost / record.samples)] if record.lost else []
    cut = roll_off(record.head)
    if cut is None:
        return record, warnings
    return record.leaving_out((cut, float("inf"))), [*warnings, words.low_pass(cut)]


@prepared.register
def _(record: Exact) -> tuple[Evidence, list[str]]:
    _check(record.y)
    spans = shocks(record.y)
    shaken = np.zeros(record.y.size, dtype=bool)
    for a, b in spans:
        shaken[a:b] = True
    bad = is_outlier(bridged(record.y, spans)) & ~shaken
    good = ~(bad | shaken)
    drive = {k: v[good] for k, v in record.drive.items()}
    clean = replace(record, t=record.t[good], y=record.y[good], drive=drive)
    said = shocks_said(record.t, spans) + outliers_said(record.t, bad)
    if record.drawn:
        even = drawn(clean.t, clean.y, clean.drive, record.view.dt)
        too_fast = (MAX_FREQUENCY_OVER_RATE_OF_DRAWN / record.period, float("inf"))
        return replace(clean, view=even.leaving_out(too_fast)), said
    view, _ = prepared(record.view)
    cuts = [lo for r in records_within(view) for lo, hi in r.skip if hi == float("inf")]
    if not cuts:
        return replace(clean, view=view), said
    return replace(clean, view=view, shortest=1.0 / min(cuts)), [*said, words.low_pass(min(cuts))]


@prepared.register
def _(record: Published) -> tuple[Evidence, list[str]]:
    clean, cut = record.falling()
    return clean, [words.curve_rises(cut)] if cut else []


def records_within(view: Evidence) -> tuple[Record, ...]:
    """The even records that evidence has, none of a curve.

    Parameters
    ----------
    view : Evidence
        What is identified.
    """
    if isinstance(view, Exact):
        return records_within(view.view)
    if isinstance(view, Record):
        return (view,)
    if isinstance(view, Long):
        return (view.head, view.slow)
    return view.records if isinstance(view, JointRecord) else ()


def may_oscillate(record: Evidence, wanted: Sequence[str]) -> bool:
    """Whether an effect is asked for whose own a line may be.

    Parameters
    ----------
    record : Evidence
        What is identified.
    wanted : sequence of str
        Names of effects; one without start values is looked for, and may be a line.
    """
    starts = [effect_named(name).starts(record.look) for name in wanted]
    return any(not found or any(oscillations(e) for e in found) for found in starts)


def lines_in(record: Evidence, effects: Sequence[Effect] = ()) -> list[PeriodicLine]:
    """The periodic lines of evidence that belong to none of the effects, each once.

    Parameters
    ----------
    record : Evidence
        What is identified.
    effects : sequence of Effect
        Fitted to it.
    """
    records = records_within(record)
    if isinstance(record, JointRecord) and _noise_ratio(records) > MAX_NOISE_RATIO_OF_LOGS:
        return []  # beside another's noise a louder log is full of lines
    found: list[PeriodicLine] = []
    for part in records:
        new = [line for line in find_lines(part) if not is_of(line, effects)]
        found += [a for a in new if not any(b.band[0] <= a.frequency <= b.band[1] for b in found)]
    return with_harmonics(found)


@singledispatch
def without_lines(record: Evidence, lines: Sequence[PeriodicLine]) -> Evidence:
    """The evidence with the lines removed.

    Parameters
    ----------
    record : Evidence
        What is identified.
    lines : sequence of PeriodicLine
        That are left out of the likelihood, or subtracted.
    """
    return record


@without_lines.register
def _(record: Record, lines: Sequence[PeriodicLine]) -> Evidence:
    return periodic.without_lines(record, lines)


@without_lines.register
def _(record: Long, lines: Sequence[PeriodicLine]) -> Evidence:
    return record.leaving_out(*(line.band for line in lines))


@without_lines.register
def _(record: JointRecord, lines: Sequence[PeriodicLine]) -> Evidence:
    return JointRecord(tuple(periodic.without_lines(r, lines) for r in record.records))


@without_lines.register
def _(record: Exact, lines: Sequence[PeriodicLine]) -> Evidence:
    y = record.y
    for line in lines:
        y = without_line(record.t, y, line)
    return replace(record, y=y, view=without_lines(record.view, lines))


def _value(fit: Fit, key: Key) -> float:
    return float(getattr(fit.effects[key[0]], key[1]))


def _misfit(factors: Mapping[Key, float]) -> list[str]:
    """A sentence on a spectrum that the terms do not explain."""
    worst = max(factors.values(), default=1.0)
    return [words.spectrum_differs(worst)] if worst >= MIN_WIDENING_SAID else []


def _check(y: Array) -> None:
    n, largest = y.size, float(np.abs(y).max(initial=0.0))
    if n < MIN_SAMPLES:
        raise InputError(f"{n} samples are too few for a fit", remedy=f"Log at least {MIN_SAMPLES}")
    if not np.ptp(y) > 0.0:
        raise InputError("the channel never changes", remedy="Check the sensor and the column")
    if not np.isfinite(n * largest * largest):
        raise InputError("the values are too large to be squared", remedy="Check the unit and the column")


def _drift_warning(best: Fit, unresolved: frozenset[int], record: Evidence) -> str:
    return words.drift([best.effects[i].title for i in sorted(unresolved)], record.longest)
