"""The methods of identification behind one interface: evidence in, an `Estimate` out.

A slow term that dominates only a few of the lowest ordinates is a drift, but its kind cannot be
distinguished: over so few half-periods a random walk, a Gauss-Markov process and a ramp look alike. Such
a term stays in the fit, so that the others are not biased, and is reported as unresolved. What is
not found or not resolved is reported with its upper limit and with the record that would show it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from kfgen.core.errors import InputError
from kfgen.effects import Effect, effect_named
from kfgen.identify import words
from kfgen.identify.evidence.kalman import Exact
from kfgen.identify.evidence.peaks import spectral_peaks
from kfgen.identify.evidence.record import Evidence
from kfgen.identify.evidence.whittle import SpectralFit
from kfgen.identify.fit.bounds import nominal
from kfgen.identify.fit.choice import (
    GAIN_OF_A_SEARCHED_TIME,
    GAIN_OF_A_SIZE,
    EffectSet,
    choose,
    combined,
    fast_effects,
    slow_effects,
)
from kfgen.identify.fit.detected import is_started, with_detected
from kfgen.identify.fit.estimate import Estimate
from kfgen.identify.fit.fit import Fit, Key, Problem, inverse, maximise
from kfgen.identify.fit.interval import NORMAL_975, interval95, intervals95, linear_intervals
from kfgen.identify.fit.limits import limit
from kfgen.identify.methods.allan_curve import (
    WALK,
    Weighting,
    by_degrees_of_freedom,
    by_wavelet_covariance,
    fit_curve,
    misfit_of_ramp,
)
from kfgen.identify.methods.arma import by_arma
from kfgen.identify.methods.asymptotes import by_asymptotes
from kfgen.identify.methods.ekf import by_ekf
from kfgen.identify.methods.em import by_em

Array = NDArray[np.float64]

MIN_ORDINATES_DOMINATED = 12
"""Ordinates that a slow term must dominate for its kind to be identified."""


def by_likelihood(record: Evidence, wanted: Sequence[str] | None) -> Estimate:
    """Maximum likelihood with profile intervals, for the best set of effects or exactly the wanted ones.

    Parameters
    ----------
    record : Evidence
        What is identified.
    wanted : sequence of str or None
        Exactly these effects; chosen by the data when None.
    """
    if isinstance(record, Exact):
        return _by_exact_likelihood(record, wanted)
    if wanted:
        best, problem, searched = _exactly(record, wanted)
        intervals = _open_intervals(problem, best) | searched
        intervals |= {key: interval95(problem, best, key) for key in best.free if key not in intervals}
        return Estimate(best, frozenset(), intervals | linear_intervals(best), (), covariance(problem, best))
    found = choose(record, best_of)
    best, problem = found.fit, found.problem
    return _estimate(problem, best, intervals95(problem, best), covariance(problem, best))


def _by_exact_likelihood(record: Exact, wanted: Sequence[str] | None) -> Estimate:
    """The terms are chosen on the even pieces of a record with gaps, and fitted to all of it."""
    if wanted:
        found = by_likelihood(record.view, wanted)
    else:
        chosen = choose(record.view, best_of)
        found = _estimate(chosen.problem, chosen.fit, {}, np.zeros((0, 0)))
    problem = Problem(record, found.fit.effects)
    fit = maximise(problem)
    open_ended = {key: ends for key, ends in found.intervals.items() if not np.isfinite(ends[1])}
    intervals = intervals95(problem, fit) | open_ended
    return replace(found, fit=fit, intervals=intervals, covariance=covariance(problem, fit))


def by_curve(
    record: Evidence, wanted: Sequence[str] | None, weighting: Weighting = by_degrees_of_freedom
) -> Estimate:
    """The Allan curve fitted by weighted least squares, with intervals from its curvature.

    Parameters
    ----------
    record : Evidence
        What is identified.
    wanted : sequence of str or None
        Exactly these effects; chosen by the data when None.
    weighting : callable
        Weights of the points of the curve under effects.
    """

    def fitted(evidence: Evidence, choices: Sequence[tuple[Effect, ...]]) -> EffectSet:
        problem = Problem(evidence, choices[0])
        curves = [fit_curve(problem.starting(c), weighting) for c in choices]
        best = min(curves, key=lambda c: c.misfit)
        none = SpectralFit(-0.5 * best.misfit, np.zeros(0), np.zeros((0, 0)))
        fit = Fit(best.effects, none.value, none, problem.free, best.point)
        covariances[fit.effects] = best.covariance
        worst[fit.effects] = best.chance
        return EffectSet(fit, problem.starting(best.effects), -best.misfit)

    covariances: dict[tuple[Effect, ...], Array] = {}
    worst: dict[tuple[Effect, ...], float] = {}
    if wanted:
        _check_wanted(record, wanted, wanted)
        found = fitted(record, combined(record, wanted))
    else:
        found = choose(record, fitted, drifting=False)
    fit, C = found.fit, covariances[found.fit.effects]
    spread = NORMAL_975 * np.sqrt(np.maximum(np.diag(C), 0.0))
    ends = zip(np.exp(fit.point - spread).tolist(), np.exp(np.minimum(fit.point + spread, 700.0)).tolist())
    intervals = dict(zip(fit.free, ends))
    warnings = _misfit(worst[fit.effects])
    if wanted:
        return Estimate(fit, frozenset(), intervals, (), C, warnings)
    ramps = _may_be_ramps(found, weighting)
    said = (words.MAY_BE_A_RAMP,) if ramps else ()
    return Estimate(fit, _unresolved(record, fit) | ramps, intervals, (), C, (*said, *warnings))


def _may_be_ramps(found: EffectSet, weighting: Weighting) -> frozenset[int]:
    """A random walk that gains less over a ramp in its place than one more size must."""
    effects = found.fit.effects
    walks = frozenset(i for i, e in enumerate(effects) if e.name == WALK)
    if not walks or misfit_of_ramp(found.problem, effects, weighting) > GAIN_OF_A_SIZE - found.gain:
        return frozenset()
    return walks


def by_wavelets(record: Evidence, wanted: Sequence[str] | None) -> Estimate:
    """Generalised method of wavelet moments: Haar variances with their covariance under the model.

    Parameters
    ----------
    record : Evidence
        What is identified.
    wanted : sequence of str or None
        Exactly these effects; chosen by the data when None.
    """
    return by_curve(record, wanted, by_wavelet_covariance)


METHODS: dict[str, Callable[[Evidence, Sequence[str] | None], Estimate]] = {
    "ml": by_likelihood,
    "kalman": by_likelihood,
    "allan": by_curve,
    "gmwm": by_wavelets,
    "asymptotes": by_asymptotes,
    "arma": by_arma,
    "ekf": by_ekf,
    "em": by_em,
}
"""The methods by name."""


def _misfit(chance: float) -> tuple[str, ...]:
    if chance > 1e-3:
        return ()
    return (
        "the terms do not explain the curve (chance below 0.001): something else acts, or it was smoothed",
    )


def covariance(problem: Problem, best: Fit) -> Array:
    """Asymptotic covariance of the logarithms of the fitted parameters, shape (k, k).

    Parameters
    ----------
    problem : Problem
        What is fitted.
    best : Fit
        Its maximum.
    """
    return inverse(problem.information(best.point))


def _estimate(problem: Problem, best: Fit, intervals: dict[Key, tuple[float, float]], C: Array) -> Estimate:
    """A fit with what the record cannot resolve, and the limits of what it does not show."""
    record = problem.record
    unresolved = _unresolved(record, best)
    shown = {e.name for i, e in enumerate(best.effects) if i not in unresolved}
    asked = [n for n in (*slow_effects(record), *fast_effects(record)) if n not in shown and _limited(n)]
    limits = [limit(record, tuple(e for e in best.effects if e.name != n), n) for n in asked]
    return Estimate(best, unresolved, intervals, tuple(limits), C)


def _limited(name: str) -> bool:
    """Effects with a band of their own are left out: a Gauss-Markov term's limit says as much."""
    return not any(p.kind == "setting" for p in effect_named(name).parameters())


