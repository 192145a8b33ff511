"""A scene as the search sees it: screen every addition, fit the promising ones, weigh them by their evidence.

The currency is that of `kfgen.gap.rest.evidence`: marginal likelihood by Laplace's method with the same
priors. What is promising says the screen, see `kfgen.gap.scene.screen`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from kfgen.core.time_budget import search_is_over
from kfgen.effects.inertial.inertial_error import free
from kfgen.gap.core.search import (
    Chosen,
    Contest,
    Distinguishability,
    Label,
    Refused,
    probabilities,
    refused_of,
    searched,
)
from kfgen.gap.core.thresholds import SearchLimits
from kfgen.gap.rest.evidence import TIME_LIMITS
from kfgen.gap.scene.evidence import evidence, time_limits
from kfgen.gap.scene.newton import SceneFit, coordinates, fitted
from kfgen.gap.scene.proof import unproven, unreached
from kfgen.gap.scene.scene import HasNoiseSizes, Linearised, Placed, Scene, ScenePoint, start_of
from kfgen.gap.scene.screen import Screened, basis, orthogonal_part, screen
from kfgen.gap.scene.tempered_scene import TemperedScene
from kfgen.gap.scene.unevenness import unevenness_of_effect

Array = NDArray[np.float64]

LIMITS = SearchLimits(max_effects=10)
FITTED_ADDITIONS = 8
"""Additions that are fitted, the best of the screen."""
MIN_SCREEN_GAIN_NATS = 1.0
"""Linear gain below which an addition is not fitted."""
UNRIVALLED_EVIDENCE_NATS = 20.0
"""Evidence of an effect that nothing else resembles, with which it is not put to the test again."""
RESEMBLING_MIN_COS2 = 0.2
"""Share cos^2 of a direction from which on another addition might be what an effect is."""
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
    direction : ndarray, shape (N,)
        In which it moves the residuals most, as of `Screened`.
    """

    placed: Placed
    fit: SceneFit
    gain: float
    direction: Array

    @property
    def label(self) -> Label:
        """Effect and place."""
        return self.placed.effect.name, self.placed.where


@dataclass(frozen=True)
class SceneExplanation:
    """A scene with the effects that were added so far, and the fit with all of them.

    Parameters
    ----------
    scene : Scene
    fit : SceneFit
    chosen : tuple of Chosen
        In the order of the fit's effects.
    """

    scene: Scene
    fit: SceneFit
    chosen: tuple[Chosen[FittedAddition], ...] = ()
    refused: tuple[Refused, ...] = ()

    is_closed = False

    @cached_property
    def others(self) -> list[Screened]:
        """What could be added, by its linear gain."""
        return screen(self.scene, self.fit)

    def ranked(self) -> list[FittedAddition]:
        """What could be added, by evidence, the best first."""
        return ranked(self.scene, self.fit, self.others)

    def objection(self, addition: FittedAddition) -> str:
        """Why an addition is not to be added, see `kfgen.gap.scene.proof`."""
        return unproven(self.scene, self.fit, addition.fit)

    def refusing(self, refused: Sequence[Refused]) -> SceneExplanation:
        """With these remembered as not added."""
        return replace(self, refused=(*self.refused, *refused))

    def plus(self, addition: FittedAddition, ranked: Sequence[FittedAddition]) -> SceneExplanation:
        """With one more, at the end, out of what competed with it.

        Parameters
        ----------
        addition : FittedAddition
        ranked : sequence of FittedAddition
            All that competed, itself among them.
        """
        chosen = (*self.chosen, _chosen(addition, ranked))
        scene, fit = relinearised(self.scene, addition.fit)
        return SceneExplanation(scene, fit, with_values(chosen, fit), self.refused)

    def merged(self, addition: FittedAddition) -> SceneExplanation | None:
        """Nothing: no two effects of a scene are a third."""
        return None

    def moved(self, index: int) -> SceneExplanation:
        """With the last effect put at `index`."""
        *rest, last = self.chosen
        chosen = (*rest[:index], last, *rest[index:])
        return SceneExplanation(self.scene, _last(self.fit, index, back=True), chosen, self.refused)

    def doubts(self) -> list[bool]:
        """Of each effect, whether it may be something else, or nothing beside those that were added since."""
        return [_doubtful(self, i) for i in range(len(self.chosen))]

    def without(self, index: int) -> SceneExplanation:
        """The scene without an effect, all others fitted again."""
        placed = tuple(p for i, p in enumerate(self.fit.point.placed) if i != index)
        fit = fitted(self.scene, ScenePoint(placed, self.fit.point.unknowns))
        left = self.chosen[:index] + self.chosen[index + 1 :]
        return SceneExplanation(self.scene, fit, with_values(left, fit), self.refused)

    def contest(self, index: int) -> Contest[SceneExplanation, FittedAddition]:
        """The scene without an effect, and what could stand in its place; the effect itself keeps its fit."""
        rest, same = self.without(index), _last(self.fit, index)
        known = replace(self.chosen[index].addition, placed=same.point.placed[-1], fit=same)
        trials = ranked(self.scene, rest.fit, rest.others, known)
        return Contest(rest, trials, next((t for t in trials if t.fit is same), None))

    def absorbers_last(self) -> SceneExplanation | None:
        """Nothing: no effect of a scene absorbs others by chance."""
        return None

    def with_absorbers(self) -> SceneExplanation:
        """Itself: nothing was kept back."""
        return self


