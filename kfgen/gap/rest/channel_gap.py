"""One channel at rest: compare, name what is missing, add, prove, again, until nothing significant is left."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import cast

import numpy as np
from numpy.typing import NDArray

from kfgen.effects import Effect, catalogue
from kfgen.effects.noise_model import ChannelNoise, Term
from kfgen.effects.process.stochastic import Quantisation
from kfgen.effects.series import DetectedFault
from kfgen.gap.core.battery import Test, battery
from kfgen.gap.core.result import (
    EFFECTS_FOUND,
    NO_GAP,
    UNKNOWN_EFFECT,
    Checks,
    DetectionLimit,
    Finding,
    beside_misfit,
)
from kfgen.gap.core.search import NO_EFFECT, Chosen, refused_of, searched
from kfgen.gap.core.thresholds import DETECTION_LIMIT_NATS
from kfgen.gap.rest.checks import checks_of, without_losses
from kfgen.gap.rest.comparison import ChannelGap, span_of
from kfgen.gap.rest.course import own_noise_objection, with_objections
from kfgen.gap.rest.evidence import RETUNE, Candidate, additions, series_of
from kfgen.gap.rest.explanation import ChannelExplanation, search_limits
from kfgen.gap.rest.faults import fault_finding, spoilt, spotted_in
from kfgen.gap.rest.intervals import closed_intervals
from kfgen.gap.rest.second_recording import lasts
from kfgen.gap.rest.trust import check, is_among_gains, merged, moved, priors_of, without_assumed_terms
from kfgen.identify.evidence.joint import records_of
from kfgen.identify.evidence.record import Evidence, Record
from kfgen.identify.fit.fit import Problem, maximise
from kfgen.identify.identify import MAX_SAMPLES_IN_FULL

Array = NDArray[np.float64]

BINS_PER_DECADE = 200
"""Of the transform: a resonance may be narrow."""


@dataclass(frozen=True)
class Prepared:
    """A record made ready.

    Parameters
    ----------
    whole, raw : Record
        As it is, and less what assumed shapes and changes of samples give it.
    trusted, altering : tuple of Term
        These.
    random : ChannelNoise
        The other terms.
    search : Search
        To begin with.
    """

    whole: Record
    raw: Record
    trusted: tuple[Term, ...]
    altering: tuple[Term, ...]
    random: ChannelNoise
    search: ChannelExplanation

    def updated(self, noise: ChannelNoise, terms: tuple[Term, ...], *, changed: bool) -> ChannelNoise:
        """The assumed noise with other terms beside those that alter the record; its covariance where nothing changed."""
        every = (*merged(self.trusted, terms), *self.altering)
        return replace(noise, terms=every, covariance=None if changed else noise.covariance)


def channel_gap(
    channel: str,
    record: Record,
    noise: ChannelNoise,
    stamps: Array | None = None,
    stated: float = 0.0,
    channels: int = 1,
) -> ChannelGap:
    """Compare one channel at rest with the noise that is assumed about it.

    Parameters
    ----------
    channel : str
    record : Record
        Even in time, with the drivers that may explain it [SI].
    noise : ChannelNoise
    stamps : ndarray, optional
        The time stamps as they were logged [s], where the record's are not.
    stated : float
        How long the log's header says that it lasted [s]; zero where it does not.
    channels : int
        That are compared in this log.

    Returns
    -------
    ChannelGap

    Raises
    ------
    InputError
        The record is too short, or the model has no effect.
    """
    check(channel, record, noise)
    noise = noise.in_record(record.dt, record.duration)
    faults = _faults_beside(record, noise) + spotted_in(record, noise, stamps, stated)
    if any(f.spoils for f in faults):
        return spoilt(channel, record, noise, faults)
    at = prepared(record, noise)
    raw, random = at.raw, at.random
    search, gap = without_losses(searched(at.search, search_limits(channels)), raw, random.effects)
    before = tests_of(channel, as_written(raw, random.effects))
    base = search.base
    clean, after = cast(Record, base.problem.record), tests_of(channel, base)
    retuned = search.is_retuned or moved(base.problem, base.fit, random.effects)
    findings, terms = terms_of(channel, search, random, retuned, before)
    findings, checks = checked(search, findings)
    objection = own_noise_objection(search) if retuned else ""
    if verdict_of(findings, retuned, after, search.comb_hz, objection) == UNKNOWN_EFFECT:
        findings = list(beside_misfit(findings))
    findings = [*(fault_finding(f, channel, record, noise.unit) for f in faults), *findings]
    return ChannelGap(
        channels=(channel,),
        unit=noise.unit,
        verdict=verdict_of(findings, retuned, after, search.comb_hz, objection),
        findings=tuple(findings),
        before=tuple(before),
        after=tuple(after),
        gap=gap,
        span_s=span_of(at.whole),
        assumed=(*random.effects, *(t.effect for t in at.trusted)),
        updated=at.updated(noise, terms, changed=bool(findings) or retuned),
        limits=limits_of(channel, noise.unit, base, at.trusted),
        record=at.whole,
        retuned=retuned,
        own_noise_objection=objection,
        comb_hz=search.comb_hz,
        refused=tuple(replace(r, where=channel) for r in refused_of(search)),
        white=series_of(base).fast,
        checks=checks,
        clean=replace(at.whole, y=at.whole.y - raw.y + clean.y),
    )


def _beside_gains(finding: Finding, record: Evidence, effects: Sequence[Effect]) -> Finding:
    """As probable as beside misfit where gains of the model that are off would look the same; a line they do not make."""
    effect = finding.effect
    sure = effect.coefficients() or effect.changes_samples or not is_among_gains(record, effects, effect)
    return finding if sure else beside_misfit([finding])[0]


def _faults_beside(record: Record, noise: ChannelNoise) -> list[DetectedFault]:
    """Faults that the samples show and that the model does not have."""
    assumed = {e.name for e in noise.effects}
    return [f for f in record.faults if f.spoils or f.effect.name not in assumed]


def prepared(record: Record, noise: ChannelNoise) -> Prepared:
    """A record and what is assumed about it, made ready for the search.

    Parameters
    ----------
    record : Record
        As it was logged, even.
    noise : ChannelNoise
        Assumed of it.
    """
    whole = replace(
        record.quick(), block=max(1, record.y.size // MAX_SAMPLES_IN_FULL), per_decade=BINS_PER_DECADE
    )
    raw, trusted, random = without_assumed_terms(whole, noise)
    altering = tuple(t for t in random.terms if t.effect.changes_samples)
    random = replace(random, terms=tuple(t for t in random.terms if not t.effect.changes_samples))
    raw = without_altering(raw, random, [t.effect for t in altering])
    names = frozenset(t.effect.name for t in altering)
    names |= hidden_in_means() if record.averaged > 1 else frozenset()
    search = ChannelExplanation(raw, random.effects, priors_of(random), without=names)
    return Prepared(whole, raw, trusted, altering, random, search)


def hidden_in_means() -> frozenset[str]:
    """Names of effects that means of many samples do not show: of single samples, and of what is fast."""
    return frozenset(
        name
        for name, cls in catalogue().items()
        if cls.changes_samples or cls.is_filter or issubclass(cls, Quantisation)
    )


def checked(search: ChannelExplanation, findings: list[Finding]) -> tuple[list[Finding], Checks | None]:
    """The findings as probable as the checks of what was added allow, and these checks.

    Parameters
    ----------
    search : ChannelExplanation
        Finished.
    findings : list of Finding
        Of it.
    """
    if not findings:
        return [], None
    sized = ("size", "signed", "solved", "ratio", "frequency", "corner")
    sizes = {f.name: [p.name for p in f.effect.estimated() if p.kind in sized] for f in findings}
    intervals = [(f.name, *f.ci95[n]) for f in findings for n in sizes[f.name][:1] if n in f.ci95]
    checks = checks_of(search, search.base.fit.effects, intervals)
    return checks.tempered(findings), checks


def as_written(record: Evidence, effects: tuple[Effect, ...]) -> Candidate:
    """The assumed model exactly as it is written, on a record.

    Parameters
    ----------
    record : Evidence
    effects : tuple of Effect
    """
    every = frozenset((i, p.name) for i, e in enumerate(effects) for p in e.searched())
    problem = Problem(record, effects, fixed=every)
    return Candidate("", maximise(problem), problem, 0.0)


def tests_of(channel: str, base: Candidate) -> list[Test]:
    """The battery on what a fitted model leaves of a channel; of several records together at one family-wise rate.

    Parameters
    ----------
    channel : str
    base : Candidate
        The model, fitted.
    """
    fit, records = base.fit, records_of(base.problem.record)
    found = []
    for record in records:
        alone = replace(base, problem=replace(base.problem, record=record))
        tests = battery(record, fit.effects, fit.likelihood.coefficients, series_of(alone))
        found += [replace(t, p=min(1.0, len(records) * t.p), channel=channel) for t in tests]
    return sorted(found, key=lambda t: t.p)


def without_altering(record: Record, noise: ChannelNoise, altering: Sequence[Effect]) -> Record:
    """The record without what assumed effects do to its samples.

    Parameters
    ----------
    record : Record
    noise : ChannelNoise
        The other assumed terms.
    altering : sequence of Effect
        Assumed effects that change samples.
    """
    for effect in altering:
        series = series_of(as_written(record, noise.effects))
        clean = effect.removed_from(series)
        assert clean is not None
        record = replace(record, y=record.y - series.y + clean)
    return record


def verdict_of(
    findings: Sequence[Finding], retuned: bool, tests: Sequence[Test], comb_hz: float, objection: str = ""
) -> str:
    """The verdict by what was found, by the tests of what is left, and by a comb of lines.

    Parameters
    ----------
    findings : sequence of Finding
    retuned : bool
        Whether assumed numbers were estimated again.
    tests : sequence of Test
        Under the updated model.
    comb_hz : float
        Fundamental of a comb of lines; zero where there is none.
    objection : str
        In what the course of the model's own noise is none of its kind; empty where in nothing.
    """
    if any(t.significant for t in tests) or comb_hz > 0.0 or objection or any(f.objection for f in findings):
        return UNKNOWN_EFFECT
    return EFFECTS_FOUND if findings or retuned else NO_GAP


def terms_of(
    channel: str, search: ChannelExplanation, noise: ChannelNoise, retuned: bool, before: Sequence[Test]
) -> tuple[list[Finding], tuple[Term, ...]]:
    """The findings, and the terms of the updated model, with 95 % intervals.

    Parameters
    ----------
    channel : str
    search : ChannelExplanation
        Finished.
    noise : ChannelNoise
        The assumed random terms.
    retuned : bool
        Whether these take the numbers of the fit.
    before : sequence of Test
        Under the assumed model.
    """
    base = search.base
    closed = closed_intervals(replace(base.problem, effects=base.fit.effects), base.fit)
    kept = len(noise.terms)
    terms = [
        Term(effect, {name: ci for (k, name), ci in closed.items() if k == i})
        for i, effect in enumerate(base.fit.effects)
    ]
    findings = []
    added = iter(range(kept, len(terms)))
    for chosen in (c for c in search.chosen if c.name != RETUNE):
        detected = chosen.addition.detect
        found = dict(detected.ci95) if detected else {}
        if chosen.addition.changes_samples:
            term = Term(chosen.addition.effect, found)
            terms.append(term)
        else:
            i = next(added)
            term = terms[i] = replace(terms[i], ci95=found | dict(terms[i].ci95))
        alone = len(search.chosen) == 1
        rest = None if alone else search.less(search.chosen.index(chosen))
        worst = before[0] if rest is None else tests_of(channel, rest.base)[0]
        findings.append(_finding(channel, noise.unit, chosen, term, worst))
    if not retuned:
        terms[:kept] = noise.terms
    findings = [_beside_gains(f, base.problem.record, base.fit.effects) for f in findings]
    return with_objections(search, findings), tuple(terms)


def _finding(channel: str, unit: str, chosen: Chosen[Candidate], term: Term, worst: Test) -> Finding:
    return Finding(
        term.effect,
        channel,
        unit,
        term.ci95,
        chosen.probability,
        chosen.gain,
        tuple((n, "" if n == NO_EFFECT[0] else channel, p) for n, _, p in chosen.alternatives),
        tuple(replace(o, where=channel) for o in chosen.others),
        worst,
        once=not lasts(type(term.effect)),
    )


def limits_of(
    channel: str, unit: str, base: Candidate, trusted: Sequence[Term] = ()
) -> tuple[DetectionLimit, ...]:
    """For each effect that was not found, the size that would be worth `DETECTION_LIMIT_NATS`.

    Parameters
    ----------
    channel, unit : str
    base : Candidate
        The updated model.
    trusted : sequence of Term
        Deterministic terms that were removed from its record: for these none is given.
    """
    present, record = {e.name for e in base.fit.effects}, base.problem.record
    sizeless = frozenset(name for name, cls in catalogue().items() if cls.changes_samples or cls.is_filter)
    out = []
    for starts in additions(base, series_of(base), sizeless):
        effect = starts[-1].effect
        if effect.name in present:
            continue
        first = effect.estimated()[0].name
        size = effect.coefficients()[0] if effect.coefficients() else effect.sizes()[0]
        if effect.coefficients():
            value = _linear_limit(record, base, effect)
            shown = first if size == "in_phase" else size
        else:
            value, shown = _size_limit(base, effect), size
        out.append(DetectionLimit(replace(effect, **{shown: value}), channel, shown, value, unit))
    return tuple(m for m in out if m.effect.name not in {t.effect.name for t in trusted})


def _linear_limit(record: Evidence, base: Candidate, effect: Effect) -> float:
    data = record.ordinates([effect])
    weight = data.weight(base.fit.effects)
    places = any(p.kind == "place" for p in effect.parameters())
    nats = DETECTION_LIMIT_NATS + (float(np.log(record.n)) if places else 0.0)
    return float(np.sqrt(2.0 * nats / max(float((data.gram[:, 1, 1] * weight).sum()), 1e-300)))


def _size_limit(base: Candidate, effect: Effect) -> float:
    from scipy.optimize import brentq

    data, size = base.problem.record.ordinates(()), effect.sizes()[0]
    relative = data.weight(base.fit.effects) * data.part(replace(effect, **{size: 1.0}))

    def worth(log_size: float) -> float:
        x = np.exp(2.0 * log_size) * relative
        return float(0.5 * (data.count * (x - np.log1p(x))).sum()) - DETECTION_LIMIT_NATS

    lo, hi = base.problem.record.box("size")
    return float(np.exp(brentq(worth, lo, hi))) if worth(lo) < 0.0 < worth(hi) else float("inf")
