"""Additions to a scene: the promising ones fitted, and weighed by their evidence.

A world that is linear about a point says of large effects too little, or of the wrong one too much: about a path that a
receiver's delay of 0.3 s has turned aside, a low-pass of its velocity fits better than the delay. So the promising
additions are weighed about the path that each of them makes likeliest.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from kfgen.core.time_budget import search_is_over
from kfgen.effects.inertial.inertial_error import free
from kfgen.gap.core.search import Label, likeliest_first
from kfgen.gap.rest.evidence import TIME_LIMITS
from kfgen.gap.scene.evidence import evidence, evidence_over_widths, time_limits
from kfgen.gap.scene.newton import SceneFit, fitted, fitted_from
from kfgen.gap.scene.proof import unreached
from kfgen.gap.scene.scene import Linearised, Placed, Scene, ScenePoint, coordinates, has_several_maxima
from kfgen.gap.scene.screen import Screened
from kfgen.gap.scene.tempered_scene import TemperedScene
from kfgen.gap.scene.unevenness import unevenness_of_effect

Array = NDArray[np.float64]

RESEMBLING_MIN_COS2 = 0.2
"""Share cos^2 of a direction from which on another addition might be what an effect is."""
MIN_FAR_GAIN_NATS = 20.0
"""Evidence from which on an addition may move a path so far that it is to be weighed about another one."""
MIN_FAR_SHARE = 0.25
"""Of the evidence of the best addition, that others have at least which are weighed so."""
FAR_ADDITIONS = 5
"""Additions that are weighed so, at most."""
FAR_ROUNDS = 2
"""Linearisations by which they are weighed, at most: a turn by some degrees is a sum of small ones after the second only."""
FITTED_ADDITIONS = 8
"""Additions that are fitted, the best of the screen."""

FAR_BELOW_NATS = 30.0
"""Below the best addition, or half of what that gains, from where on another one need not be fitted to its end."""

MIN_SCREEN_GAIN_NATS = 1.0
"""Linear gain below which an addition is not fitted."""

MAX_LINEARISATIONS = 5
"""Of a world that is linear about a point."""

MAX_LOSS_NATS = 20.0
"""Of log-likelihood, beyond which another linearisation is worse than the one before."""

CONVERGED_SIGMAS = 0.1
"""Change of a fit, in its standard deviations, at which it is where its linearisation is."""

DIVERGED_MAX_INFORMATION_SHARE = 1e-6
"""Share of the information on an unknown below which the simulation has diverged."""


@dataclass(frozen=True)
class FittedAddition:
    """A fitted addition and its evidence over the scene without it [nats].

    Parameters
    ----------
    placed : Placed
    fit : SceneFit
        Of the scene with it, the last.
    gain : float
        Less the cost of choosing it.
    cost : float
        Of choosing it, its place and its time [nats].
    direction : ndarray, shape (N,)
        In which it moves the residuals most, as of `Screened`.
    even_share : float
        Of its evidence, what is no misfit that is larger at some times than at others.
    about : (Scene, SceneFit), optional
        The world about its fit, and the fit there, where it was weighed there.
    """

    placed: Placed
    fit: SceneFit
    gain: float
    cost: float
    direction: Array
    even_share: float = 1.0
    about: tuple[Scene, SceneFit] | None = None

    @property
    def label(self) -> Label:
        """Effect and place."""
        return self.placed.effect.name, self.placed.where


def relinearised(scene: Scene, fit: SceneFit, rounds: int = MAX_LINEARISATIONS) -> tuple[Scene, SceneFit]:
    """A world that is linear about a point, about its fit, until the fit moves by less than a tenth of its standard deviation.

    Parameters
    ----------
    scene : Scene
    fit : SceneFit
        Of that scene.
    rounds : int
        At most.
    """
    for _ in range(rounds):
        if not isinstance(scene, Linearised):
            break
        there = scene.about(fit.point)
        if not np.isfinite(there.residuals([fit.point])).all():
            break  # it has no path there: the linear one is all there is
        moved = fitted(there, fit.point)
        if moved.value < fit.value - MAX_LOSS_NATS:
            break
        change = np.abs(coordinates(moved.point) - coordinates(fit.point))
        scene, fit = there, moved
        if (change < CONVERGED_SIGMAS * np.sqrt(np.maximum(np.diag(fit.covariance), 1e-300))).all():
            break
    return scene, fit


def ranked(
    scene: Scene, base: SceneFit, others: Sequence[Screened], known: FittedAddition | None = None
) -> list[FittedAddition]:
    """The most promising additions, fitted, the likeliest effect at its place first.

    Parameters
    ----------
    scene : Scene
    base : SceneFit
        Of the scene without them.
    others : sequence of Screened
        Beside `base`, the best first.
    known : FittedAddition, optional
        An addition that is fitted already: half as many others are held against it.
    """
    if known is not None:
        others = [o for o in others if not _alike(o.start, known.placed)]
    if not others and known is None:
        return []
    every = [o.start for o in others] + ([known.placed] if known is not None else [])
    trials = [known] if known is not None else []
    highest = base.value if known is None else known.fit.value
    for o in others[: FITTED_ADDITIONS if known is None else FITTED_ADDITIONS // 2]:
        if o.gain < MIN_SCREEN_GAIN_NATS:
            continue
        if search_is_over():
            break
        starts = o.starts if has_several_maxima(scene) else [o.start]
        begun = [ScenePoint((*base.point.placed, s), base.point.unknowns) for s in starts]
        least = max(base.value + cost_of(o.start, every), highest - _far_below(highest - base.value))
        fit = _itself(scene, fitted_from(scene, begun, base, least))
        highest = max(highest, fit.value)
        if not _blind(base, fit) and not unreached(scene, fit):
            trials.append(FittedAddition(fit.point.placed[-1], fit, 0.0, 0.0, o.direction))
    reference, found = evidence(scene, base), []
    for t, share in zip(trials, _even_shares(scene, base, trials)):
        cost = cost_of(t.placed, every)
        gain = evidence(scene, t.fit) - reference - cost
        gain -= (1.0 - share) * max(t.fit.value - base.value, 0.0)
        found.append(replace(t, gain=gain, cost=cost, even_share=share))
    by_gain = sorted(found, key=lambda t: -t.gain)
    return likeliest_first(_weighed_about_themselves(scene, by_gain, known))


def _far_below(gain: float) -> float:
    """How far below an addition of such a gain others are beyond competition, though it be made smaller by misfit [nats]."""
    return max(FAR_BELOW_NATS, 0.5 * gain)


def _even_shares(scene: Scene, base: SceneFit, trials: Sequence[FittedAddition]) -> list[float]:
    """Of the evidence of each trial, what is no misfit that is larger at some times than at others; all where none is left.

    Trials that resemble each other have the share of the best of them: the same readings speak for them.
    """
    if not isinstance(scene, TemperedScene):
        return [1.0] * len(trials)
    wider = [unevenness_of_effect(scene, t.fit, base, len(t.fit.point.placed) - 1) for t in trials]
    return [
        1.0
        / min(
            w for w, o in zip(wider, trials) if o is t or cos2(o.direction, t.direction) > RESEMBLING_MIN_COS2
        )
        for t in trials
    ]


def _weighed_about_themselves(
    scene: Scene, trials: Sequence[FittedAddition], known: FittedAddition | None
) -> list[FittedAddition]:
    """Trials of a world that is linear about a point, the best of them by the evidence of the world about their fit."""
    best = trials[0].gain if trials else 0.0
    far = max(MIN_FAR_GAIN_NATS, MIN_FAR_SHARE * best)
    if not isinstance(scene, Linearised) or best < MIN_FAR_GAIN_NATS:
        return list(trials)
    out = list(trials)
    for i, t in enumerate(trials[:FAR_ADDITIONS]):
        own = known is not None and t.fit is known.fit
        if t.gain > far and not own and not search_is_over():
            there, fit = relinearised(scene, t.fit, FAR_ROUNDS)
            more = evidence_over_widths(there, fit) - evidence_over_widths(scene, t.fit)
            out[i] = replace(t, gain=t.gain + t.even_share * more, about=(there, fit))
    return out


def cos2(a: Array, b: Array) -> float:
    """Squared cosine between two directions, shape (N,); zero where one is none."""
    power = float((a @ a) * (b @ b))
    return float((a @ b) ** 2) / power if power > 0.0 else 0.0


def cost_of(placed: Placed, every: Sequence[Placed]) -> float:
    """Nats that an addition costs: the logarithm of its share of what might be missing, and of the ways to write it.

    Something is missing as likely as not; of all effects at all places one that is rarer by so many nats has a smaller
    share, and leaves the others a larger one. Without the ways a matrix would be likelier the more of its entries and
    rows are tried.

    Parameters
    ----------
    placed : Placed
    every : sequence of Placed
        All that might be missing, itself among them.
    """
    penalties: dict[Label, float] = {}
    for p in every:
        label = p.effect.name, p.where
        penalties[label] = min(penalties.get(label, np.inf), _penalty(p))
    ways = sum((p.effect.name, p.where) == (placed.effect.name, placed.where) for p in every)
    whole = 1.0 + float(np.exp(-np.array(list(penalties.values()))).sum())
    return float(np.log(whole * max(ways, 1))) + _penalty(placed)


def _penalty(placed: Placed) -> float:
    """By which an effect at its place is rarer than others [nats]."""
    return placed.effect.rarer_by_nats() + placed.prior_penalty_nats


def _alike(a: Placed, b: Placed) -> bool:
    """Whether two additions are the same but for their values: of a span, another span."""
    spans = [float(getattr(x.effect, "duration", 0.0)) > 0.0 for x in (a, b)]
    names = [{p.name for p in free(x.effect)} for x in (a, b)]
    same = type(a.effect) is type(b.effect) and a.where == b.where
    return same and spans[0] == spans[1] and names[0] == names[1]


def _blind(base: SceneFit, fit: SceneFit) -> bool:
    """Whether the data no longer say what they said of the unknowns: there the simulation has diverged."""
    count = base.point.unknowns.size
    if not np.isfinite(fit.information).all():
        return True
    before, after = (np.diag(f.information)[f.information.shape[0] - count :] for f in (base, fit))
    return bool((after < DIVERGED_MAX_INFORMATION_SHARE * before).any())


def _itself(scene: Scene, fit: SceneFit) -> SceneFit:
    """A fit whose last effect keeps to times with which it is itself: one beyond is held at the nearest."""
    last = fit.point.placed[-1]
    if last.effect.name not in TIME_LIMITS or last.held:
        return fit
    lo, hi = time_limits(scene, last.effect.name)
    times = {p.name: float(getattr(last.effect, p.name)) for p in free(last.effect) if p.kind == "time"}
    if not any(t > hi or t < lo for t in times.values()):
        return fit
    nearest = {n: min(max(t, lo), hi) for n, t in times.items()}
    held = replace(last, effect=replace(last.effect, **nearest), held=tuple(times))
    return fitted(scene, ScenePoint((*fit.point.placed[:-1], held), fit.point.unknowns))