@dataclass(frozen=True)
class Explained:
    """A scene explained: the fit of what is assumed, the additions, the fit with them, the scene about it, what was refused."""

    assumed: SceneFit
    added: tuple[Chosen[FittedAddition], ...]
    fit: SceneFit
    scene: Scene
    refused: tuple[Refused, ...] = ()


def explained(scene: Scene, limits: SearchLimits = LIMITS) -> Explained:
    """Add what has evidence, take out what a later addition makes superfluous, until nothing changes.

    Parameters
    ----------
    scene : Scene
    limits : SearchLimits
    """
    assumed = fitted(scene, start_of(scene))
    found = searched(SceneExplanation(scene, assumed), limits)
    return Explained(assumed, found.chosen, found.fit, found.scene, refused_of(found))


def refitted(scene: Scene, found: Explained) -> Explained:
    """What was found, fitted again.

    Parameters
    ----------
    scene : Scene
        The same world under another noise.
    found : Explained
    """
    assumed = fitted(scene, start_of(scene))
    there, fit = relinearised(scene, fitted(scene, found.fit.point))
    return Explained(assumed, with_values(found.added, fit), fit, there)


def relinearised(scene: Scene, fit: SceneFit) -> tuple[Scene, SceneFit]:
    """A world that is linear about a point, about its fit, until the fit moves by less than a tenth of its standard deviation.

    Parameters
    ----------
    scene : Scene
    fit : SceneFit
        Of that scene.
    """
    for _ in range(MAX_LINEARISATIONS):
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


def evidence_of_all(scene: Scene, fit: SceneFit, named: Sequence[Chosen[FittedAddition]] = ()) -> float:
    """Evidence of a fit with everything that it names, up to a constant of the log [nats].

    Parameters
    ----------
    scene : Scene
    fit : SceneFit
        Of that scene.
    named : sequence of Chosen
        Its effects.
    """
    choice = sum(float(np.log(max(len(a.probabilities), 2))) for a in named)
    world = scene.scene if isinstance(scene, TemperedScene) else scene
    widths = float(world.log_widths.sum()) if isinstance(world, HasNoiseSizes) else 0.0
    return evidence(scene, fit) - choice - widths


def with_values(added: Sequence[Chosen[FittedAddition]], fit: SceneFit) -> tuple[Chosen[FittedAddition], ...]:
    """The additions with the values that they have in a fit of all of them.

    Parameters
    ----------
    added : sequence of Chosen
    fit : SceneFit
        With one effect for each, in order.
    """
    pairs = zip(added, fit.point.placed)
    return tuple(replace(a, addition=replace(a.addition, placed=p)) for a, p in pairs)


