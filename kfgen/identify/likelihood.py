"""Which effects a record shows: a ladder of models, climbed by calibrated likelihood ratios.

Each rung adds one effect. It stays when twice the gain of log-likelihood passes a threshold of
the null distribution at 5 %: 2.7 for one more size (a half chi-square: sizes are not negative)
and 9.0 for a Gauss-Markov term, whose correlation time is searched.

A slow term that dominates only a few of the lowest ordinates is a drift, but its kind cannot be
told: over so few half-periods a random walk, a Gauss-Markov process and a ramp look alike. Such
a term stays in the fit, so that the others are not biased, and is reported as unresolved. What is
not found or not resolved is reported with its upper limit and with the record that would show it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from kfgen.effects import Effect, effect_named
from kfgen.errors import InputError
from kfgen.identify.bounds import relative_bound, seconds_for
from kfgen.identify.clean import roll_off, without_outliers
from kfgen.identify.fit import Fit, Key, Problem, Record, is_linear, maximise
from kfgen.identify.interval import interval95, upper95
from kfgen.identify.lines import PeriodicLine, find_lines

Array = NDArray[np.float64]

MINIMUM = 64
"""Samples that a fit needs."""
BLOCKS = 1_000_000
"""A longer record is averaged to about this many blocks first."""
LADDER = ("rate_random_walk", "gauss_markov")
THRESHOLD = {1: 2.7, 2: 9.0}
"""Of twice the log-likelihood gain, by the number of parameters added."""


RESOLVED = 12
"""Ordinates that a slow term must dominate for its kind to be told."""


@dataclass(frozen=True)
class Limit:
    """What the record cannot show: a parameter below `upper95` [SI], and how long to log."""

    effect: Effect
    parameter: str
    upper95: float
    hours: float


@dataclass(frozen=True)
class Identified:
    """The answer for one channel.

    Parameters
    ----------
    fit : Fit
        All terms that the record needs.
    unresolved : frozenset of int
        Indices of the terms of the fit whose kind the record cannot tell.
    """

    fit: Fit
    unresolved: frozenset[int]
    intervals: dict[Key, tuple[float, float]]
    bounds: dict[Key, float]
    limits: tuple[Limit, ...]
    record: Record
    warnings: tuple[str, ...] = ()
    lines: tuple[PeriodicLine, ...] = ()


def identify(record: Record, wanted: Sequence[str] | None = None) -> Identified:
    """Identify one channel.

    Parameters
    ----------
    record : Record
        The samples; ``block`` is chosen here.
    wanted : sequence of str, optional
        Exactly these effects instead of a choice along the ladder.

    Raises
    ------
    InputError
        Too few samples, or a channel that never changes.
    """
    n = record.y.size
    if n < MINIMUM:
        raise InputError(f"{n} samples are too few for a fit", remedy=f"Log at least {MINIMUM}")
    if not np.ptp(record.y) > 0.0:
        raise InputError("the channel never changes", remedy="Check the sensor and the column")
    if not np.isfinite(n * float(np.abs(record.y).max()) * float(np.abs(record.y).max())):
        raise InputError("the values are too large to be squared", remedy="Check the unit and the column")
    record, share = without_outliers(replace(record, block=max(1, n // BLOCKS)))
    cut = roll_off(record)
    if cut is not None:
        record = replace(record, skip=((cut, float("inf")),))
    best, problem = _exactly(record, wanted) if wanted else _climb(record)
    lines = find_lines(record, best.effects) if cut is None else []
    if lines:
        record = replace(record, skip=record.skip + tuple(line.band for line in lines))
        best, problem = _exactly(record, wanted) if wanted else _climb(record)
    intervals = _open_intervals(problem, best) if wanted else {}
    intervals |= {key: interval95(problem, best, key) for key in best.free if key not in intervals}
    intervals |= _linear_intervals(best)
    bounds = relative_bound(best.effects, record.dt, n)
    unresolved = frozenset() if wanted else _unresolved(problem, best)
    shown = {e.name for i, e in enumerate(best.effects) if i not in unresolved}
    limits = () if wanted else tuple(_limit(problem, best, name) for name in LADDER if name not in shown)
    warnings = [_drift_warning(best, unresolved, record)] if unresolved else []
    warnings += [f"{100 * share:.2g} % of the samples are outliers, left out"] if share else []
    warnings += (
        [f"an internal low-pass takes power away above {cut:.3g} Hz, left out of the fit"] if cut else []
    )
    return Identified(best, unresolved, intervals, bounds, limits, record, tuple(warnings), tuple(lines))


def _open_intervals(problem: Problem, best: Fit) -> dict[Key, tuple[float, float]]:
    """One-sided intervals of a wanted term with a searched time that the record does not support.

    The search over its time lets the likelihood close on chance (its null gain passes 3.84 far more
    often than once in twenty), so that below the ladder's threshold only a limit holds.
    """
    found: dict[Key, tuple[float, float]] = {}
    for i, effect in enumerate(best.effects):
        times = [p.name for p in effect.estimated() if p.kind == "time"]
        others = tuple(e for k, e in enumerate(best.effects) if k != i)
        if not times or is_linear(effect) or not others:
            continue
        without = maximise(Problem(problem.record, others))
        if 2.0 * (best.value - without.value) < THRESHOLD[len(effect.estimated())]:
            limit = _limit(problem, best, effect.name)
            found[i, limit.parameter] = (0.0, limit.upper95)
            found |= {(i, name): (0.0, float("inf")) for name in times}
    return found


def _unresolved(problem: Problem, best: Fit) -> frozenset[int]:
    """The slow terms that dominate too few ordinates to be told from one another."""
    data = problem.data
    parts = [e.sampled_density(data.omega, data.dt, data.block) for e in best.effects]
    total = np.sum(parts, axis=0)
    return frozenset(
        i
        for i, e in enumerate(best.effects)
        if e.name in LADDER and float(data.count[parts[i] > 0.5 * total].sum()) < RESOLVED
    )


def _drift_warning(best: Fit, unresolved: frozenset[int], record: Record) -> str:
    names = " and ".join(best.effects[i].title for i in sorted(unresolved))
    return (
        f"there is a slow drift, fitted as {names}; {record.duration:.0f} s are too short to tell "
        "what it is: a random walk, a Gauss-Markov bias, warm-up or temperature"
    )


def starts(name: str, record: Record) -> list[Effect]:
    """Where fits of an effect to a record should start.

    Raises
    ------
    InputError
        A record at rest cannot show the effect, or the log lacks its driver.
    """
    cls = effect_named(name)
    found = cls.starts(record.look)
    if not found:
        missing = f"needs the channel '{cls.driver}'" if cls.driver else "cannot be seen on a record at rest"
        raise InputError(f"{name} {missing}", remedy="Leave it out, or give a log that has it")
    return list(found)


def best_of(record: Record, choices: Sequence[tuple[Effect, ...]]) -> tuple[Fit, Problem]:
    """The best fit among several starts of the same set of effects."""
    first = Problem(record, choices[0])
    problems = [first] + [first.starting(c) for c in choices[1:]]
    fits = [maximise(p) for p in problems]
    best = int(np.argmax([f.value for f in fits]))
    return fits[best], problems[best]


def _exactly(record: Record, wanted: Sequence[str]) -> tuple[Fit, Problem]:
    twice = [name for name in wanted if wanted.count(name) > 1 and not effect_named(name).repeatable]
    if twice:
        raise InputError(f"{twice[0]} is wanted twice", where="--effects", remedy="Name it once")
    choices: list[tuple[Effect, ...]] = [()]
    for name in wanted:
        choices = [(*c, e) for c in choices for e in starts(name, record)]
    if all(
        e.form({e.driver: record.drive[e.driver]} if e.driver else None).deterministic for e in choices[0]
    ):
        raise InputError(
            f"{', '.join(wanted)} alone is no noise", where="--effects", remedy="Add white_noise"
        )
    return best_of(record, choices)


def _climb(record: Record) -> tuple[Fit, Problem]:
    """White noise first; then whichever rung gains most over its threshold, until none does."""
    best, problem = _exactly(record, ["white_noise"])
    left = list(LADDER)
    while left:
        trials = [
            (name, *best_of(record, [(*best.effects, e) for e in starts(name, record)])) for name in left
        ]
        gains = [
            2.0 * (fit.value - best.value) / THRESHOLD[len(fit.free) - len(best.free)] for _, fit, _ in trials
        ]
        k = int(np.argmax(gains))
        if gains[k] < 1.0:
            break
        name, best, problem = trials[k]
        left.remove(name)
    return best, problem


def _linear_intervals(fit: Fit) -> dict[Key, tuple[float, float]]:
    spread = (
        1.959963984540054 * np.sqrt(np.maximum(np.diag(fit.likelihood.covariance), 0.0))
        if fit.likelihood.coefficients.size
        else np.zeros(0)
    )
    keys = [(i, e.estimated()[0].name) for i, e in enumerate(fit.effects) if is_linear(e)]
    return {key: (float(c - s), float(c + s)) for key, c, s in zip(keys, fit.likelihood.coefficients, spread)}


def _limit(problem: Problem, best: Fit, name: str) -> Limit:
    """The upper limit of an effect beside the others, at its worst correlation time.

    The others are fitted anew for every size that is tried, so that an unresolved drift may turn out
    to be all of the effect asked for.
    """
    others = tuple(e for e in best.effects if e.name != name)
    record, index = problem.record, len(others)
    shown = starts(name, record)
    size = shown[0].estimated()[0].name
    worst: Limit | None = None
    for start in shown[1:] or shown:
        fixed = frozenset((index, p.name) for p in start.estimated()[1:])
        trial = Problem(record, (*others, start), fixed=fixed)
        trial.__dict__["data"] = problem.data
        small = replace(start, **{size: 1e-3 * float(getattr(start, size))})
        fits = [maximise(t) for t in (trial, trial.starting((*others, small)))]
        fit = max(fits, key=lambda f: f.value)
        top = upper95(trial, fit, (index, size))
        if worst is None or top > worst.upper95:
            worst = Limit(replace(fit.effects[index], **{size: top}), size, top, 0.0)
    assert worst is not None
    hours = seconds_for((*others, worst.effect), record.dt, (index, size)) / 3600.0
    return replace(worst, hours=hours)
