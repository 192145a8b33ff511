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
from kfgen.gap.core.search import NO_EFFECT, Chosen, Label, Refused
from kfgen.gap.core.thresholds import TIE_NATS
from kfgen.gap.scene.addition import FittedAddition, relinearised
from kfgen.gap.scene.assumed_parameters import FIRST_LIMITS, Answered, complete
from kfgen.gap.scene.explanation import evidence_of_all, explained
from kfgen.gap.scene.newton import fitted
from kfgen.gap.scene.random_error import (
    FittedRandomError,
    HasInertialNoise,
    HasRandomErrors,
    NamedRandomError,
)
from kfgen.gap.scene.scene import HasNoiseSizes, Linearised, Scene, ScenePoint, carried

MAX_ROUNDS = 2
"""Times that random errors are added, and effects looked for again."""
MAX_RANDOM_ERRORS = 4
"""Random errors that are added at once."""
MIN_RANDOM_ERROR_NATS = 5.0
"""Evidence above which a random error is added: it takes up what nobody looked for as well."""
MIN_WORTH_SHARE = 0.5
"""Of the evidence of what was found, which random errors alone must have to be tried in its place; all of it where nothing is
left that effects beside them could explain."""
MIN_LEADING_SHARE = 0.5
"""Of the largest gain of an effect, that others have which stand beside it when random errors are looked for first."""
LEAVES_MORE = "with it more is left than noise"
"""Why a process noise is not named."""
DRIFTS = frozenset({"bias_step", "rate_ramp", "warm_up"})
"""Courses of time alone, which one course of a random error looks like."""


def with_inertial_noise(answer: Answered) -> Answered:
    """An answer, or the one with another noise of inputs, beside what was found or in its place, if the whole is likelier.

    Parameters
    ----------
    answer : Answered
    """
    best, assumed = answer, answer.found.assumed
    for _ in range(MAX_ROUNDS):
        before = best
        points = [
            before.found.fit.point,
            *([assumed.point] if before.resized is None and before.found.added else []),
        ]
        for point in points:
            scene = before.start
            resized = scene.with_inertial_noise(point) if isinstance(scene, HasInertialNoise) else scene
            if resized is scene or search_is_over():
                continue
            found = replace(explained(resized, FIRST_LIMITS), assumed=assumed)
            more = Answered(found.scene, answer.written, found, resized=resized)
            best = more if total(more) - total(best) > MIN_RANDOM_ERROR_NATS else best
        if best is before:
            break
    return best


def with_random_errors(answer: Answered, *, is_unfinished: bool) -> Answered:
    """An answer with the random errors for which there is evidence.

    Parameters
    ----------
    answer : Answered
    is_unfinished : bool
        Whether its updated model fails its tests: then noises have the sizes that the log asks for while it is looked at.
    """
    for _ in range(MAX_ROUNDS):
        if not isinstance(answer.scene, HasRandomErrors) or search_is_over():
            break
        count = len(answer.random_errors)
        beside = _beside(answer, is_unfinished)
        is_long = not count and len(answer.found.added) >= FIRST_LIMITS.max_effects
        if not beside.random_errors or is_long:
            share = MIN_WORTH_SHARE if is_unfinished else 1.0
            beside = max(beside, _instead(answer, share), key=total)
        answer = beside
        if len(answer.random_errors) == count:
            break
    before, answer = answer, _pruned(answer)
    if not answer.random_errors:
        answer = complete(answer, grow=answer is not before)
    # Last, for what judges effects anew knows nothing of the share of a random error in their place.
    for where in dict.fromkeys(a.label[1] for a in answer.found.added if a.name in DRIFTS):
        answer = _instead_of_drifts(answer, where)
    scene = answer.scene
    if not isinstance(scene, HasRandomErrors):
        return answer
    point = answer.fit.point
    judged = tuple(
        replace(w, objection=scene.not_random(w.fitted.placed, point)) for w in answer.random_errors
    )
    return replace(answer, random_errors=judged)


def refusing(answer: Answered, stand_ins: Sequence[NamedRandomError]) -> Answered:
    """An answer that remembers random errors that are none of it, since more is left with them.

    Parameters
    ----------
    answer : Answered
        Without them.
    stand_ins : sequence of NamedRandomError
    """
    refused = tuple(Refused(*w.fitted.label, w.gain, w.objection or LEAVES_MORE) for w in stand_ins)
    return replace(answer, found=replace(answer.found, refused=(*answer.found.refused, *refused)))


def _pruned(answer: Answered) -> Answered:
    """Without random errors that later ones, or effects, made idle."""
    is_beside = len(answer.random_errors) > 1 or bool(answer.found.added)
    for w in answer.random_errors if is_beside else ():
        scene = answer.start
        left = tuple(x for x in answer.random_errors if x is not w)
        assert isinstance(scene, HasRandomErrors)
        for x in left:
            scene = scene.with_random_error(x.fitted.placed)
        there = scene.about(answer.found.fit.point) if isinstance(scene, Linearised) else scene
        fit = fitted(there, carried(answer.found.fit.point, answer.scene, there))
        less = replace(
            answer, scene=there, found=replace(answer.found, fit=fit, scene=there), random_errors=left
        )
        if total(answer) - total(less) < MIN_RANDOM_ERROR_NATS:
            return _pruned(less)
    return answer


