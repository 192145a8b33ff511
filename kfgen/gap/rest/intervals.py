"""Intervals of what was found at rest, with what the record cannot exclude in them.

A drift that is too weak to be named moves a step, a coefficient of the temperature or a warm-up as well as one that is
named does, and a spectrum that does not fit moves every size. So coefficients are as uncertain as they are on average
beside random walks of all sizes, each weighed by how well the record fits with it, and sizes as the sandwich says.

A shape with a time or a width (a warm-up, a hysteresis, a lag) has coefficients that follow it: their intervals hold
what they come to at both ends of its interval, which is that of the profile likelihood beside such a walk.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from kfgen.effects import catalogue
from kfgen.gap.rest.explanation import ABSORBERS
from kfgen.identify.fit.fit import Fit, Key, Problem, maximise, profile
from kfgen.identify.fit.goodness import widening
from kfgen.identify.fit.interval import CHI_SQUARE_95, interval95, intervals95, linear_intervals, stretched

WEAK_WALK = "rate_random_walk"
SCALES = np.concatenate([[0.0], np.geomspace(1e-3, 1.0, 10)])
"""Sizes of such a walk over that which it would have if all that is slow were of it; each is as likely before."""

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
    walks = _beside_weak_walks(problem, fit)
    found |= _averaged(fit, walks)
    typical = max(walks, key=lambda w: w.weight)
    for key in _shapes(fit):
        lo, hi = interval95(typical.problem, typical.fit, key)
        old = found.get(key, (lo, hi))
        found[key] = min(lo, old[0]), max(hi, old[1])
        found |= _with_shape(typical, key, found)
    return {key: ci for key, ci in found.items() if np.isfinite(ci).all()}


@dataclass(frozen=True)
class _Beside:
    """What was fitted beside a random walk of one size: its problem, its maximum, its share of all of them."""

    problem: Problem
    fit: Fit
    weight: float


def _beside_weak_walks(problem: Problem, fit: Fit) -> list[_Beside]:
    """The fit beside walks of several sizes, none among them; without one where there is slow noise, or no drift."""
    names = {e.name for e in fit.effects}
    walks = catalogue()[WEAK_WALK].starts(problem.record.look)
    alone = [_Beside(problem, fit, 1.0)]
    if names & ABSORBERS or not walks or not any(e.coefficients() for e in fit.effects):
        return alone
    at, (size,) = len(fit.effects), walks[0].sizes()
    slow = float(getattr(walks[0], size))
    problems = [
        replace(problem, effects=(*fit.effects, replace(walks[0], **{size: s * slow})))
        for s in SCALES[1:].tolist()
    ]
    problems = [replace(p, fixed=p.fixed | {(at, size)}) for p in problems]
    fits = [fit, *(maximise(p) for p in problems)]
    values = np.array([f.value for f in fits])
    likelihood = np.exp(values - values.max())
    steps = np.diff(SCALES)
    weights = likelihood * (np.append(steps, 0.0) + np.append(0.0, steps))
    weights /= weights.sum()
    return [_Beside(p, f, w) for p, f, w in zip([problem, *problems], fits, weights.tolist())]


def _averaged(fit: Fit, walks: Sequence[_Beside]) -> dict[Key, Interval]:
    """Intervals of the coefficients: about those of the fit, as far as they spread on average beside the walks."""
    out = {}
    each = [linear_intervals(w.fit) for w in walks]
    phases = {(i, p.name) for i, e in enumerate(fit.effects) for p in e.parameters() if p.is_phase}
    for i, name in each[0]:
        value, variance = float(getattr(fit.effects[i], name)), 0.0
        for w, intervals in zip(walks, each):
            lo, hi = intervals[i, name]
            moved = float(getattr(w.fit.effects[i], name)) - value
            if (i, name) in phases:
                moved = float(np.angle(np.exp(1j * moved)))
            variance += w.weight * ((0.5 * (hi - lo)) ** 2 + CHI_SQUARE_95 * moved**2)
        half = float(np.sqrt(variance))
        out[i, name] = value - half, value + half
    return out


def _shapes(fit: Fit) -> list[Key]:
    """The times and widths of shapes of which there is one of a kind: the others are placed by their own scan."""
    return [
        (i, p.name)
        for i, e in enumerate(fit.effects)
        if e.coefficients() and not e.repeatable
        for p in e.parameters()
        if p.kind in ("time", "place")
    ]


def _with_shape(beside: _Beside, key: Key, found: Mapping[Key, Interval]) -> dict[Key, Interval]:
    """Intervals of the coefficients of a shape with what its time or width, in its own interval, makes of them."""
    best, i, out = beside.fit, key[0], {}
    closed = [x for x in found.get(key, ()) if 0.0 < x < float("inf")]
    ends = [profile(beside.problem, best, key, x).effects[i] for x in closed]
    for name in best.effects[i].coefficients() if ends else ():
        lo, hi = found[i, name]
        value = float(getattr(best.effects[i], name))
        moved = [float(getattr(e, name)) - value for e in ends]
        below, above = -min(*moved, 0.0), max(*moved, 0.0)
        middle, half = 0.5 * (lo + hi), 0.5 * (hi - lo)
        out[i, name] = middle - float(np.hypot(half, below)), middle + float(np.hypot(half, above))
    return out
