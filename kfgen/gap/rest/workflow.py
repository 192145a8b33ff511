"""The workflow: compare, localise, name, add, prove, again, until nothing significant is left."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from kfgen.effects import Effect, catalogue
from kfgen.effects.noise_model import ChannelNoise, Term
from kfgen.gap.core.battery import Test, battery
from kfgen.gap.core.holdout import held_out_gap
from kfgen.gap.rest.checks import Checks, checks_of
from kfgen.gap.rest.evidence import Candidate, additions, series_of
from kfgen.gap.rest.faults import said_of, spoilt, spotted_in
from kfgen.gap.rest.finding import ChannelGap, Finding
from kfgen.gap.rest.search import RETUNE, SET, Chosen, Search, searched
from kfgen.gap.rest.trust import check, merged, moved, priors_of, taken_out
from kfgen.identify.evidence.joint import records_of
from kfgen.identify.evidence.record import Evidence, Record
from kfgen.identify.fit.fit import Problem, maximise
from kfgen.identify.fit.interval import intervals95
from kfgen.identify.identify import MAX_SAMPLES_IN_FULL

__all__ = ["SET", "ChannelGap", "Finding", "find_gap"]

Array = NDArray[np.float64]

DETECTABLE = 8.0
"""Nats that an effect must be worth on average to be named."""
FINE = 200
"""Bins of the transform in a decade: a resonance may be narrow."""


@dataclass(frozen=True)
class Prepared:
    """A record made ready.

    Parameters
    ----------
    whole, raw : Record
        As it is, and less what believed shapes and changes of samples give it.
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
    search: Search


def find_gap(
    channel: str, record: Record, noise: ChannelNoise, stamps: Array | None = None, stated: float = 0.0
) -> ChannelGap:
    """Compare one channel with the noise model that is believed of it.

    Parameters
    ----------
    channel : str
    record : Record
    noise : ChannelNoise
    stamps : ndarray, optional
        The time stamps as they were logged [s], where the record's are not.
    stated : float
        How long the log's header says that it lasted [s]; zero where it does not.

    Raises
    ------
    InputError
        The record is too short, or the model has no effect.
    """
    check(channel, record, noise)
    noise = noise.extended_band(record.dt, record.duration)
    faults = [*record.faults, *spotted_in(record, noise, stamps, stated)]
    if any(f.spoils for f in faults):
        return spoilt(channel, record, noise, faults)
    at = prepared(record, noise)
    raw, random = at.raw, at.random
    before = tests_of(written(raw, random.effects))
    search = searched(at.search)
    base = search.base()
    after = tests_of(base)
    retuned = any(c.name == RETUNE for c in search.chosen) or moved(base.problem, base.fit, random.effects)
    findings, terms = terms_of(search, base, random, retuned, before)
    checks = checked(search, base, findings) if findings else None
    findings = [*(said_of(f, record) for f in faults), *findings]
    clean = base.problem.record
    assert isinstance(clean, Record)
    trusted = tuple(t.effect for t in at.trusted)
    mended = replace(noise, terms=(*merged(at.trusted, terms), *at.altering), covariance=None)
    return ChannelGap(
        channel,
        noise.unit,
        verdict_of(findings, retuned, after, search.comb),
        tuple(findings),
        tuple(before),
        tuple(after),
        held_out_gap(raw, clean, random.effects, replace(base.problem, effects=base.fit.effects)),
        (*random.effects, *trusted),
        mended,
        tuple(m for m in limits_of(base) if m[0].name not in {e.name for e in trusted}),
        at.whole,
        retuned,
        series_of(base).fast,
        checks,
        replace(at.whole, y=at.whole.y - raw.y + clean.y),
    )


