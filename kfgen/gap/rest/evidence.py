"""What is missing: candidates compared by their marginal likelihood.

A candidate is the assumed model with one more effect, all parameters fitted. Its evidence is the
likelihood integrated over them by Laplace's method in logarithms [1]_, over times and slopes that the record
hardly bounds numerically, over places (an onset, a frequency) by the scan that found them. Sizes and
times have log-uniform priors, the assumed model's numbers keep the priors that trust in them gives,
and a coefficient of a deterministic effect is log-uniform in its size, of either sign. ``retune``
competes openly: the same structure without the trust. Each addition costs the
logarithm of the number of candidates (and what its class says that it is rarer than others, ``prior_penalty_nats``).

References
----------
.. [1] D. J. C. MacKay, Information Theory, Inference, and Learning Algorithms, 2003, ch. 27-28.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from kfgen.effects import Effect, catalogue
from kfgen.effects.series import Detection, WhiteSeries, log_mean
from kfgen.gap.core.search import Label
from kfgen.gap.core.whitener import Whitener
from kfgen.gap.rest.trust import chance_of_gains
from kfgen.identify.evidence.joint import records_of
from kfgen.identify.evidence.record import Evidence
from kfgen.identify.fit.fit import Fit, Key, Prior, Problem, as_it_stands, curvature, maximise
from kfgen.identify.fit.laplace import log_evidence

Array = NDArray[np.float64]

RETUNE = "retune"
"""The name of the candidate that adds no effect and sets the assumed numbers free."""
TIME_LIMITS = {"gauss_markov": (0.1, 3.0), "warm_up": (1.0 / 3.0, 10.0)}
"""Longest time in the record, shortest in periods: beyond, one is a random walk or white, the other a ramp."""
GRID_POINTS = {"time": 9, "slope": 5}
"""Of the grid on which a number of this kind is integrated that the record hardly bounds."""
LAPLACE_MAX_SD_OF_LOG = 0.45
"""Standard deviation of a logarithm below which Laplace's method is good for such a number."""
FAR_BELOW_NATS = 12.0
"""Below the evidence of the best, whose integral a candidate of no more than that need not have."""
TOLERANCE_OF_TRIAL_NATS = 1e-2
"""Gain of log-likelihood below which the fit of a candidate ends that may be far below the best."""
TOLERANCE_OF_EVIDENCE_NATS = 1e-3
"""The same of one that is weighed."""
MAX_NATS_OF_FAINT = -2.0
"""Evidence of a shape over nothing below which it is too faint to move the noise that it is fitted with."""
MAX_LOSS_OF_PLACE_NATS = 20.0
"""Evidence against the best of several places beyond which the noise is not fitted anew."""
START_SIZE_FACTORS = (1.0, 0.3, 0.1, 0.03)
"""Of the start value's: sizes at which a candidate is tried before it is fitted."""
RETUNED_SD_OF_LOG = 0.7
"""Standard deviation of the logarithm of a number that is no longer trusted: a factor of two either way."""


@dataclass(frozen=True)
class Candidate:
    """A fitted candidate: the effect added ("" for none, "retune" for none but free), its evidence.

    Parameters
    ----------
    gain : float
        ln(evidence ratio to the model without it) - ln(number of candidates + 1) - what its class says that it is rarer [nats].
    detect : Detection, optional
        Where the effect was found, if it was looked for.
    choice_nats : float
        What choosing it cost, out of the catalogue and out of all places, once it was chosen.
    """

    name: str
    fit: Fit
    problem: Problem
    gain: float
    detect: Detection | None = None
    choice_nats: float = 0.0

    @property
    def label(self) -> Label:
        """The effect, in the one channel that there is."""
        return self.name, ""

    @property
    def effect(self) -> Effect:
        """What it adds."""
        return self.detect.effect if self.changes_samples and self.detect else self.fit.effects[-1]

    @property
    def changes_samples(self) -> bool:
        """Whether it changes the samples instead of adding a spectrum or a shape."""
        return self.detect is not None and self.detect.evidence is not None


