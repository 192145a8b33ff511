"""Effects looked for again with what the best explanation leaves in the noise, see `kfgen.gap.scene.tempered_scene`."""

from __future__ import annotations

from dataclasses import replace

from kfgen.core.time_budget import search_is_over
from kfgen.gap.core.search import Label, Refused
from kfgen.gap.scene.assumed_parameters import Answered
from kfgen.gap.scene.explanation import Explained, explained
from kfgen.gap.scene.newton import fitted
from kfgen.gap.scene.scene import HasNoiseSizes, Linearised, ReadingByReading
from kfgen.gap.scene.tempered_scene import TemperedScene, tempered

MAX_SEARCHES = 3
"""With the misfit that the one before left."""
RESTS_ON_MISFIT = "it explains no more than what is left unexplained could"
"""Why an effect is not added that was found as long as that was no noise."""


def under_misfit(answer: Answered) -> Answered:
    """The answer of a search in which the misfit of the one before is noise, until both name the same.

    Parameters
    ----------
    answer : Answered
        Whose updated model fails its tests.
    """
    if isinstance(answer.scene, ReadingByReading):
        return answer  # its residuals have no spectrum
    for _ in range(MAX_SEARCHES):
        if search_is_over():
            break
        before = _labels(answer)
        again = explained(_with_misfit(answer))
        there = again.scene
        assert isinstance(there, TemperedScene)  # what is looked for in one is found in one
        refused = _refused(answer, again)
        found = replace(again, assumed=answer.found.assumed, scene=there.scene, refused=refused)
        answer = Answered(there.scene, answer.written, found, there)
        if _labels(answer) == before:
            break
    return answer


def _with_misfit(answer: Answered) -> TemperedScene:
    """The scene in which effects are looked for again: noises of the sizes that the log asks for, then the misfit in them."""
    scene, fit = answer.scene, answer.fit
    start = answer.written if isinstance(scene, Linearised) else scene
    if isinstance(scene, HasNoiseSizes):
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
