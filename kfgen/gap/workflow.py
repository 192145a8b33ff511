"""The workflow: compare, localise, name, add, prove, again, until nothing significant is left."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from kfgen.effects import Effect
from kfgen.errors import InputError
from kfgen.gap.battery import Test, battery
from kfgen.gap.evidence import ABOVE, Candidate, additions, believed, candidates, probabilities
from kfgen.gap.proof import Gap, held_out_gap, split
from kfgen.identify.channel import LONG, MINIMUM
from kfgen.identify.fit import Fit, Key, Prior, Problem, maximise
from kfgen.identify.interval import intervals95
from kfgen.identify.record import Evidence, Record
from kfgen.noise import ChannelNoise, Term

TRUST = 0.1
"""Relative deviation of a believed number that states no interval."""
LEAST_TRUST = 0.02
FAR_FROM = 2.0
"""Deviations from a believed number beyond which it does not hold."""
SET = 0.05
"""Probability above which an alternative belongs to what cannot be told apart."""
DETECTABLE = 8.0
"""Nats that an effect must be worth on average to be named."""


@dataclass(frozen=True)
class Finding:
    """A missing effect.

    Parameters
    ----------
    effect : Effect
        With its fitted values.
    ci95 : mapping
        Intervals of its parameters [SI].
    probability : float
        Among all candidates and none.
    evidence : float
        Nats.
    alternatives : tuple of (name, probability)
    worst : Test
        The test that showed most disagreement before it was added.
    """

    effect: Effect
    ci95: Mapping[str, tuple[float, float]]
    probability: float
    evidence: float
    alternatives: tuple[tuple[str, float], ...]
    worst: Test

    @property
    def indistinguishable(self) -> tuple[str, ...]:
        """Alternatives that the record does not rule out."""
        return tuple(n for n, p in self.alternatives if p > SET and n != "none")


@dataclass(frozen=True)
class ChannelGap:
    """The answer for one channel.

    Parameters
    ----------
    verdict : str
        ``no_gap``, ``effects_found`` or ``unknown_effect``.
    before, after : list of Test
        The battery under the believed and under the mended model.
    limits : list of (Effect, parameter, value)
        What would not have been seen.
    """

    channel: str
    unit: str
    verdict: str
    findings: tuple[Finding, ...]
    before: tuple[Test, ...]
    after: tuple[Test, ...]
    gap: Gap
    believed: tuple[Effect, ...]
    mended: ChannelNoise
    limits: tuple[tuple[Effect, str, float], ...]
    record: Record
    retuned: bool = False


def priors_of(noise: ChannelNoise) -> dict[Key, Prior]:
    """Trust in the believed numbers: from their intervals, else `TRUST`."""
    priors: dict[Key, Prior] = {}
    for i, term in enumerate(noise.terms):
        if term.effect.coefficients():
            continue
        for p in term.effect.estimated():
            value = float(getattr(term.effect, p.name))
            lo, hi = term.ci95.get(p.name, (0.0, 0.0))
            known = 0.0 < lo < hi < np.inf
            deviation = max(float(np.log(hi / lo)) / 3.92, LEAST_TRUST) if known else TRUST
            if value > 0.0:
                priors[i, p.name] = Prior(float(np.log(value)), deviation)
    return priors


def find_gap(channel: str, record: Record, noise: ChannelNoise) -> ChannelGap:
    """Compare one channel with the noise model that is believed of it.

    Raises
    ------
    InputError
        The record is too short, or the model has no effect.
    """
    _check(channel, record, noise)
    whole = replace(record, block=max(1, record.y.size // LONG))
    record, trusted, noise = _taken_out(whole, noise)
    fitted, tail = split(record)
    priors = priors_of(noise)
    base = start = believed(fitted, noise.effects, priors)
    written = maximise(Problem(fitted, noise.effects, fixed=frozenset(start.fit.free)))
    before = battery(fitted, written.effects, written.likelihood.coefficients)
    findings: list[Finding] = []
    tests = battery(fitted, start.fit.effects, start.fit.likelihood.coefficients)
    retuned = False
    while True:
        ranked = candidates(base)
        best = ranked[0]
        if best.gain < ABOVE or (best.name == "retune" and retuned):
            break
        if best.name == "retune":
            retuned, base = True, replace(best, problem=replace(best.problem, priors={}))
        else:
            findings.append(_finding(best, ranked, tests[0]))
            base = best
        tests = battery(fitted, base.fit.effects, base.fit.likelihood.coefficients)
    if not findings and not retuned and any(t.significant for t in before):
        retuned = _moved(start.fit, priors)
    gap = held_out_gap(tail, written, base.fit)
    findings, mended = _refitted(record, noise, base, findings, retuned)
    mended = replace(mended, terms=_merged(trusted, mended.terms))
    verdict = _verdict(findings, retuned, tests)
    return ChannelGap(
        channel,
        noise.unit,
        verdict,
        tuple(findings),
        tuple(before),
        tuple(tests),
        gap,
        (*noise.effects, *(t.effect for t in trusted)),
        mended,
        tuple(m for m in _limits(base) if m[0].name not in {t.effect.name for t in trusted}),
        whole,
        retuned,
    )


def _taken_out(record: Record, noise: ChannelNoise) -> tuple[Record, tuple[Term, ...], ChannelNoise]:
    """The record less what the believed deterministic terms say, those terms, and the random ones.

    So a wrong coefficient shows as a missing rest of the same effect, and a constant as nothing.
    """
    trusted = tuple(t for t in noise.terms if t.effect.coefficients())
    for term in trusted:
        driver = term.effect.driver
        if driver and driver not in record.drive:
            raise InputError(
                f"the model has the effect {term.effect.name}, but the log has no channel '{driver}'",
                remedy="Give a log with it, or take the effect out of the model",
            )
    y = record.y - sum(
        (t.effect.mean(record.elapsed, record.drive) for t in trusted), np.zeros(record.y.size)
    )
    random = tuple(t for t in noise.terms if not t.effect.coefficients())
    return replace(record, y=y), trusted, replace(noise, terms=random)


def _merged(trusted: tuple[Term, ...], terms: tuple[Term, ...]) -> tuple[Term, ...]:
    """Believed deterministic terms with what was found to be missing of them added."""
    out = list(terms)
    for old in trusted:
        name = old.effect.coefficients()[0]
        rest = next((t for t in out if t.effect.name == old.effect.name), None)
        if rest is None:
            out.append(old)
            continue
        base = float(getattr(old.effect, name))
        total = replace(rest.effect, **{name: base + float(getattr(rest.effect, name))})
        out[out.index(rest)] = Term(total, {k: (lo + base, hi + base) for k, (lo, hi) in rest.ci95.items()})
    return tuple(out)


def _moved(fit: Fit, priors: Mapping[Key, Prior]) -> bool:
    """Whether a number had to leave what is believed of it."""
    return any(
        abs(x - priors[key].mean) > FAR_FROM * priors[key].deviation
        for key, x in zip(fit.free, fit.point.tolist())
        if key in priors
    )


def _check(channel: str, record: Record, noise: ChannelNoise) -> None:
    if record.y.size < 4 * MINIMUM:
        raise InputError(
            f"{channel} has {record.y.size} samples, too few to fit and to prove",
            remedy=f"Log at least {4 * MINIMUM}",
        )
    if not np.ptp(record.y) > 0.0:
        raise InputError(f"{channel} never changes", remedy="Check the sensor and the column")
    if not any(e.form().V or e.form().Z for e in noise.effects):
        raise InputError(
            f"the model of {channel} has no white noise",
            remedy="Give it an effect white_noise, or identify it first",
        )


def _verdict(findings: Sequence[Finding], retuned: bool, tests: Sequence[Test]) -> str:
    if any(t.significant for t in tests):
        return "unknown_effect"
    return "effects_found" if findings or retuned else "no_gap"


def _finding(best: Candidate, ranked: Sequence[Candidate], worst: Test) -> Finding:
    shares = probabilities(ranked)
    others = sorted(((n, p) for n, p in shares.items() if n != best.name), key=lambda a: -a[1])
    return Finding(best.fit.effects[-1], {}, shares[best.name], best.gain, tuple(others), worst)


def _refitted(
    record: Record, noise: ChannelNoise, base: Candidate, findings: Sequence[Finding], retuned: bool
) -> tuple[list[Finding], ChannelNoise]:
    """After the proof: parameters and intervals from the whole record."""
    problem = replace(base.problem, record=record, effects=base.fit.effects)
    fit = maximise(problem)
    closed = {key: ci for key, ci in intervals95(problem, fit).items() if np.isfinite(ci[1])}
    terms = [
        Term(effect, {name: ci for (k, name), ci in closed.items() if k == i})
        for i, effect in enumerate(fit.effects)
    ]
    kept = len(noise.terms)
    if not retuned:
        terms[:kept] = noise.terms
    found = [replace(f, effect=t.effect, ci95=t.ci95) for f, t in zip(findings, terms[kept:])]
    return found, ChannelNoise(noise.unit, tuple(terms))


def _limits(base: Candidate) -> list[tuple[Effect, str, float]]:
    """For each effect that was not found, the size that would be worth `DETECTABLE` nats."""
    present, record = {e.name for e in base.fit.effects}, base.problem.record
    out = []
    for starts in additions(base):
        effect = starts[-1]
        size = effect.estimated()[0].name
        if effect.name not in present:
            value = (
                _linear_limit(record, base, effect) if effect.coefficients() else _size_limit(base, effect)
            )
            out.append((replace(effect, **{size: value}), size, value))
    return out


def _linear_limit(record: Evidence, base: Candidate, effect: Effect) -> float:
    data = record.ordinates([effect])
    S = data.density(base.fit.effects)
    return float(np.sqrt(2.0 * DETECTABLE / (data.gram[:, 1, 1] / S).sum()))


def _size_limit(base: Candidate, effect: Effect) -> float:
    from scipy.optimize import brentq

    data, size = base.problem.record.ordinates(()), effect.estimated()[0].name
    S, part = data.density(base.fit.effects), data.part(replace(effect, **{size: 1.0}))

    def worth(log_size: float) -> float:
        x = np.exp(2.0 * log_size) * part / S
        return float(0.5 * (data.count * (x - np.log1p(x))).sum()) - DETECTABLE

    lo, hi = base.problem.record.box("size")
    return float(np.exp(brentq(worth, lo, hi))) if worth(lo) < 0.0 < worth(hi) else float("inf")
