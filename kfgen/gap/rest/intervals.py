"""Intervals of what was found at rest, with what the record cannot exclude in them.

A drift that is too weak to be named moves a step, a coefficient of the temperature or a warm-up as well as one that is
named does, and a spectrum that does not fit moves every size. So coefficients are as uncertain as they would be beside
the random walk that the record would most likely have, and sizes as the sandwich says.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from kfgen.effects import catalogue
from kfgen.gap.rest.explanation import ABSORBERS
from kfgen.identify.fit.fit import Fit, Key, Problem, maximise
from kfgen.identify.fit.goodness import widening
from kfgen.identify.fit.interval import intervals95, linear_intervals, stretched

WEAK_WALK = "rate_random_walk"
START_SCALES = (1.0, 0.1, 0.01)
"""Of the size that such a walk would have if all that is slow were of it."""

Interval = tuple[float, float]


def closed_intervals(problem: Problem, fit: Fit) -> Mapping[Key, Interval]:
    """95 % intervals [SI] that have two ends, as wide as the record lets them be.

    Parameters
    ----------
    problem : Problem
        What was fitted.
    fit : Fit
        Its maximum.
    """
    factors = widening(problem.record, fit)
    found = {
        key: stretched(ci, float(getattr(fit.effects[key[0]], key[1])), factors.get(key, 1.0))
        for key, ci in intervals95(problem, fit).items()
    }
    beside = _beside_a_weak_walk(problem, fit)
    for key, ci in (linear_intervals(beside) if beside else {}).items():
        lo, hi = found[key]
        wider = max(0.5 * (ci[1] - ci[0]) - 0.5 * (hi - lo), 0.0)
        found[key] = lo - wider, hi + wider
    return {key: ci for key, ci in found.items() if np.isfinite(ci).all()}


def _beside_a_weak_walk(problem: Problem, fit: Fit) -> Fit | None:
    """The fit with a random walk of its own size beside all effects; None where there is slow noise, or none is likelier."""
    names = {e.name for e in fit.effects}
    walks = catalogue()[WEAK_WALK].starts(problem.record.look)
    if names & ABSORBERS or not walks or not any(e.coefficients() for e in fit.effects):
        return None
    (size,) = walks[0].sizes()
    tried = [replace(walks[0], **{size: s * float(getattr(walks[0], size))}) for s in START_SCALES]
    fits = [maximise(replace(problem, effects=(*fit.effects, walk))) for walk in tried]
    best = max(fits, key=lambda f: f.value)
    return best if best.value > fit.value else None
