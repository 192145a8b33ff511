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

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from kfgen.effects import Effect, effect_named
from kfgen.errors import InputError
from kfgen.identify.bounds import seconds_for
from kfgen.identify.curve import CurveFit, fit_curve
from kfgen.identify.fit import Fit, Key, Problem, Record, is_linear, maximise
from kfgen.identify.interval import NORMAL, interval95, intervals95, linear_intervals, upper95
from kfgen.identify.whittle import log_likelihood

Array = NDArray[np.float64]

LADDER = ("rate_random_walk", "gauss_markov")


def threshold(added: int) -> float:
    """Of twice the log-likelihood gain, by the number of parameters added."""
    return 2.7 if added < 2 else 9.0 + 2.0 * (added - 2)


RESOLVED = 12
"""Ordinates that a slow term must dominate for its kind to be told."""


@dataclass(frozen=True)
class Limit:
    """What the record cannot show: a parameter below `upper95` [SI].

    `hours` of log would give it to 20 % if it were half of that, the middle of what is left open.
    """

    effect: Effect
    parameter: str
    upper95: float
    hours: float


@dataclass(frozen=True)
class Estimate:
    """What a method says of a record.

    Parameters
    ----------
    fit : Fit
        All terms that the record needs.
    unresolved : frozenset of int
        Indices of the terms of the fit whose kind the record cannot tell.
    intervals : dict
        95 % intervals [SI] by parameter.
    limits : tuple of Limit
        What the record cannot show.
    """

    fit: Fit
    unresolved: frozenset[int]
    intervals: dict[Key, tuple[float, float]]
    limits: tuple[Limit, ...]


def by_likelihood(record: Record, wanted: Sequence[str] | None) -> Estimate:
    """Maximum likelihood with profile intervals, along the ladder or for exactly the wanted effects."""
    if wanted:
        best, problem = _exactly(record, wanted)
        intervals = _open_intervals(problem, best)
        intervals |= {key: interval95(problem, best, key) for key in best.free if key not in intervals}
        return Estimate(best, frozenset(), intervals | linear_intervals(best), ())
    best, problem = _climb(record)
    return estimate(problem, best, intervals95(problem, best))


def by_curve(record: Record, wanted: Sequence[str] | None) -> Estimate:
    """The Allan curve fitted by weighted least squares, with intervals from its curvature."""
    names = list(wanted) if wanted else ["white_noise"]
    best, problem = _best_curve(record, names)
    left = [] if wanted else list(LADDER)
    while left:
        trials = [(name, *_best_curve(record, [*names, name])) for name in left]
        gains = [
            (best.misfit - fit.misfit) / threshold(fit.point.size - best.point.size) for _, fit, _ in trials
        ]
        k = int(np.argmax(gains))
        if gains[k] < 1.0:
            break
        name, best, problem = trials[k]
        names.append(name)
        left.remove(name)
    fit = Fit(best.effects, 0.0, log_likelihood(problem.data, best.effects), problem.free, best.point)
    spread = NORMAL * np.sqrt(np.diag(best.covariance))
    ends = zip(np.exp(best.point - spread).tolist(), np.exp(best.point + spread).tolist())
    intervals = dict(zip(problem.free, ends)) | linear_intervals(fit)
    return Estimate(fit, frozenset(), intervals, ()) if wanted else estimate(problem, fit, intervals)


METHODS: dict[str, Callable[[Record, Sequence[str] | None], Estimate]] = {
    "ml": by_likelihood,
    "allan": by_curve,
}
"""The methods by name."""


def estimate(problem: Problem, best: Fit, intervals: dict[Key, tuple[float, float]]) -> Estimate:
    """A fit with what the record cannot resolve, and the limits of what it does not show."""
    unresolved = _unresolved(problem, best)
    shown = {e.name for i, e in enumerate(best.effects) if i not in unresolved}
    limits = tuple(_limit(problem, best, name) for name in LADDER if name not in shown)
    return Estimate(best, unresolved, intervals, limits)


def _best_curve(record: Record, names: Sequence[str]) -> tuple[CurveFit, Problem]:
    choices = _combinations(record, names)
    first = Problem(record, choices[0])
    fits = [fit_curve(first.starting(c)) for c in choices]
    best = min(fits, key=lambda f: f.misfit)
    return best, first.starting(best.effects)


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
        if 2.0 * (best.value - without.value) < threshold(len(effect.estimated())):
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
    """The best fit among several starts of the same set of effects, the fitted Allan curve's among them."""
    first = Problem(record, choices[0])
    problems = [first.starting(c) for c in (*choices, fit_curve(first).effects)]
    fits = [maximise(p) for p in problems]
    best = int(np.argmax([f.value for f in fits]))
    return fits[best], problems[best]


def _exactly(record: Record, wanted: Sequence[str]) -> tuple[Fit, Problem]:
    twice = [name for name in wanted if wanted.count(name) > 1 and not effect_named(name).repeatable]
    if twice:
        raise InputError(f"{twice[0]} is wanted twice", where="--effects", remedy="Name it once")
    choices = _combinations(record, wanted)
    if all(
        e.form({e.driver: record.drive[e.driver]} if e.driver else None).deterministic for e in choices[0]
    ):
        raise InputError(
            f"{', '.join(wanted)} alone is no noise", where="--effects", remedy="Add white_noise"
        )
    return best_of(record, choices)


def _combinations(record: Record, names: Sequence[str]) -> list[tuple[Effect, ...]]:
    """Start values of several effects together, every one with every other."""
    choices: list[tuple[Effect, ...]] = [()]
    for name in names:
        choices = [(*c, e) for c in choices for e in starts(name, record)]
    return choices


def _climb(record: Record) -> tuple[Fit, Problem]:
    """White noise first; then whichever rung gains most over its threshold, until none does."""
    best, problem = _exactly(record, ["white_noise"])
    left = list(LADDER)
    while left:
        trials = [
            (name, *best_of(record, [(*best.effects, e) for e in starts(name, record)])) for name in left
        ]
        gains = [
            2.0 * (fit.value - best.value) / threshold(len(fit.free) - len(best.free)) for _, fit, _ in trials
        ]
        k = int(np.argmax(gains))
        if gains[k] < 1.0:
            break
        name, best, problem = trials[k]
        left.remove(name)
    return best, problem


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
    half = replace(worst.effect, **{size: 0.5 * worst.upper95})
    hours = seconds_for((*others, half), record.dt, (index, size)) / 3600.0
    return replace(worst, hours=hours)
