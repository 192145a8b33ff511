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
from kfgen.gap.core.search import (
    Chosen,
    Contest,
    Distinguishability,
    Label,
    Refused,
    grown,
    probabilities,
    refused_of,
    searched,
    settled,
    worth,
)
from kfgen.gap.core.thresholds import SearchLimits
from kfgen.gap.core.unseen import MAX_UNSEEN_LOSS_NATS
from kfgen.gap.scene.addition import RESEMBLING_MIN_COS2, FittedAddition, cos2, cost_of, ranked, relinearised
from kfgen.gap.scene.evidence import evidence, evidence_over_widths
from kfgen.gap.scene.newton import SceneFit, fitted, fitted_from
from kfgen.gap.scene.proof import unproven
from kfgen.gap.scene.rival import log_odds
from kfgen.gap.scene.scene import Linearised, Placed, Scene, ScenePoint, start_of
from kfgen.gap.scene.screen import Screened, basis, orthogonal_part, screen
from kfgen.gap.scene.tempered_scene import TemperedScene

Array = NDArray[np.float64]

LIMITS = SearchLimits(max_effects=10)
LIMITS_UNDER_MISFIT = replace(LIMITS, max_effects=4, max_iterations=1)
"""While more is there than noise: a longer list explains a misfit, and took more than nine minutes of two real logs of three."""
UNRIVALLED_EVIDENCE_NATS = 20.0
"""Evidence of an effect that nothing else resembles, with which it is not put to the test again."""
NEARLY_THE_SAME_MIN_COS2 = 0.9
"""Share cos^2 of a direction from which on two effects differ by little more than what their models leave out."""
SHARE_OF_EVIDENCE_LEFT_OUT = 0.001
"""Of the evidence of an effect, what a rival that is nearly the same may gain or lose by what the models of both leave out.
A delay of 32 ms in place of a pole of 5 Hz: from 9 nats better to 9 worse in five simulated logs of 7 500 nats."""


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
    is_contradicted = False

    @cached_property
    def others(self) -> list[Screened]:
        """What could be added, by its linear gain."""
        return screen(self.scene, self.fit)

    def ranked(self) -> list[FittedAddition]:
        """What could be added, by evidence, the best first."""
        return ranked(self.scene, self.fit, self.others)

    def objection(self, addition: FittedAddition, likelier: Sequence[FittedAddition]) -> str:
        """Why an addition is not to be added, see `kfgen.gap.scene.proof`."""
        alike = any(cos2(addition.direction, o.direction) > RESEMBLING_MIN_COS2 for o in likelier)
        return unproven(self.scene, self.fit, addition.fit, 0.0 if alike else MAX_UNSEEN_LOSS_NATS)

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
        chosen = (*self.chosen, _chosen(self.scene, replace(addition, about=None), ranked))
        scene, fit = addition.about or (self.scene, addition.fit)
        if isinstance(scene, Linearised):
            scene, fit = relinearised(scene, fit)
        else:  # a trial's maximum is coarse
            fit = fitted(scene, fit.point, fit.steps)
        return SceneExplanation(scene, fit, with_values(chosen, fit), self.refused)

    def merged(self, addition: FittedAddition) -> SceneExplanation | None:
        """Nothing: no two effects of a scene are a third."""
        return None

    def moved(self, index: int) -> SceneExplanation:
        """With the last effect put at `index`."""
        *rest, last = self.chosen
        chosen = (*rest[:index], last, *rest[index:])
        return SceneExplanation(self.scene, _last(self.fit, index, back=True), chosen, self.refused)

    @property
    def evidence(self) -> float:
        """Of all that was chosen [nats]."""
        return worth(self)

    def doubts(self) -> list[bool]:
        """Of each effect, whether it may be something else, or nothing beside those that were added since.

        None of them where time ended: to judge them anew takes as long as the search.
        """
        return [not search_is_over() and _doubtful(self, i) for i in range(len(self.chosen))]

    def without(self, index: int) -> SceneExplanation:
        """The scene without an effect, all others fitted again.

        What made up for it in the unknowns may lead astray without it: where they began may be a better start.
        """
        placed = tuple(p for i, p in enumerate(self.fit.point.placed) if i != index)
        begun = [self.fit.point.unknowns, start_of(self.scene).unknowns]
        fit = fitted_from(self.scene, [ScenePoint(placed, x) for x in begun], self.fit)
        left = self.chosen[:index] + self.chosen[index + 1 :]
        return SceneExplanation(self.scene, fit, with_values(left, fit), self.refused)

    def contest(self, index: int) -> Contest[SceneExplanation, FittedAddition] | None:
        """The scene without an effect, and what could stand in its place; the effect itself keeps its fit.

        None where time ended before all were fitted: what was not would have no share, and the effect be certain.
        """
        if search_is_over():
            return None
        rest, same = self.without(index), _last(self.fit, index)
        known = replace(self.chosen[index].addition, placed=same.point.placed[-1], fit=same)
        trials = ranked(self.scene, rest.fit, rest.others, known)
        if search_is_over():
            return None
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


