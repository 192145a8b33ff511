"""Random errors in a scene: named where their course is as random as their name says, and only in the noise where it is not.

A random walk or a Gauss-Markov process takes up whatever is slow, and leaves white residuals whatever the cause was. So
every other effect is looked for first; a random error stands beside what was found, or in its place, by the evidence of the
whole; with it in the noise all effects are looked for again; and it is named if the course that it took passes as what it
claims to be.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from kfgen.core.time_budget import search_is_over
from kfgen.gap.core.search import NO_EFFECT, Chosen, Label
from kfgen.gap.core.thresholds import TIE_NATS
from kfgen.gap.scene.assumed_parameters import Answered
from kfgen.gap.scene.evidence import evidence
from kfgen.gap.scene.explanation import FittedAddition, explained
from kfgen.gap.scene.newton import SceneFit, fitted
from kfgen.gap.scene.random_error import FittedRandomError, HasRandomErrors, NamedRandomError
from kfgen.gap.scene.scene import HasNoiseSizes, Linearised, Scene

MAX_RANDOM_ERRORS = 3
"""Random errors that are added."""
MIN_RANDOM_ERROR_NATS = 5.0
"""Evidence above which a random error is added: it takes up what nobody looked for as well."""
MIN_WORTH_SHARE = 0.5
"""Of the evidence of what was found, which random errors alone must have to be tried in its place."""


def with_random_errors(answer: Answered, *, is_unfinished: bool) -> Answered:
    """An answer with the random errors for which there is evidence.

    Parameters
    ----------
    answer : Answered
    is_unfinished : bool
        Whether its updated model fails its tests: then noises have the sizes that the log asks for while it is looked at.
    """
    for _ in range(MAX_RANDOM_ERRORS):
        scene = answer.scene
        if not isinstance(scene, HasRandomErrors) or search_is_over():
            break
        count = len(answer.random_errors)
        answer = _beside(answer, is_unfinished)
        if not answer.random_errors:
            answer = _instead(answer)
        if len(answer.random_errors) == count:
            break
    answer = _pruned(answer)
    scene = answer.scene
    if not isinstance(scene, HasRandomErrors):
        return answer
    point = answer.fit.point
    judged = tuple(
        replace(w, objection=scene.not_random(w.fitted.placed, point)) for w in answer.random_errors
    )
    return replace(answer, random_errors=judged)


def _pruned(answer: Answered) -> Answered:
    """Without random errors that later ones made idle."""
    for w in answer.random_errors if len(answer.random_errors) > 1 else ():
        scene = answer.written
        left = tuple(x for x in answer.random_errors if x is not w)
        assert isinstance(scene, HasRandomErrors)
        for x in left:
            scene = scene.with_random_error(x.fitted.placed)
        there = scene.about(answer.found.fit.point) if isinstance(scene, Linearised) else scene
        fit = fitted(there, answer.found.fit.point)
        less = replace(
            answer, scene=there, found=replace(answer.found, fit=fit, scene=there), random_errors=left
        )
        if total(answer) - total(less) < MIN_RANDOM_ERROR_NATS:
            return _pruned(less)
    return answer


def _beside(answer: Answered, is_unfinished: bool) -> Answered:
    """With a random error beside what was found, where there is evidence for one."""
    scene = answer.scene
    assert isinstance(scene, HasRandomErrors)
    if is_unfinished:
        sized = scene.tuned(answer.fit.point)
        scene = sized.about(answer.fit.point) if isinstance(sized, Linearised) else sized
    assert isinstance(scene, HasRandomErrors)
    found = scene.likely_random_errors(answer.fit.point)
    return _better(answer, [found]) if found and found[0].evidence > MIN_RANDOM_ERROR_NATS else answer


def _instead(answer: Answered) -> Answered:
    """With random errors in place of all that was found, where that is likelier."""
    written = answer.written
    if not answer.found.added or not isinstance(written, HasRandomErrors):
        return answer
    nothing = answer.found.assumed.point
    worth = total(answer) - _evidence(written, answer.found.assumed)
    scene, every, gained = written, [], 0.0
    for _ in range(MAX_RANDOM_ERRORS):
        there = scene.about(nothing) if isinstance(scene, Linearised) else scene
        assert isinstance(there, HasRandomErrors)
        found = there.likely_random_errors(nothing)
        if not found or found[0].evidence < MIN_RANDOM_ERROR_NATS:
            break
        every.append(found)
        gained += found[0].evidence
        scene = scene.with_random_error(found[0].placed)
    return _better(answer, every) if gained > MIN_WORTH_SHARE * worth else answer


def _better(answer: Answered, every: Sequence[Sequence[FittedRandomError]]) -> Answered:
    """The answer with the first of each list of random errors in its noise, if the whole is likelier."""
    scene = answer.scene
    if not every or not isinstance(scene, HasRandomErrors):
        return answer
    for found in every:
        scene = scene.with_random_error(found[0].placed)
    again = explained(scene)
    named = tuple(NamedRandomError(found[0], 0.0) for found in every)
    anew = replace(again, assumed=answer.found.assumed)
    more = replace(answer, scene=again.scene, found=anew, random_errors=(*answer.random_errors, *named))
    gain = total(more) - total(answer)
    lost = [a for a in answer.found.added if a.label not in {b.label for b in again.added}]
    if gain < (TIE_NATS if lost else MIN_RANDOM_ERROR_NATS):
        return _shared(answer, lost, named[0].fitted.label, gain)
    rival = lost[0].label if lost else NO_EFFECT
    judged = []
    for of_one, w in zip(every, named):
        worth = {f.label: gain + f.evidence - of_one[0].evidence for f in of_one} | {rival: 0.0}
        judged.append(replace(w, gain=gain, probabilities=_shares(worth)))
    return replace(more, random_errors=(*answer.random_errors, *judged))


def _shared(answer: Answered, lost: Sequence[Chosen[FittedAddition]], label: Label, gain: float) -> Answered:
    """The answer whose probabilities know of a random error in place of some effects."""
    share = float(1.0 / (1.0 + np.exp(-gain)))
    added = tuple(
        replace(a, probabilities={k: p * (1.0 - share) for k, p in a.probabilities.items()} | {label: share})
        if any(a is x for x in lost)
        else a
        for a in answer.found.added
    )
    return replace(answer, found=replace(answer.found, added=added))


def _shares(worth: Mapping[Label, float]) -> dict[Label, float]:
    top = max(worth.values())
    weights = {label: float(np.exp(v - top)) for label, v in worth.items()}
    return {label: w / sum(weights.values()) for label, w in weights.items()}


def total(answer: Answered) -> float:
    """Evidence of an answer with everything that it names, up to a constant of the log [nats]."""
    named = answer.found.added
    ways = sum(float(np.log(max(len(a.probabilities), 2))) for a in named)
    return (
        _evidence(answer.scene, answer.found.fit) - ways + sum(w.fitted.occam for w in answer.random_errors)
    )


def _evidence(scene: Scene, fit: SceneFit) -> float:
    widths = float(scene.log_widths.sum()) if isinstance(scene, HasNoiseSizes) else 0.0
    return evidence(scene, fit) - widths