def _doubtful(found: SceneExplanation, index: int) -> bool:
    """Whether an effect may be something else, or nothing beside those that were added since."""
    if any(o.claims[index] > RESEMBLING_MIN_COS2 for o in found.others):
        return True
    fit = found.fit
    J = fit.jacobian
    mine = [c for c, (i, _) in enumerate(fit.keys) if i == index]
    unknowns = J[:, len(fit.keys) :]
    left = np.sum(orthogonal_part(J[:, mine], basis(unknowns)) ** 2, axis=0)
    alone = np.sum(orthogonal_part(J[:, mine], basis(np.delete(J, mine, axis=1))) ** 2, axis=0)
    kept = float((alone / np.maximum(left, 1e-300)).min(initial=1.0))
    return found.chosen[index].gain * kept < UNRIVALLED_EVIDENCE_NATS


def _last(fit: SceneFit, index: int, *, back: bool = False) -> SceneFit:
    """A fit with the effect at `index` put last; or the last one put there."""
    n = len(fit.point.placed)
    order = [*range(index), *range(index + 1, n), index]
    if back:
        order = [*range(index), n - 1, *range(index, n - 1)]
    place = {old: new for new, old in enumerate(order)}
    k = len(fit.keys)
    columns = sorted(range(k), key=lambda i: (place[fit.keys[i][0]], i))
    every = np.array([*columns, *range(k, fit.steps.size)], dtype=np.intp)
    return replace(
        fit,
        point=ScenePoint(tuple(fit.point.placed[i] for i in order), fit.point.unknowns),
        information=fit.information[np.ix_(every, every)],
        keys=tuple((place[fit.keys[i][0]], fit.keys[i][1]) for i in columns),
        steps=fit.steps[every],
        jacobian=fit.jacobian[:, every],
    )


def _chosen(best: FittedAddition, trials: Sequence[FittedAddition]) -> Chosen[FittedAddition]:
    alike: dict[Label, float] = {}
    for t in (t for t in trials if t is not best):
        alike[t.label] = max(alike.get(t.label, 0.0), _cos2(best.direction, t.direction))
    others = tuple(Distinguishability(*label, cos2) for label, cos2 in alike.items())
    return Chosen(best, probabilities(trials), others)


def _cos2(a: Array, b: Array) -> float:
    power = float((a @ a) * (b @ b))
    return float((a @ b) ** 2) / power if power > 0.0 else 0.0


def ranked(
    scene: Scene, base: SceneFit, others: Sequence[Screened], known: FittedAddition | None = None
) -> list[FittedAddition]:
    """The most promising additions, fitted, by evidence.

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
    reference = evidence(scene, base)
    trials = []
    if known is not None:
        gain = evidence(scene, known.fit) - reference - _cost(known.placed, every)
        gain -= _uneven_part(scene, base, known.fit)
        trials.append(replace(known, gain=gain))
    for o in others[: FITTED_ADDITIONS if known is None else FITTED_ADDITIONS // 2]:
        if o.gain < MIN_SCREEN_GAIN_NATS:
            continue
        if search_is_over():
            break
        fit = _itself(scene, fitted(scene, ScenePoint((*base.point.placed, o.start), base.point.unknowns)))
        if _blind(base, fit) or unreached(scene, fit):
            continue
        value = evidence(scene, fit) - reference - _cost(o.start, every) - _uneven_part(scene, base, fit)
        trials.append(FittedAddition(fit.point.placed[-1], fit, value, o.direction))
    return sorted(trials, key=lambda t: -t.gain)


def _uneven_part(scene: Scene, base: SceneFit, fit: SceneFit) -> float:
    """What of a gain a misfit gives that is larger at some times than at others [nats]; nothing where none is left."""
    if not isinstance(scene, TemperedScene):
        return 0.0
    wider = unevenness_of_effect(scene, fit, base, len(fit.point.placed) - 1)
    return (1.0 - 1.0 / wider) * max(fit.value - base.value, 0.0)


def _cost(placed: Placed, every: Sequence[Placed]) -> float:
    """Nats that an addition costs: every effect at every place is as likely, and nothing; so are the ways to write one.

    Else a matrix would be likelier the more of its entries and rows are tried, and what its classes say is rare.
    """
    labels = [(p.effect.name, p.where) for p in every]
    ways = labels.count((placed.effect.name, placed.where))
    return (
        float(np.log((len(set(labels)) + 1) * max(ways, 1)))
        + placed.effect.prior_penalty_nats
        + placed.prior_penalty_nats
    )


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