def _open_intervals(problem: Problem, best: Fit) -> dict[Key, tuple[float, float]]:
    """One-sided intervals of a wanted term with a searched time that the record does not support.

    The search over its time lets the likelihood close on chance (its null gain passes 3.84 far more
    often than once in twenty), so that below its threshold only a limit holds.
    """
    found: dict[Key, tuple[float, float]] = {}
    record = problem.record
    for i, effect in enumerate(best.effects):
        times = [p.name for p in effect.searched() if p.kind == "time"]
        others = tuple(e for k, e in enumerate(best.effects) if k != i)
        if not times or effect.coefficients() or not others or not is_started(effect.name, record):
            continue
        without = maximise(Problem(record, others))
        if 2.0 * (best.value - without.value) < GAIN_OF_A_SEARCHED_TIME:
            most = limit(record, others, effect.name)
            found[i, most.parameter] = (0.0, most.upper95)
            found |= {(i, name): (0.0, float("inf")) for name in times}
    return found


def _unresolved(record: Evidence, best: Fit) -> frozenset[int]:
    """The slow terms that dominate too few ordinates to be distinguished from one another."""
    omega, count = nominal(record.lengths, record.dt, record.skip, spectral_peaks(best.effects))
    parts = [e.sampled_density(omega, record.dt, 1) for e in best.effects]
    total = np.sum(parts, axis=0)
    return frozenset(
        i
        for i, e in enumerate(best.effects)
        if not e.coefficients()
        and e.form().order
        and float(count[parts[i] > 0.5 * total].sum()) < MIN_ORDINATES_DOMINATED
    )


