"""What is missing: candidates compared by their marginal likelihood.

A candidate is the believed model with one more effect, all parameters fitted. Its evidence is the
likelihood integrated over them by Laplace's method in logarithms [1]_: sizes and times have
log-uniform priors, the believed model's numbers keep the priors that trust in them gives, and
a coefficient of a deterministic effect is log-uniform in its size, of either sign. ``retune``
competes openly: the same structure with the trust taken away. Each addition costs the
logarithm of the number of candidates, and `ABOVE` nats are asked for before anything is named.

References
----------
.. [1] D. J. C. MacKay, Information Theory, Inference, and Learning Algorithms, 2003, ch. 27-28.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from kfgen.effects import Effect, catalogue
from kfgen.identify.fit import Fit, Key, Prior, Problem, curvature, maximise
from kfgen.identify.record import Record

ABOVE = 3.0
"""Nats of evidence above which an effect is named."""
DECADES = float(np.log(1e2))
"""Width of the log-uniform prior of a size."""
COEFFICIENT = float(2.0 * np.log(1e4))
"""Normalisation of the log-uniform prior of a coefficient of either sign."""


@dataclass(frozen=True)
class Candidate:
    """A fitted candidate: the effect added ("" for none, "retune" for none but free), its evidence.

    Parameters
    ----------
    gain : float
        Evidence in nats over the believed model, the cost of adding taken off.
    """

    name: str
    fit: Fit
    problem: Problem
    gain: float


def log_evidence(problem: Problem, fit: Fit) -> float:
    """The logarithm of the marginal likelihood, up to a constant of the record [nats]."""
    value = fit.likelihood.value
    k = fit.point.size
    for key, x in zip(fit.free, fit.point.tolist()):
        prior = problem.priors.get(key)
        if prior is not None:
            value += prior.log_density(x) - float(np.log(prior.deviation * np.sqrt(2 * np.pi)))
        else:
            value -= float(np.log(_width(problem, key)))
    if k:
        floor = 2.0 * np.pi / np.array([_volume(problem, key) for key in fit.free]) ** 2
        scaled = curvature(problem, fit.point) / np.sqrt(np.outer(floor, floor))
        eigenvalues = np.maximum(np.linalg.eigvalsh(0.5 * (scaled + scaled.T)), 1.0)
        value += 0.5 * k * float(np.log(2 * np.pi)) - 0.5 * float(np.log(eigenvalues).sum())
        value -= 0.5 * float(np.log(floor).sum())
    return value + _linear_evidence(fit)


def _width(problem: Problem, key: Key) -> float:
    """Width of the log-uniform prior of a free parameter."""
    lo, hi = problem.bounds[problem.free.index(key)]
    kinds = {p.name: p.kind for p in problem.effects[key[0]].parameters()}
    return hi - lo if kinds[key[1]] == "time" else DECADES


def _volume(problem: Problem, key: Key) -> float:
    """The most that a parameter's likelihood can spread: its prior's width."""
    prior = problem.priors.get(key)
    return prior.deviation * float(np.sqrt(2 * np.pi)) if prior is not None else _width(problem, key)


def _linear_evidence(fit: Fit) -> float:
    theta, covariance = fit.likelihood.coefficients, fit.likelihood.covariance
    if not theta.size:
        return 0.0
    _, logdet = np.linalg.slogdet(covariance)
    spread = np.sqrt(np.diag(covariance))
    priors = np.log(COEFFICIENT * np.maximum(np.abs(theta), spread))
    return float(0.5 * theta.size * np.log(2 * np.pi) + 0.5 * logdet - priors.sum())


def believed(record: Record, effects: Sequence[Effect], priors: Mapping[Key, Prior]) -> Candidate:
    """The believed model, its numbers moved only as far as trust lets them."""
    problem = Problem(record, tuple(effects), priors)
    return Candidate("", maximise(problem), problem, 0.0)


def candidates(base: Candidate) -> list[Candidate]:
    """Every addition that the record allows, by evidence, the best first."""
    allowed = additions(base)
    cost = float(np.log(len(allowed) + 1))
    reference = log_evidence(base.problem, base.fit) + cost
    found = [_retuned(base, reference), *(_added(starts, base, reference) for starts in allowed)]
    return sorted(found, key=lambda c: -c.gain)


def additions(base: Candidate) -> list[list[Effect]]:
    """The start values of every effect of the catalogue that could be added."""
    present = {e.name for e in base.fit.effects}
    look = base.problem.record.look
    shown = [
        list(cls.starts(look)) for name, cls in catalogue().items() if cls.repeatable or name not in present
    ]
    return [starts for starts in shown if starts]


def _retuned(base: Candidate, reference: float) -> Candidate:
    problem = replace(base.problem, priors={})
    fit = maximise(problem.starting(base.fit.effects))
    return Candidate("retune", fit, problem, log_evidence(problem, fit) - reference)


def _added(starts: Sequence[Effect], base: Candidate, reference: float) -> Candidate:
    """The best fit of the believed model with one more effect, from all its start values."""
    known = base.fit.effects
    first = Problem(base.problem.record, (*known, starts[0]), base.problem.priors)
    problems = [
        first.starting((*known, _scaled(start, scale)))
        for start in starts
        for scale in ((1.0,) if start.coefficients() else (1.0, 0.1))
    ]
    fits = [maximise(p) for p in problems]
    best = int(np.argmax([f.value for f in fits]))
    gain = log_evidence(problems[best], fits[best]) - reference
    return Candidate(starts[0].name, fits[best], problems[best], gain)


def _scaled(effect: Effect, scale: float) -> Effect:
    sizes = {p.name: scale * float(getattr(effect, p.name)) for p in effect.estimated() if p.kind == "size"}
    return replace(effect, **sizes)


def probabilities(ranked: Sequence[Candidate]) -> dict[str, float]:
    """Posterior probability of each candidate, "none" among them."""
    gains = np.array([0.0, *(c.gain for c in ranked)])
    weights = np.exp(gains - gains.max())
    shares = weights / weights.sum()
    return dict(zip(["none", *(c.name for c in ranked)], shares.tolist()))
