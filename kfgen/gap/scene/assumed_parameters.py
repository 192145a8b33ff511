"""A model as it is written: numbers that the data move far from what is assumed about them are in question.

A number with a standard deviation is fitted beside the effects, and would take up a gap in silence. One that is
moved too far is held at what is assumed about it, and its error competes with every other explanation; where that is
not needed, the number is given its freedom back.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from kfgen.core.errors import InputError
from kfgen.core.time_budget import search_is_over, time_budget
from kfgen.effects.plant.terms import ParameterError
from kfgen.gap.core.search import Chosen
from kfgen.gap.core.thresholds import MAX_ITERATIONS, SearchLimits
from kfgen.gap.scene.addition import FittedAddition
from kfgen.gap.scene.explanation import (
    LIMITS,
    LIMITS_UNDER_MISFIT,
    Explained,
    completed,
    explained,
    with_values,
)
from kfgen.gap.scene.newton import SceneFit, fitted
from kfgen.gap.scene.random_error import HasRandomErrors, NamedRandomError
from kfgen.gap.scene.scene import InPieces, Placed, Scene, ScenePoint, Trusting, start_of
from kfgen.gap.scene.tempered_scene import TemperedScene

MIN_SHARE_OF_NOISE = 0.05
"""Of the evidence of a random error alone, that an effect must have to be looked for before it."""
MAX_LEFT_TIMES = 2.0
"""Sum of squares that may be left with numbers given back their freedom, by that with them held: more of it is a fit that
went astray."""
SHORT_LIMITS = replace(LIMITS_UNDER_MISFIT, max_iterations=0)
"""Of a first look at a world: a list that passes its tests is gone through again, see `complete`; as long as more is there, what
is added to it explains a misfit. Of a propeller's log a longer list took nine times as long."""
FIRST_LIMITS = replace(SHORT_LIMITS, min_first_evidence_nats=0.0, first_counts_rivals=True)
"""Of a world that has random errors: beyond, one of these is likelier than a long list, and all is looked for again. Its
candidates are many, so that all together were 2.9 nats below nothing or more in six flights without an effect, and the
best of 38 others was 1.9 nats below it: where one of them is likelier than nothing, the best is named."""
FOLLOWED_MAX_SHARE = 0.1
"""Share of the power of a log that one simulation over all of it leaves where it follows it."""


@dataclass(frozen=True)
class Answered:
    """A scene explained.

    Parameters
    ----------
    scene : Scene
        In which the explanation holds.
    written : Scene
        With every number in question as it is written.
    found : Explained
    tempered : TemperedScene, optional
        The same scene with the misfit in its noise, in which all was found; None where there is none.
    random_errors : tuple of NamedRandomError
        Random errors that are in its noise.
    resized : Scene, optional
        As it is written but for the noise of inputs; None where that is as assumed.
    """

    scene: Scene
    written: Scene
    found: Explained
    tempered: TemperedScene | None = None
    random_errors: tuple[NamedRandomError, ...] = ()
    resized: Scene | None = None

    @property
    def start(self) -> Scene:
        """In which nothing is added yet."""
        return self.written if self.resized is None else self.resized

    @property
    def likelihood(self) -> Scene:
        """The scene by whose noise effects were weighed."""
        return self.scene if self.tempered is None else self.tempered

    @property
    def fit(self) -> SceneFit:
        """With all that was found, residuals in standard deviations of the noise that is assumed."""
        return self.found.fit if self.tempered is None else self.tempered.untempered(self.found.fit)


def answered(scene: Scene, *, noise_first: bool = True) -> Answered:
    """Explain a scene, the numbers in question as they are written.

    One in pieces is explained in one piece, if a fit gets there; where one simulation then follows the log no better than
    that, also as it is: pieces are followed from nearly everywhere, and lose what acts slowly.

    Parameters
    ----------
    scene : Scene
    noise_first : bool
        Whether noise that explains far more than any effect is left to be looked at before a list of effects grows.
    """
    whole = scene.in_one_piece() if isinstance(scene, InPieces) else None
    if not isinstance(whole, InPieces) or not isinstance(scene, InPieces):
        return _answered(scene, noise_first=noise_first)
    with time_budget(parts=2):
        again = _answered(whole, noise_first=noise_first)
    left = whole.free_run(again.fit.point)
    if left < FOLLOWED_MAX_SHARE:
        return again
    found = _answered(scene, noise_first=noise_first)
    return found if scene.free_run(found.fit.point) <= left else again