def prepared(record: Record, noise: ChannelNoise) -> Prepared:
    """A record and what is believed of it, made ready for the search."""
    whole = replace(record, block=max(1, record.y.size // MAX_SAMPLES_IN_FULL), per_decade=FINE)
    raw, trusted, random = taken_out(whole, noise)
    altering = tuple(t for t in random.terms if t.effect.changes_samples)
    random = replace(random, terms=tuple(t for t in random.terms if not t.effect.changes_samples))
    raw = without_altering(raw, random, [t.effect for t in altering])
    names = frozenset(t.effect.name for t in altering)
    search = Search(raw, random.effects, priors_of(random), without=names)
    return Prepared(whole, raw, trusted, altering, random, search)


def checked(search: Search, base: Candidate, findings: Sequence[Finding]) -> Checks:
    """The checks of what was added."""
    sizes = {
        f.effect.name: [
            p.name
            for p in f.effect.estimated()
            if p.kind in ("size", "signed", "solved", "ratio", "frequency", "corner")
        ]
        for f in findings
    }
    intervals = [
        (f.effect.name, n, *f.ci95[n]) for f in findings for n in sizes[f.effect.name][:1] if n in f.ci95
    ]
    return checks_of(search, base.fit.effects, intervals)


def written(record: Evidence, effects: tuple[Effect, ...]) -> Candidate:
    """The believed model exactly as it is written."""
    every = frozenset((i, p.name) for i, e in enumerate(effects) for p in e.searched())
    problem = Problem(record, effects, fixed=every)
    return Candidate("", maximise(problem), problem, 0.0)


def tests_of(base: Candidate) -> list[Test]:
    """The battery on what a model leaves; of several records together at one family-wise rate."""
    fit, records = base.fit, records_of(base.problem.record)
    found = []
    for record in records:
        alone = replace(base, problem=replace(base.problem, record=record))
        tests = battery(record, fit.effects, fit.likelihood.coefficients, series_of(alone))
        found += [replace(t, p=min(1.0, len(records) * t.p)) for t in tests]
    return sorted(found, key=lambda t: t.p)


def without_altering(record: Record, noise: ChannelNoise, altering: Sequence[Effect]) -> Record:
    """The record without what believed effects do to its samples."""
    for effect in altering:
        series = series_of(written(record, noise.effects))
        clean = effect.removed_from(series)
        assert clean is not None
        record = replace(record, y=record.y - series.y + clean)
    return record


def verdict_of(findings: Sequence[Finding], retuned: bool, tests: Sequence[Test], comb: float) -> str:
    """The verdict by what was found, by the tests of what is left, and by a comb of lines."""
    if any(t.significant for t in tests) or comb > 0.0:
        return "unknown_effect"
    return "effects_found" if findings or retuned else "no_gap"


def terms_of(
    search: Search, base: Candidate, noise: ChannelNoise, retuned: bool, before: Sequence[Test]
) -> tuple[list[Finding], tuple[Term, ...]]:
    """The findings, and the terms of the mended model, with intervals."""
    problem = replace(base.problem, effects=base.fit.effects)
    closed = {k: ci for k, ci in intervals95(problem, base.fit).items() if np.isfinite(ci).all()}
    kept = len(noise.terms)
    terms = [
        Term(effect, {name: ci for (k, name), ci in closed.items() if k == i})
        for i, effect in enumerate(base.fit.effects)
    ]
    findings = []
    added = iter(range(kept, len(terms)))
    for chosen in (c for c in search.chosen if c.name != RETUNE):
        sought = chosen.candidate.detect
        found = dict(sought.ci95) if sought else {}
        if chosen.candidate.changes_samples:
            term = Term(chosen.candidate.effect, found)
            terms.append(term)
        else:
            i = next(added)
            term = terms[i] = replace(terms[i], ci95=found | dict(terms[i].ci95))
        rest = search.less(search.chosen.index(chosen))
        worst = tests_of(rest.base())[0] if len(search.chosen) > 1 else before[0]
        findings.append(_finding(chosen, term, worst))
    if not retuned:
        terms[:kept] = noise.terms
    return findings, tuple(terms)


def _finding(chosen: Chosen, term: Term, worst: Test) -> Finding:
    others = sorted(((n, p) for n, p in chosen.shares.items() if n != chosen.name), key=lambda a: -a[1])
    return Finding(
        term.effect,
        term.ci95,
        chosen.shares[chosen.name],
        chosen.candidate.gain,
        tuple(others),
        worst,
        chosen.others,
    )


def limits_of(base: Candidate) -> list[tuple[Effect, str, float]]:
    """For each effect that was not found, the size that would be worth `DETECTABLE` nats."""
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
        out.append((replace(effect, **{shown: value}), shown, value))
    return out


def _linear_limit(record: Evidence, base: Candidate, effect: Effect) -> float:
    data = record.ordinates([effect])
    S = data.density(base.fit.effects)
    places = any(p.kind == "place" for p in effect.parameters())
    nats = DETECTABLE + (float(np.log(record.n)) if places else 0.0)
    return float(np.sqrt(2.0 * nats / max(float((data.gram[:, 1, 1] / S).sum()), 1e-300)))


def _size_limit(base: Candidate, effect: Effect) -> float:
    from scipy.optimize import brentq

    data, size = base.problem.record.ordinates(()), effect.sizes()[0]
    S, part = data.density(base.fit.effects), data.part(replace(effect, **{size: 1.0}))

    def worth(log_size: float) -> float:
        x = np.exp(2.0 * log_size) * part / S
        return float(0.5 * (data.count * (x - np.log1p(x))).sum()) - DETECTABLE

    lo, hi = base.problem.record.box("size")
    return float(np.exp(brentq(worth, lo, hi))) if worth(lo) < 0.0 < worth(hi) else float("inf")