def assumed(record: Evidence, effects: Sequence[Effect], priors: Mapping[Key, Prior]) -> Candidate:
    """The assumed model, its numbers moved only as far as trust lets them.

    Parameters
    ----------
    record : Evidence
    effects : sequence of Effect
    priors : mapping of Key to Prior
    """
    problem = Problem(record, tuple(effects), priors)
    return Candidate("", maximise(problem), problem, 0.0)


def series_of(base: Candidate) -> WhiteSeries:
    """The record as a white series, if the base is right; of several the first."""
    record, effects = records_of(base.problem.record)[0], base.fit.effects
    n, dt = record.n, record.dt
    whitener = Whitener.on(record, effects)
    fast = Whitener.on(record, [e for e in effects if not e.form().order or e.is_filter])
    with np.errstate(divide="ignore", invalid="ignore"):
        # The constant, which no density counts, is no noise.
        white = np.where(whitener.weight > 0.0, (whitener.weight / fast.weight) ** 2, 0.0)
    columns = [whitener.ordinates(x) for e in effects if e.coefficients() for x in record.regressors(e)]
    nuisance = np.linalg.qr(np.array(columns).T)[0] if columns else np.zeros((n, 0))
    y = record.y - record.drift(effects)
    slow = [e for e in effects if e.form().order and not e.coefficients()]
    return WhiteSeries(
        record.elapsed,
        y,
        dt,
        whitener.weight,
        1.0 - white,
        nuisance,
        _level(base, [e for e in effects if e.form().V]),
        record.drive,
        tuple(e.form() for e in slow),
        _level(base, slow),
        whitener.ends(effects, dt),
    )


def _level(base: Candidate, effects: Sequence[Effect]) -> tuple[float, float]:
    """Mean and standard deviation of what is assumed about the size of the first of some effects, over that of the fit."""
    for (i, name), x in zip(base.fit.free, base.fit.point.tolist()):
        prior = base.problem.priors.get((i, name))
        if base.fit.effects[i] in effects and name in base.fit.effects[i].sizes() and prior is not None:
            return prior.mean - x, prior.deviation
    return 0.0, RETUNED_SD_OF_LOG


def candidates(base: Candidate, without: frozenset[str] = frozenset()) -> list[Candidate]:
    """Every addition that the record allows, by evidence, the best first; those in `without` are left out.

    Parameters
    ----------
    base : Candidate
        The model without them, fitted.
    without : frozenset of str
        Names that are left out.
    """
    allowed = additions(base, series_of(base), without)
    cost = float(np.log(len(allowed) + 1))
    reference = log_evidence(base.problem, base.fit) + cost
    found: list[Candidate] = []
    for starts, most in sorted(((s, _at_most(s, base, cost)) for s in allowed), key=lambda m: -m[1].gain):
        best = max((c.gain for c in found), default=-np.inf)
        found.append(_valued(starts, most, best - FAR_BELOW_NATS, reference))
    found = [c for c in found if np.isfinite(c.gain)]
    if RETUNE not in without:
        found.append(_retuned(base, reference))
    return sorted(found, key=lambda c: -c.gain)


def additions(
    base: Candidate, series: WhiteSeries, without: frozenset[str] = frozenset()
) -> list[list[Detection]]:
    """The starts of every effect of the catalogue that could be added, apart those of another range of its numbers.

    Parameters
    ----------
    base : Candidate
        The model without them, fitted.
    series : WhiteSeries
        What it leaves.
    without : frozenset of str
        Names that are left out.
    """
    present = {e.name for e in base.fit.effects} | without
    look = base.problem.record.look
    shown = [
        [*(Detection(e) for e in cls.starts(look)), *cls.detect(series)]
        for name, cls in catalogue().items()
        if (cls.repeatable and name not in without) or name not in present
    ]
    new = [starts for starts in shown if starts and (starts[0].effect.repeatable or _new(starts, present))]
    return [part for starts in new for part in _by_range(starts)]


def _new(starts: Sequence[Detection], present: frozenset[str] | set[str]) -> bool:
    return starts[0].effect.name not in present