def _answered(scene: Scene, *, noise_first: bool) -> Answered:
    """The same of a scene as it is cut."""
    if not isinstance(scene, Trusting):
        plain = explained(scene, FIRST_LIMITS if isinstance(scene, HasRandomErrors) else SHORT_LIMITS)
        return Answered(plain.scene, scene, plain)
    # A start that a whole log moves far is mostly a sign of something else, and takes up little of it.
    starts, refuted = {u.own for u in scene.unknowns if u.once}, scene.refuted()
    wrong = (moved_far(scene, fitted(scene, start_of(scene)).point) - starts) | {p.where for p in refuted}
    here: Scene = scene.held(wrong) if wrong else scene
    found = _explained_beside(here, refuted, noise_first=noise_first)
    for _ in range(MAX_ITERATIONS - 1):
        more = moved_far(here, found.fit.point)
        if not more or search_is_over():
            break
        try:
            here = scene.held(wrong | more)
        except InputError:  # no simulation follows the log with all of them as assumed: they stay free
            break
        wrong |= more
        found = _explained_beside(here, refuted, noise_first=noise_first)
    far = {u.own: u.far * u.sd for u in scene.unknowns if u.own}
    named = {
        a.addition.placed.where
        for a in found.added
        if _is_error(a)
        and abs(float(getattr(a.addition.placed.effect, "value", 0.0)))
        > far.get(a.addition.placed.where, 0.0)
    }
    if wrong <= named:
        return Answered(here, here, found)
    free = scene.held(wrong & named)
    kept = [a for a in found.added if not (_is_error(a) and a.addition.placed.where in wrong - named)]
    fit = fitted(free, ScenePoint(tuple(a.addition.placed for a in kept), start_of(free).unknowns))
    if not np.sum(fit.residual**2) <= MAX_LEFT_TIMES * np.sum(found.fit.residual**2):
        return Answered(here, here, found)
    return Answered(free, here, Explained(found.assumed, with_values(kept, fit), fit, free, found.refused))


def _explained_beside(scene: Scene, refuted: Sequence[Placed], *, noise_first: bool) -> Explained:
    """The scene explained, with what is refuted before anything is looked for there from the beginning."""
    return explained(scene, _limits(scene) if noise_first else SHORT_LIMITS, together=refuted)


def complete(answer: Answered, *, grow: bool = False) -> Answered:
    """An answer whose list of effects is gone through again; a list that was cut short grows.

    Parameters
    ----------
    answer : Answered
    grow : bool
        Whether any list grows.
    """
    is_short = len(answer.found.added) >= SHORT_LIMITS.max_effects
    found = completed(answer.found, grow=grow or is_short)
    return replace(answer, scene=found.scene, found=found)


def _limits(scene: Scene) -> SearchLimits:
    """Of a search in which no effect is looked for before noise that explains far more."""
    if not isinstance(scene, HasRandomErrors):
        return SHORT_LIMITS
    likely = scene.likely_random_errors(fitted(scene, start_of(scene)).point)
    asked = MIN_SHARE_OF_NOISE * max((e.evidence for e in likely), default=0.0)
    return replace(SHORT_LIMITS, min_first_evidence_nats=max(LIMITS.min_first_evidence_nats, asked))


def _is_error(added: Chosen[FittedAddition]) -> bool:
    return isinstance(added.addition.placed.effect, ParameterError)


def moved_far(scene: Scene, point: ScenePoint) -> set[str]:
    """The numbers that a fit moved far from what is assumed about them.

    Parameters
    ----------
    scene : Scene
    point : ScenePoint
        Where a fit ended.
    """
    pairs = zip(scene.unknowns, point.unknowns.tolist())
    return {u.own for u, x in pairs if u.own and abs(x - u.value) > u.far * u.sd}
