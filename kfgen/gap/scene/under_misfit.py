"""Effects looked for again with what the best explanation leaves in the noise, see `kfgen.gap.scene.tempered_scene`."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from kfgen.core.channel_names import acts_on
from kfgen.core.time_budget import search_is_over
from kfgen.effects import Effect
from kfgen.gap.core.search import Label, Refused, refused_of
from kfgen.gap.core.thresholds import MIN_EVIDENCE_NATS
from kfgen.gap.rest.second_recording import happens_once
from kfgen.gap.scene.assumed_parameters import Answered
from kfgen.gap.scene.explanation import (
    LIMITS_UNDER_MISFIT,
    Explained,
    SceneExplanation,
    evidence_of_all,
    explained,
    refitted,
)
from kfgen.gap.scene.newton import SceneFit, fitted
from kfgen.gap.scene.proof import too_wide
from kfgen.gap.scene.scene import (
    HasNoiseSizes,
    Linearised,
    Placed,
    Reaching,
    ReadingByReading,
    Scene,
    coordinates,
    is_signed,
)
from kfgen.gap.scene.tempered_scene import TemperedScene, tempered
from kfgen.gap.scene.unevenness import scattered_deviations, unevenness_of_effect

Array = NDArray[np.float64]

MAX_SEARCHES = 3
"""With the misfit that the one before left."""
MIN_GAIN_SHARE_FROM_NOTHING = 0.5
"""Of what is left of the search before, which a search from nothing must gain."""
MAX_LEFT_RATIO_FROM_NOTHING = 2.0
"""Mismatch that it may leave, over what the one before leaves."""
RESTS_ON_MISFIT = "it explains no more than what is left unexplained could"
"""Why an effect is not added that was found as long as that was no noise."""
MIN_GAINED_TO_LEFT_RATIO = 5.0
"""Mismatch that an effect takes away over all that is left with it, from which on it does not rest on what is left."""
MIN_EVENT_TO_LEFT_RATIO = 1.0
"""The same of what happens once, from which on it stands out of the rest."""
MAX_INTERVAL_RATIO = 1000.0
"""Upper over lower end of a 95 % interval, from which on it says nothing of a time or a frequency."""
GROWS_UNSEEN = "the mismatch on held-out data grows with it"
"""Why an effect is not kept that had evidence."""
MIN_SHARE_BESIDE_MISFIT = 0.1
"""Of the mismatch of a channel, that an effect takes away there which is named beside what is not explained."""
TAKES_AWAY_LITTLE = (
    "it takes away less than a tenth of the mismatch of its channel, and more is left unexplained"
)
"""Why an effect is not added beside a misfit that is far larger than it."""
AMONG_OTHER_EVENTS = "it happens once, on a channel on which more happens that is not explained"
"""Why an event is not added beside a misfit."""


def under_misfit(answer: Answered) -> Answered:
    """The answer of a search in which the misfit of the one before is noise, until both name the same.

    Parameters
    ----------
    answer : Answered
        Whose updated model fails its tests.
    """
    if isinstance(answer.scene, ReadingByReading):
        return answer  # its residuals have no spectrum
    best, best_worth = answer, -np.inf
    for _ in range(MAX_SEARCHES):
        if search_is_over():
            break
        before = _labels(answer)
        there = _with_misfit(answer)
        again, worth = _searched_again(there, answer.found)
        scene = again.scene
        assert isinstance(scene, TemperedScene)  # what is looked for in one is found in one
        refused = _refused(answer, again)
        found = replace(again, assumed=answer.found.assumed, scene=scene.scene, refused=refused)
        answer = replace(answer, scene=scene.scene, found=found, tempered=scene)
        if worth > best_worth:
            best, best_worth = answer, worth
        if _labels(answer) == before:
            break
    return best


def _searched_again(there: TemperedScene, found: Explained) -> tuple[Explained, float]:
    """What is found from nothing, unless what was found before gains far more or leaves far less; and its worth [nats].

    In a search from nothing the first of several effects must be significant while the others are still missing, which
    few are: so what was found before stays a candidate.
    """
    kept = _determined(refitted(there, found))
    if found.added and search_is_over():
        return _worth(kept)
    anew = _determined(explained(there, LIMITS_UNDER_MISFIT))
    gains = anew[1] > MIN_GAIN_SHARE_FROM_NOTHING * kept[1]
    return _worth(anew if gains and not _leaves_more(anew[0], kept[0]) else kept)


def _leaves_more(one: Explained, other: Explained) -> bool:
    left = [_mismatch(e.scene, e.fit) for e in (one, other)]
    return left[0] > MAX_LEFT_RATIO_FROM_NOTHING * max(left[1], MIN_EVIDENCE_NATS)


def _worth(found: tuple[Explained, float]) -> tuple[Explained, float]:
    """With what everything is worth: evidence, and what it costs that the noise is louder."""
    there = found[0].scene
    louder = float(np.log(there.misfit).sum()) if isinstance(there, TemperedScene) else 0.0
    return found[0], evidence_of_all(there, found[0].assumed) + found[1] - louder


def without_events(answer: Answered, doubtful: Collection[str]) -> Answered:
    """The answer without what happens once on channels of which as much is unexplained: nobody can tell one from the other.

    Parameters
    ----------
    answer : Answered
    doubtful : collection of str
        Channels that fail their tests.
    """
    left = _explanation(answer)
    for index in reversed(range(len(left.chosen))):
        one = left.chosen[index]
        placed = one.addition.placed
        if _is_event(placed.effect) and any(acts_on(placed.where, c) for c in doubtful):
            rest = left.without(index)
            if _gained_to_left(left.scene, left.fit, rest.fit) < MIN_EVENT_TO_LEFT_RATIO:
                left = rest.refusing([Refused(*one.label, one.gain, AMONG_OTHER_EVENTS)])
    return _explained_by(answer, left)


def without_trifles(answer: Answered) -> Answered:
    """The answer without effects that take away hardly any of what their channels show beyond noise, the least one first.

    Where the residuals are many times the noise nearly every effect gains nats by chance. Of seven effects planted in
    recordings each took away 17 % or more of the mean square of its channel, of 16 names in the same recordings as they
    are none more than 7 %; the threshold was chosen on these.

    Parameters
    ----------
    answer : Answered
        Whose updated model fails its tests.
    """
    if isinstance(answer.scene, ReadingByReading | Linearised):
        return answer
    left = _explanation(answer)
    while left.chosen:
        before = [_mismatches(left.scene, left.without(i).fit) for i in range(len(left.chosen))]
        after = _mismatches(left.scene, left.fit)
        shares = [float(np.max((b - after) / np.maximum(b, MIN_EVIDENCE_NATS))) for b in before]
        least = int(np.argmin(shares))
        if shares[least] >= MIN_SHARE_BESIDE_MISFIT:
            break
        one = left.chosen[least]
        left = left.without(least).refusing([Refused(*one.label, one.gain, TAKES_AWAY_LITTLE)])
    return _explained_by(answer, left)


def _explains_most(scene: Scene, fit: SceneFit, without: SceneFit) -> bool:
    """Whether an effect takes away far more of the mismatch than all that is left with it."""
    return _gained_to_left(scene, fit, without) > MIN_GAINED_TO_LEFT_RATIO


def _gained_to_left(scene: Scene, fit: SceneFit, without: SceneFit) -> float:
    """Mismatch that an effect takes away, over all that is left with it."""
    before, left = (_mismatch(scene, f) for f in (without, fit))
    return (before - left) / max(left, MIN_EVIDENCE_NATS)


def _mismatch(scene: Scene, fit: SceneFit) -> float:
    """Of all channels together [nats]."""
    return float(_mismatches(scene, fit).sum())


def _mismatches(scene: Scene, fit: SceneFit) -> Array:
    """What a fit loses against one that knows the spectrum of what it leaves, by the noise that is assumed.

    Of each channel [nats], shape (channels,).
    """
    if isinstance(scene, TemperedScene):
        fit, scene = scene.untempered(fit), scene.scene
    louder = tempered(scene, fit).misfit
    lost = 0.5 * (louder**2 - 1.0) - np.log(louder)
    return np.array([part.sum() for part in np.split(lost, np.cumsum(scene.lengths)[:-1])])


def without_weakest(answer: Answered) -> Answered:
    """The answer without the effect that has the least evidence, because with all of them the held-out mismatch grows.

    Parameters
    ----------
    answer : Answered
        With an effect at least.
    """
    left = _explanation(answer)
    index = int(np.argmin([a.gain for a in left.chosen]))
    one = left.chosen[index]
    return _explained_by(answer, left.without(index).refusing([Refused(*one.label, one.gain, GROWS_UNSEEN)]))


def _explanation(answer: Answered) -> SceneExplanation:
    """In the scene by whose noise it was found."""
    found = answer.found
    return SceneExplanation(answer.likelihood, found.fit, found.added, found.refused)


def _explained_by(answer: Answered, left: SceneExplanation) -> Answered:
    found = replace(answer.found, added=left.chosen, fit=left.fit, refused=refused_of(left))
    return replace(answer, found=found)


def _is_event(effect: Effect) -> bool:
    """Whether an effect with its values begins at some time, or lasts for a while alone."""
    if hasattr(effect, "duration"):
        return float(effect.duration) > 0.0
    return happens_once(effect)


def _determined(found: Explained) -> tuple[Explained, float]:
    """Without effects that explain no more, beside the others, than the scatter of the log's blocks does by chance.

    Second what is left gains over nothing [nats]: its evidence in the share that is no scatter.
    """
    left, share = SceneExplanation(found.scene, found.fit, found.added, found.refused), 1.0
    while left.chosen:
        deviation = scattered_deviations(left.scene, left.fit)
        wide = [
            too_wide(left.scene, left.fit, i, deviation, MAX_INTERVAL_RATIO) or _unreached(left.scene, p)
            for i, p in enumerate(left.fit.point.placed)
        ]
        if any(wide):
            index = next(i for i, why in enumerate(wide) if why)
            lost = Refused(*left.chosen[index].label, left.chosen[index].gain, wide[index])
            left, share = left.without(index).refusing([lost]), 1.0
            continue
        rest = [left.without(i) for i in range(len(left.chosen))]
        gains = np.array([left.fit.value - r.fit.value for r in rest])
        nats = _nats_beside_others(left, rest, gains, deviation)
        weakest = int(np.argmin(nats))
        share = float(np.mean(np.minimum(nats / np.maximum(gains, MIN_EVIDENCE_NATS), 1.0)))
        if nats[weakest] >= MIN_EVIDENCE_NATS:
            break
        lost = Refused(*left.chosen[weakest].label, float(nats[weakest]), RESTS_ON_MISFIT)
        left, share = rest[weakest].refusing([lost]), 1.0
    nothing = evidence_of_all(left.scene, found.assumed)
    gained = share * (evidence_of_all(left.scene, left.fit, left.chosen) - nothing)
    if gained < 0.0:
        left, gained = SceneExplanation(left.scene, found.assumed, (), left.refused), 0.0
    return replace(found, added=left.chosen, fit=left.fit, refused=refused_of(left)), gained


def _unreached(scene: Scene, placed: Placed) -> str:
    """Why an effect is nothing that can be there, or hardly is; empty where it may be."""
    return scene.unreached(placed) if isinstance(scene, Reaching) else ""


def _nats_beside_others(
    left: SceneExplanation, rest: Sequence[SceneExplanation], gains: Array, deviation: Array
) -> Array:
    """What each effect explains beside all others by the scatter of blocks [nats], shape (effects,).

    By its best known number, or by its share as a whole, whichever is more: a fit without it may be far away. One that
    explains most of the mismatch does not rest on the rest of it, however few blocks show it (a single step).
    """
    wider = [
        1.0
        if _explains_most(left.scene, left.fit, r.fit)
        else unevenness_of_effect(left.scene, left.fit, r.fit, i)
        for i, r in enumerate(rest)
    ]
    return np.asarray(np.maximum(gains / np.array(wider), _nats_of_sizes(left.fit, deviation)))


def _nats_of_sizes(fit: SceneFit, deviation: Array) -> Array:
    """How far the best known number of each effect is from nothing [nats], shape (effects,).

    A number that is fitted in its logarithm is as far from nothing as one of that relative standard deviation.
    """
    x = coordinates(fit.point)
    sigmas = np.zeros(len(fit.point.placed))
    for k, (i, name) in enumerate(fit.keys):
        size = abs(x[k]) if is_signed(fit.point.placed[i].effect, name) else 1.0
        sigmas[i] = max(sigmas[i], size / max(float(deviation[k]), 1e-300))
    return np.asarray(0.5 * sigmas**2)


def _with_misfit(answer: Answered) -> TemperedScene:
    """The scene in which effects are looked for again: noises of the sizes that the log asks for, then the misfit in them.

    Beside random errors noises keep their sizes: what no random error explains would make those of the inputs so large and
    those of the aiding sensors so small that the filter follows these blindly.
    """
    scene, fit = answer.scene, answer.fit
    start = answer.written if isinstance(scene, Linearised) else scene
    if answer.random_errors:
        start = scene
    elif isinstance(scene, HasNoiseSizes):
        start = scene.tuned(fit.point)
        scene = start.about(fit.point) if isinstance(start, Linearised) else start
        fit = fitted(scene, fit.point)
    return replace(tempered(scene, fit), scene=start)


def _refused(before: Answered, after: Explained) -> tuple[Refused, ...]:
    """What was not added, in the search before or in this one, and what was added only as long as the misfit was no noise.

    An effect in whose place another name stands now is not lost.
    """
    named = {a.label for a in after.added}
    renamed = {where for _, where in named - _labels(before)}
    lost = [
        Refused(*a.label, a.gain, RESTS_ON_MISFIT) for a in before.found.added if a.label[1] not in renamed
    ]
    every = {(r.effect, r.where): r for r in (*lost, *before.found.refused, *after.refused)}
    return tuple(r for label, r in every.items() if label not in named)


def _labels(answer: Answered) -> set[Label]:
    return {a.label for a in answer.found.added}