def explained(scene: Scene, limits: SearchLimits = LIMITS, together: Sequence[Placed] = ()) -> Explained:
    """Add what has evidence, take out what a later addition makes superfluous, until nothing changes.

    Parameters
    ----------
    scene : Scene
    limits : SearchLimits
    together : sequence of Placed
        What is there before anything is looked for, as far as it has evidence: one by one, others would stand in for it.
    """
    assumed = fitted(scene, start_of(scene))
    found = searched(_begun_with(SceneExplanation(scene, assumed), together, limits), limits)
    return Explained(assumed, found.chosen, found.fit, found.scene, refused_of(found))


def _begun_with(
    nothing: SceneExplanation, together: Sequence[Placed], limits: SearchLimits
) -> SceneExplanation:
    """With those of some effects that have evidence beside the others."""
    scene, placed = nothing.scene, tuple(together)
    while placed:
        fit = fitted(scene, ScenePoint(placed, nothing.fit.point.unknowns))
        every, whole = [starts[0] for starts in scene.candidates(())], evidence(scene, fit)
        chosen = []
        for i, p in enumerate(fit.point.placed):
            rest = fitted(scene, ScenePoint((*placed[:i], *placed[i + 1 :]), fit.point.unknowns))
            column = next(c for c, (at, _) in enumerate(fit.keys) if at == i)
            cost = cost_of(p, every)
            gain = whole - evidence(scene, rest) - cost
            own = FittedAddition(p, fit, gain, cost, fit.jacobian[:, column])
            chosen.append(Chosen(own, probabilities([own])))
        least = min(range(len(chosen)), key=lambda i: chosen[i].gain)
        if chosen[least].gain >= limits.min_evidence_nats:
            return replace(nothing, fit=fit, chosen=tuple(chosen))
        placed = (*placed[:least], *placed[least + 1 :])
    return nothing


def completed(found: Explained, *, grow: bool) -> Explained:
    """What was found by a search that was cut short: each effect judged anew beside the others.

    Parameters
    ----------
    found : Explained
    grow : bool
        Whether more may have evidence.
    """
    there = SceneExplanation(found.scene, found.fit, found.added, found.refused)
    end = settled(grown(there, LIMITS) if grow else there, LIMITS)
    return Explained(found.assumed, end.chosen, end.fit, end.scene, refused_of(end))


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


def evidence_of_all(scene: Scene, fit: SceneFit, named: Sequence[Chosen[FittedAddition]] = ()) -> float:
    """Evidence of a fit with everything that it names, up to a constant of the log [nats].

    Parameters
    ----------
    scene : Scene
    fit : SceneFit
        Of that scene.
    named : sequence of Chosen
        Its effects, each of which costs what choosing it did.
    """
    return evidence_over_widths(scene, fit) - sum(a.addition.cost for a in named)


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


def _chosen(scene: Scene, best: FittedAddition, trials: Sequence[FittedAddition]) -> Chosen[FittedAddition]:
    """With the probabilities of all trials."""
    alike: dict[Label, float] = {}
    weighed = []
    for t in trials:
        share = cos2(best.direction, t.direction)
        lost = best.gain - t.gain
        if share > NEARLY_THE_SAME_MIN_COS2 and lost > 0.0:
            lost /= 1.0 + SHARE_OF_EVIDENCE_LEFT_OUT * max(best.gain, 0.0)
        if share > RESEMBLING_MIN_COS2 and isinstance(scene, TemperedScene) and t.about is best.about is None:
            lost = log_odds(scene, best.fit, t.fit, lost)
        weighed.append(replace(t, gain=best.gain - lost))
        if t is not best:
            alike[t.label] = max(alike.get(t.label, 0.0), share)
    others = tuple(Distinguishability(*label, cos2) for label, cos2 in alike.items())
    return Chosen(best, probabilities(weighed), others)