def _beside(answer: Answered, is_unfinished: bool) -> Answered:
    """With random errors beside what was found, where there is evidence for them."""
    if not is_unfinished:
        scene = answer.scene
        assert isinstance(scene, HasRandomErrors)
        return _better(answer, _gathered(scene, answer.fit.point), scene)
    leading, point = _leading(answer)
    changed = leading.with_noise_changes(point) if isinstance(leading, HasInertialNoise) else leading
    start = changed.tuned(point) if isinstance(changed, HasNoiseSizes) else changed
    assert isinstance(start, HasRandomErrors)
    return _better(answer, _gathered(start, point), start, is_another=changed is not leading)


def _leading(answer: Answered) -> tuple[Scene, ScenePoint]:
    """The scene about the effects that gained most, and these: the others may be what random errors look like."""
    gains = [a.gain for a in answer.found.added]
    kept = tuple(
        p
        for p, g in zip(answer.found.fit.point.placed, gains)
        if g >= MIN_LEADING_SHARE * max(gains, default=0.0)
    )
    point = ScenePoint(kept, answer.found.fit.point.unknowns)
    scene, fit = relinearised(answer.scene, fitted(answer.scene, point))
    return scene, fit.point


def _instead(answer: Answered, share: float) -> Answered:
    """With random errors in place of all that was found, where that is likelier: with such a share of its evidence it is tried."""
    start = answer.start
    if not answer.found.added or not isinstance(start, HasRandomErrors):
        return answer
    worth = total(answer) - evidence_of_all(start, answer.found.assumed)
    every = _gathered(start, answer.found.assumed.point)
    gained = sum(found[0].evidence for found in every)
    return _better(answer, every, start) if gained > share * worth else answer


def _instead_of_drifts(answer: Answered, where: str) -> Answered:
    """With one random error in place of all that is slow on a channel, where that is likelier; else it has its share.

    What a walk did is a ramp and a smaller random error beside it as well: the two stand against the one.
    """
    scene, there = answer.scene, answer.found.fit.point
    drifts = [a.name in DRIFTS and a.label[1] == where for a in answer.found.added]
    if search_is_over() or not any(drifts) or not isinstance(scene, HasRandomErrors):
        return answer
    others = tuple(w for w in answer.random_errors if w.fitted.placed.where != where)
    if len(others) < len(answer.random_errors):
        scene = scene.without_random_errors(where)
    kept = tuple(p for p, is_drift in zip(there.placed, drifts) if not is_drift)
    fit = fitted(scene, carried(ScenePoint(kept, there.unknowns), answer.scene, scene))
    likely = [f for f in scene.likely_random_errors(fit.point) if f.placed.where == where]
    gained = sum(a.gain for a, is_drift in zip(answer.found.added, drifts) if is_drift)
    if not likely or likely[0].evidence < MIN_WORTH_SHARE * gained:
        return answer
    return _better(answer, [likely], scene, beside=others)


def _gathered(scene: HasRandomErrors, point: ScenePoint) -> list[list[FittedRandomError]]:
    """Random errors beside the effects of a point, one after the other, and what competed with each."""
    every: list[list[FittedRandomError]] = []
    first = scene
    for _ in range(MAX_RANDOM_ERRORS):
        point = carried(point, first, scene)
        first = scene
        there = scene.about(point) if isinstance(scene, Linearised) else scene
        assert isinstance(there, HasRandomErrors)
        found = there.likely_random_errors(point)
        if not found or found[0].evidence < MIN_RANDOM_ERROR_NATS or search_is_over():
            break
        every.append(found)
        scene = scene.with_random_error(found[0].placed)
    return every


def _better(
    answer: Answered,
    every: Sequence[Sequence[FittedRandomError]],
    scene: HasRandomErrors,
    *,
    is_another: bool = False,
    beside: Sequence[NamedRandomError] | None = None,
) -> Answered:
    """The answer with the first of each list of random errors in the noise of a scene, if the whole is likelier.

    Without any the answer stays, unless the scene is another one by itself. They stand beside those that the scene has:
    all of the answer, unless others are given.
    """
    there = tuple(answer.random_errors if beside is None else beside)
    if not every and not is_another:
        return answer
    for found in every:
        scene = scene.with_random_error(found[0].placed)
    again = explained(scene)
    named = tuple(NamedRandomError(found[0], 0.0) for found in every)
    anew = replace(again, assumed=answer.found.assumed)
    more = replace(answer, scene=again.scene, found=anew, random_errors=(*there, *named))
    gain = total(more) - total(answer)
    lost = [a for a in answer.found.added if a.label not in {b.label for b in again.added}]
    if gain < (TIE_NATS if lost else MIN_RANDOM_ERROR_NATS):
        return _shared(answer, lost, named[0].fitted.label, gain) if named else answer
    rival = lost[0].label if lost else NO_EFFECT
    judged = []
    for of_one, w in zip(every, named):
        worth = {f.label: gain + f.evidence - of_one[0].evidence for f in of_one} | {rival: 0.0}
        judged.append(replace(w, gain=gain, probabilities=_shares(worth)))
    return replace(more, random_errors=(*there, *judged))


def _shared(answer: Answered, lost: Sequence[Chosen[FittedAddition]], label: Label, gain: float) -> Answered:
    """The answer whose probabilities know of a random error in place of some effects."""
    from scipy.special import expit

    share = float(expit(gain))
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
    named = evidence_of_all(answer.scene, answer.found.fit, answer.found.added)
    return named + sum(w.fitted.occam for w in answer.random_errors)
