"""The search of every world: add what has most evidence, again, and take out what a later effect makes superfluous.

It knows nothing of spectra and residuals. A world is an `Explanation` that can rank what may be added to it, with
one effect more or one fewer; what it fits, and how it weighs evidence, is its own.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Generic, Protocol, Self, TypeVar

import numpy as np

from kfgen.core.time_budget import search_is_over
from kfgen.gap.core.thresholds import MIN_EVIDENCE_NATS, TIE_NATS, SearchLimits

MAX_GAIN_OF_PRUNING_NATS = 10.0
"""Evidence that a list may gain when what others make superfluous is removed from it."""

Label = tuple[str, str]
"""Effect and where it acts ("" where there is one channel)."""

NO_EFFECT: Label = ("none", "")


class Addition(Protocol):
    """An effect that could be added, fitted."""

    @property
    def label(self) -> Label:
        """Effect and place."""

    @property
    def gain(self) -> float:
        """Evidence over the explanation without it, less the cost of choosing it [nats]."""


A = TypeVar("A", bound=Addition)
E = TypeVar("E", bound="Explanation")  # type: ignore[type-arg]


@dataclass(frozen=True)
class Distinguishability:
    """How well a record tells another explanation from the effect that was named.

    Parameters
    ----------
    effect, where : str
        The other.
    cos2 : float
        Squared cosine between what the two do to this record: one where nothing distinguishes them.
    nats : float, optional
        By which this record is expected to distinguish them, where that was computed.
    """

    effect: str
    where: str
    cos2: float
    nats: float | None = None

    @property
    def record_factor(self) -> float | None:
        """How many times as long a record would distinguish them, if both are stationary; None where not computed."""
        return None if self.nats is None else max(1.0, MIN_EVIDENCE_NATS / max(self.nats, 1e-9))


@dataclass(frozen=True)
class Chosen(Generic[A]):
    """An effect that was added, and what competed for its place.

    Parameters
    ----------
    addition : Addition
    probabilities : mapping of Label to float
        Of everything that competed, `NO_EFFECT` among it.
    others : tuple of Distinguishability
        How far others are from it.
    """

    addition: A
    probabilities: Mapping[Label, float]
    others: tuple[Distinguishability, ...] = ()

    @property
    def label(self) -> Label:
        """Effect and place."""
        return self.addition.label

    @property
    def name(self) -> str:
        """Of the effect."""
        return self.addition.label[0]

    @property
    def gain(self) -> float:
        """Its evidence when it was added [nats]."""
        return self.addition.gain

    @property
    def probability(self) -> float:
        """Of the effect, among everything that competed."""
        return self.probabilities[self.label]

    @property
    def alternatives(self) -> tuple[tuple[str, str, float], ...]:
        """Effect, place and probability of everything else, the most probable first."""
        others = [(*label, p) for label, p in self.probabilities.items() if label != self.label]
        return tuple(sorted(others, key=lambda a: -a[2]))


@dataclass(frozen=True)
class Refused:
    """An effect that is not added in spite of its evidence.

    Parameters
    ----------
    effect, where : str
    evidence_nats : float
    why : str
    """

    effect: str
    where: str
    evidence_nats: float
    why: str


@dataclass(frozen=True)
class Contest(Generic[E, A]):
    """What could stand in the place of an effect.

    Parameters
    ----------
    rest : Explanation
        Without the effect.
    ranked : sequence of Addition
        What could be added to it, by evidence, the best first.
    own : Addition, optional
        The one of them that is the effect itself.
    """

    rest: E
    ranked: Sequence[A]
    own: A | None


class Explanation(Protocol[A]):
    """A record, what is assumed about it, and the effects that were added so far; never changed in place."""

    @property
    def chosen(self) -> Sequence[Chosen[A]]:
        """The effects that were added, in order."""

    @property
    def is_closed(self) -> bool:
        """Whether nothing more is to be added, for it would have no end."""

    @property
    def is_contradicted(self) -> bool:
        """Whether the record surely contradicts what is assumed, so that a first name is no false alarm of a gap."""

    @property
    def refused(self) -> Sequence[Refused]:
        """What was not added in spite of its evidence."""

    @property
    def evidence(self) -> float:
        """Of all that was chosen together, in whatever order, less the costs of choosing [nats]."""

    def ranked(self) -> Sequence[A]:
        """What could be added, by evidence, the best first."""

    def objection(self, addition: A, likelier: Sequence[A]) -> str:
        """Why an addition is not to be added in spite of its evidence, for it does not shrink the gap on data that its
        fit did not see; empty where it does, or where no data could show it.

        Parameters
        ----------
        addition : Addition
        likelier : sequence of Addition
            Those of more evidence that were refused: what resembles one of them must gain, lest it stand in its place.
        """

    def refusing(self, refused: Sequence[Refused]) -> Self:
        """With these remembered as not added."""

    def plus(self, addition: A, ranked: Sequence[A]) -> Self:
        """With one more, at the end, out of what competed with it.

        Parameters
        ----------
        addition : Addition
        ranked : sequence of Addition
            All that competed, itself among them.
        """

    def merged(self, addition: A) -> Self | None:
        """With the addition and an effect that is there already as one effect of another name, if that is worth more."""

    def moved(self, index: int) -> Self:
        """With the last effect put at `index`."""

    def doubts(self) -> Sequence[bool]:
        """Of each effect, whether it is to be put to the test again."""

    def contest(self, index: int) -> Contest[Self, A] | None:
        """What could stand in the place of an effect; None where it needs no test after all, or time ended before its end.

        Where time ended before, it may be one in which nothing could: the effect is then removed.
        """

    def absorbers_last(self) -> Self | None:
        """Nothing chosen, and not to be added what could absorb other effects; None where that needs no trial."""

    def with_absorbers(self) -> Self:
        """With what was kept back by `absorbers_last` allowed again."""


def searched(start: E, limits: SearchLimits) -> E:
    """The list of effects with most evidence, of two: grown freely, and grown without absorbers first.

    Parameters
    ----------
    start : Explanation
        With nothing chosen.
    limits : SearchLimits

    Returns
    -------
    Explanation
    """
    free = grown(start, limits)
    again = None if search_is_over() else free.absorbers_last()
    if again is None:
        return settled(free, limits)
    shapes = settled(grown(again, limits), limits)
    shaped = grown(shapes.with_absorbers(), limits) if shapes.chosen else free
    if set(labels(shaped)) == set(labels(free)):
        return settled(free, limits)
    gain = shaped.evidence - free.evidence
    first, second = (shaped, free) if gain > 0.0 else (free, shaped)
    first = settled(first, limits)
    if abs(gain) > MAX_GAIN_OF_PRUNING_NATS or search_is_over():
        return first
    second = settled(second, limits)
    return second if second.evidence > first.evidence and not search_is_over() else first


def worth(explanation: E) -> float:
    """Evidence of all that was chosen, of each when it was [nats]."""
    return sum(c.gain for c in explanation.chosen)


def grown(explanation: E, limits: SearchLimits) -> E:
    """With every addition that has evidence, the best first.

    Parameters
    ----------
    explanation : Explanation
    limits : SearchLimits
    """
    while len(explanation.chosen) < limits.max_effects and not explanation.is_closed and not search_is_over():
        asked = limits.min_evidence_nats if explanation.chosen else _of_first(explanation, limits)
        together = limits.first_counts_rivals and not explanation.chosen
        best = asked - TIE_NATS if together else asked
        explanation, ranked = proven(explanation, explanation.ranked(), best)
        if explanation.chosen and search_is_over():  # it was not held against data that its fit did not see
            break
        if not ranked or ranked[0].gain < best or (together and of_all(ranked) < asked):
            break
        explanation = explanation.merged(ranked[0]) or explanation.plus(ranked[0], ranked)
    return explanation


def _of_first(explanation: E, limits: SearchLimits) -> float:
    """Evidence above which a first effect is named: where there surely is a gap, it need only be likelier than none."""
    return 0.0 if explanation.is_contradicted else limits.min_first_evidence_nats


def of_all(ranked: Sequence[Addition]) -> float:
    """Evidence that one of several additions is there, whichever it is [nats]."""
    return float(np.logaddexp.reduce([a.gain for a in ranked]))


def proven(explanation: E, ranked: Sequence[A], min_evidence_nats: float) -> tuple[E, Sequence[A]]:
    """Additions without those at the front that are to be refused, and the explanation that remembers these.

    Parameters
    ----------
    explanation : Explanation
        Without them.
    ranked : sequence of Addition
        By evidence, the best first.
    min_evidence_nats : float
        Evidence below which nothing is added anyway [nats].
    """
    refused: list[Refused] = []
    likelier: list[A] = []
    while (
        ranked and ranked[0].gain >= min_evidence_nats and (why := explanation.objection(ranked[0], likelier))
    ):
        refused.append(Refused(*ranked[0].label, ranked[0].gain, why))
        likelier.append(ranked[0])
        ranked = ranked[1:]
    return (explanation.refusing(refused) if refused else explanation), ranked


def settled(explanation: E, limits: SearchLimits) -> E:
    """Pruned, and grown again where that made room, until nothing changes.

    Parameters
    ----------
    explanation : Explanation
    limits : SearchLimits
    """
    for _ in range(limits.max_iterations):
        if len(explanation.chosen) < 2:
            break
        better = reconsidered(explanation, limits)
        if labels(better) == labels(explanation) or search_is_over():
            return better
        explanation = grown(better, limits)
    return explanation


def reconsidered(explanation: E, limits: SearchLimits) -> E:
    """Each effect in doubt judged anew beside all others: kept, removed, or replaced by a better name.

    Parameters
    ----------
    explanation : Explanation
    limits : SearchLimits
    """
    index = 0
    for doubtful in explanation.doubts():
        contest = explanation.contest(index) if doubtful else None
        if contest is None:
            index += 1
            continue
        rest, ranked = proven(contest.rest, contest.ranked, limits.min_evidence_nats)
        best = ranked[0] if ranked else None
        if best is None or best.gain < limits.min_evidence_nats:
            explanation = rest
            continue
        own = next((a for a in ranked if a is contest.own), None)
        keep = own if own is not None and best.gain - own.gain < limits.tie_nats else best
        explanation = rest.plus(keep, ranked).moved(index)
        index += 1
    return explanation


def refused_of(explanation: E) -> tuple[Refused, ...]:
    """What was not added in spite of its evidence, and was not added later either, each once with its last evidence."""
    last = {(r.effect, r.where): r for r in explanation.refused}
    return tuple(r for label, r in last.items() if label not in labels(explanation))


def labels(explanation: E) -> list[Label]:
    """Effect and place of all that was chosen, in order."""
    return [c.label for c in explanation.chosen]


def likeliest_first(additions: Sequence[A]) -> list[A]:
    """By the probability of all starts of a label together, those of one label by their own evidence."""
    share = probabilities(additions)
    return sorted(additions, key=lambda a: (-share[a.label], -a.gain))


def probabilities(ranked: Sequence[Addition]) -> dict[Label, float]:
    """Posterior probability of each addition by its evidence, `NO_EFFECT` among them; the starts of one label together."""
    gains = np.array([0.0, *(a.gain for a in ranked)])
    weights = np.exp(gains - gains.max())
    weights /= weights.sum()
    out: dict[Label, float] = {NO_EFFECT: float(weights[0])}
    for a, w in zip(ranked, weights[1:].tolist()):
        out[a.label] = out.get(a.label, 0.0) + w
    return out