def best_of(record: Evidence, choices: Sequence[tuple[Effect, ...]]) -> EffectSet:
    """The best fit among several starts of the same set of effects.

    Parameters
    ----------
    record : Evidence
        What is identified.
    choices : sequence of tuple of Effect
        Start values of the same effects.
    """
    first = Problem(record, choices[0])
    problems = [first.starting(c) for c in choices]
    fits = [maximise(p) for p in problems]
    best = int(np.argmax([f.value for f in fits]))
    return EffectSet(fits[best], problems[best], 2.0 * fits[best].value)


def _exactly(record: Evidence, wanted: Sequence[str]) -> tuple[Fit, Problem, dict[Key, tuple[float, float]]]:
    """The wanted effects fitted, and the intervals of what was looked for before the fit."""
    started = [name for name in wanted if is_started(name, record)]
    _check_wanted(record, wanted, started)
    found, searched = best_of(record, combined(record, started)), dict[Key, tuple[float, float]]()
    for name in (n for n in wanted if n not in started):
        at = len(found.fit.effects)
        more = with_detected(record, found.fit.effects, name, best_of)
        found = more.found
        searched |= {(at, parameter): ci for parameter, ci in more.ci95.items()}
    return found.fit, found.problem, searched


def _check_wanted(record: Evidence, wanted: Sequence[str], started: Sequence[str]) -> None:
    """No effect twice that is one of its kind, and noise among those that have start values."""
    twice = [name for name in wanted if wanted.count(name) > 1 and not effect_named(name).repeatable]
    if twice:
        raise InputError(f"{twice[0]} is wanted twice", where="--effects", remedy="Name it once")
    if all(e.coefficients() for e in combined(record, started)[0]):
        raise InputError(
            f"{', '.join(wanted)} alone is no noise", where="--effects", remedy="Add white_noise"
        )