def _by_range(starts: Sequence[Detection]) -> list[list[Detection]]:
    """Apart where a number of theirs is looked for in another of its declared ranges."""
    parts: dict[tuple[tuple[float, float] | None, ...], list[Detection]] = {}
    for start in starts:
        ranges = tuple(start.effect.range_of(p.name) for p in start.effect.searched())
        parts.setdefault(ranges, []).append(start)
    return list(parts.values())


def _retuned(base: Candidate, reference: float) -> Candidate:
    """Other numbers of what is assumed: one of them wrong and the others trusted, or all wrong; each is as likely as an effect.

    A file that states no interval has a wrong number more often than its sensor has any one effect.
    """
    priors = base.problem.priors
    all_wrong = loosened(priors)
    one_wrong = [{**priors, key: all_wrong[key]} for key in priors] if len(priors) > 1 else []
    problems = [replace(base.problem, priors=p) for p in (all_wrong, *one_wrong)]
    fits = [maximise(p.starting(base.fit.effects)) for p in problems]
    values = np.array([log_evidence(p, f) for p, f in zip(problems, fits)])
    best = int(np.argmax(values))
    return Candidate(RETUNE, fits[best], problems[best], float(np.logaddexp.reduce(values)) - reference)


def loosened(priors: Mapping[Key, Prior]) -> dict[Key, Prior]:
    """Without trust."""
    return {key: replace(p, deviation=max(RETUNED_SD_OF_LOG, p.deviation)) for key, p in priors.items()}


def _at_most(starts: Sequence[Detection], base: Candidate, cost: float) -> Candidate:
    """The assumed model with one more effect, from the most promising of its starts: what its fit gains, which no
    integral over its numbers exceeds; or what was found to be its evidence.
    """
    name, known = starts[0].effect.name, base.fit.effects
    if starts[0].evidence is not None:
        return Candidate(name, base.fit, base.problem, starts[0].evidence - cost, starts[0])
    tried = [
        (_with(base, (*known, scaled)), s)
        for s in starts
        for scaled in (
            _scaled(s.effect, size) for size in (START_SIZE_FACTORS if s.effect.sizes() else (1.0,))
        )
    ]
    values = [p.objective(p.start()) for p, _ in tried]
    problem, detection = tried[int(np.argmin(values))]
    fit = maximise(problem, TOLERANCE_OF_TRIAL_NATS)
    return Candidate(name, fit, problem, fit.value - base.fit.value + detection.located - cost, detection)


def _valued(starts: Sequence[Detection], most: Candidate, least: float, reference: float) -> Candidate:
    """A candidate with its evidence; one that cannot have the least of it stays with what it can have at most."""
    rarer = starts[0].effect.rarer_by_nats()
    if most.changes_samples:
        return replace(most, gain=most.gain - rarer)
    c = most
    if most.gain - rarer > least:
        c = _over_places(starts, most, reference) if _has_places(starts) else _weighed(most, reference)
    return replace(c, gain=c.gain - rarer - chance_of_gains(c.problem.record, c.fit.effects))


def _has_places(starts: Sequence[Detection]) -> bool:
    return len(starts) > 1 and any(p.kind == "place" for p in starts[0].effect.parameters())


def _with(base: Candidate, effects: tuple[Effect, ...]) -> Problem:
    """The problem of the model with one more effect, the last one."""
    problem, name, at = base.problem, effects[-1].name, len(effects) - 1
    times = {**problem.times, **({at: TIME_LIMITS[name]} if name in TIME_LIMITS else {})}
    return Problem(problem.record, effects, problem.priors, problem.fixed, times)


def _weighed(most: Candidate, reference: float) -> Candidate:
    """A fitted candidate with its evidence."""
    problem, detection = most.problem, most.detect
    assert detection is not None
    fit = maximise(problem.starting(most.fit.effects), TOLERANCE_OF_EVIDENCE_NATS)
    at, H = len(fit.effects) - 1, curvature(problem, fit.point)
    value = log_evidence(problem, fit, H)
    wide = [key for key in fit.free if key[0] == at and _kind(problem, key) in GRID_POINTS]
    if wide and not _is_closed(problem, fit, wide[0], H):
        value, best = _integrated(problem, fit, wide[0])
        if best.value > fit.value:
            problem = problem.starting(best.effects)
            fit = maximise(problem, TOLERANCE_OF_EVIDENCE_NATS)
    if not fit.effects[-1].is_itself(problem.record.duration):
        value = -np.inf
    return Candidate(most.name, fit, problem, value + detection.located - reference, detection)


def _over_places(starts: Sequence[Detection], most: Candidate, reference: float) -> Candidate:
    """A shape held at each of several places, fitted at one of them: the best fit, and the evidence over all of them."""
    first, fit = most.problem, most.fit
    nearest = next(k for k, s in enumerate(starts) if s is most.detect)
    problems = [first.starting((*fit.effects[:-1], s.effect)) for s in starts]
    H = curvature(problems[nearest], fit.point)
    fits = [fit if k == nearest else as_it_stands(p) for k, p in enumerate(problems)]
    values = np.array([log_evidence(p, f, H) for p, f in zip(problems, fits)])
    if values[nearest] - reference > MAX_NATS_OF_FAINT:
        for k in np.flatnonzero(values > values.max() - MAX_LOSS_OF_PLACE_NATS):
            fits[k] = maximise(problems[k])
            values[k] = log_evidence(problems[k], fits[k])
    best = int(np.argmax(values))
    gain = log_mean(values) + starts[best].located - reference
    problem, fit, detection = problems[best], fits[best], starts[best]
    name = next(p.name for p in detection.effect.parameters() if p.kind == "place")
    found = _between(np.log([float(getattr(s.effect, name)) for s in starts]), values)
    if found:
        middle, deviation = found
        finer = first.starting(
            (*fit.effects[:-1], replace(detection.effect, **{name: float(np.exp(middle))}))
        )
        better, half = maximise(finer), 1.96 * deviation
        if better.value > fit.value:
            problem, fit = finer, better
        ci95 = {name: (float(np.exp(middle - half)), float(np.exp(middle + half)))}
        detection = replace(detection, effect=fit.effects[-1], ci95=ci95)
    return Candidate(detection.effect.name, fit, problem, gain, detection)


def _between(x: Array, values: Array) -> tuple[float, float] | None:
    """Where a parabola through the best of some places and its neighbours is highest, and its standard deviation."""
    k = int(np.argmax(values))
    if not 0 < k < x.size - 1:
        return None
    c2, c1, _ = np.polyfit(x[k - 1 : k + 2] - x[k], values[k - 1 : k + 2], 2)
    return float(x[k] - 0.5 * c1 / c2), float(np.sqrt(-0.5 / c2))


def _kind(problem: Problem, key: Key) -> str:
    return {p.name: p.kind for p in problem.effects[key[0]].parameters()}[key[1]]


def _is_closed(problem: Problem, fit: Fit, key: Key, H: Array) -> bool:
    """Whether the likelihood bounds a number well inside its box."""
    index = fit.free.index(key)
    lo, hi = problem.bounds[index]
    variance = float(np.linalg.pinv(H, hermitian=True)[index, index])
    x = float(fit.point[index])
    sd = float(np.sqrt(max(variance, 0.0)))
    return 0.0 < sd < LAPLACE_MAX_SD_OF_LOG and lo + 2.0 * sd < x < hi - 2.0 * sd


def _integrated(problem: Problem, fit: Fit, key: Key) -> tuple[float, Fit]:
    """The evidence integrated numerically over one number, the rest by Laplace's method; the best fit on the way."""
    lo, hi = problem.bounds[fit.free.index(key)]
    values, fits = [], []
    points = GRID_POINTS[_kind(problem, key)]
    for x in lo + (hi - lo) * (np.arange(points) + 0.5) / points:
        held = problem.starting(fit.effects).pin(key, float(np.exp(x)))
        fits.append(maximise(held, TOLERANCE_OF_EVIDENCE_NATS))
        values.append(log_evidence(held, fits[-1]))
    return log_mean(np.array(values)), max(fits, key=lambda f: f.value)


def _scaled(effect: Effect, scale: float) -> Effect:
    return replace(effect, **{name: scale * float(getattr(effect, name)) for name in effect.sizes()})
