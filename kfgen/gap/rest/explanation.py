"""A channel at rest as the search sees it: the assumed noise, effects added to it, all fitted together."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

from kfgen.core.recent_results import RecentResults
from kfgen.core.time_budget import search_is_over
from kfgen.effects import Effect, catalogue
from kfgen.gap.core.search import Chosen, Contest, Label, Refused, probabilities, worth
from kfgen.gap.core.thresholds import (
    CONFUSION_SET_MIN_PROBABILITY,
    MIN_EVIDENCE_NATS,
    MIN_FIRST_EVIDENCE_NATS,
    SearchLimits,
)
from kfgen.gap.core.unseen import MAX_UNSEEN_LOSS_NATS
from kfgen.gap.rest.comb import beside_wave, comb_of
from kfgen.gap.rest.distinguishability import distinguishability
from kfgen.gap.rest.evidence import (
    RETUNE,
    TIME_LIMITS,
    Candidate,
    assumed,
    candidates,
    loosened,
    series_of,
)
from kfgen.gap.rest.proof import unproven
from kfgen.gap.rest.trust import moved
from kfgen.identify.evidence.joint import records_of
from kfgen.identify.evidence.record import Evidence
from kfgen.identify.fit.fit import Key, Prior, Problem, maximise
from kfgen.identify.fit.laplace import log_evidence

UNRIVALLED_PROBABILITY = 0.9999
"""Probability of a name that had no rival."""
UNRIVALLED_EVIDENCE_NATS = 40.0
"""Evidence that such a name keeps beside the others, above which it is not judged anew."""
LINE = "sinusoid"
WAVE = "periodic_wave"
ONE_LINE_MAX_INVERSE_RECORDS = 40.0
"""Distance of two lines, in inverse lengths of the record, within which they may be one that wanders."""
ABSORBERS = frozenset({"bias_instability", "gauss_markov", "power_law_noise", "rate_random_walk"})
"""Slow noise, of which one realisation looks like a drift, a step or a telegraph."""
RANDOM = ABSORBERS | {"resonance", "random_telegraph", RETUNE}
"""What follows whatever is left, and leaves less of it to the shapes of which a record is the sum."""
MIN_SHARE_OF_SLOW_NOISE = 0.45
"""Evidence of a shape over that of slow noise, below which no more shapes are added without it."""
SHAPE_MIN_PROBABILITY = 1e-12
"""Probability of a shape beside slow noise below which it is not followed."""
MIN_NATS_OF_NOISE = 0.5
"""Likelihood that a spectrum loses without a noise, the others as they are, below which that noise is not there [nats]."""
MAX_KEPT_COMPARISONS = 8
"""Of one search."""


def search_limits(channels: int = 1) -> SearchLimits:
    """The limits of a search at rest: of several channels each may raise a false alarm, so that each needs more evidence.

    Parameters
    ----------
    channels : int
        That are compared in one log.
    """
    return SearchLimits(max_effects=8, min_first_evidence_nats=MIN_FIRST_EVIDENCE_NATS + math.log(channels))


Compared = RecentResults[tuple[tuple[object, ...], list[Candidate]]]


@dataclass(frozen=True)
class ChannelExplanation:
    """A record against what is assumed about it, and what was added so far.

    Parameters
    ----------
    record : Evidence
        One record, or several together; less the trusted deterministic terms.
    effects : tuple of Effect
        The assumed random ones, with `priors`.
    priors : mapping of Key to Prior
    chosen : tuple of Chosen
    without : frozenset of str
        Effects that are not looked for.
    known : tuple of Effect
        The assumed and the chosen ones as they were fitted together last.
    waiting : frozenset of str
        Effects that are kept back until those are found which are not.
    refused : tuple of Refused
        What was not added in spite of its evidence.
    compared : RecentResults
        What was compared before in one search, which comes back to the same explanation by several ways.
    """

    record: Evidence
    effects: tuple[Effect, ...]
    priors: Mapping[Key, Prior]
    chosen: tuple[Chosen[Candidate], ...] = ()
    without: frozenset[str] = field(default_factory=frozenset)
    known: tuple[Effect, ...] = ()
    waiting: frozenset[str] = field(default_factory=frozenset)
    refused: tuple[Refused, ...] = ()
    compared: Compared = field(
        default_factory=lambda: RecentResults(MAX_KEPT_COMPARISONS), compare=False, repr=False
    )

    @property
    def added(self) -> tuple[Effect, ...]:
        """The chosen effects that are sums of a spectrum or a shape."""
        return tuple(c.addition.effect for c in self.chosen if _is_summed(c))

    @property
    def altering(self) -> tuple[Effect, ...]:
        """The chosen effects that change samples."""
        return tuple(c.addition.effect for c in self.chosen if c.addition.changes_samples)

    @property
    def is_retuned(self) -> bool:
        """Whether the assumed numbers were set free."""
        return any(c.name == RETUNE for c in self.chosen)

    @cached_property
    def is_contradicted(self) -> bool:
        """Whether the numbers that are assumed do not hold, as far as they were trusted."""
        return moved(self.base.problem, self.base.fit, self.effects)

    @property
    def comb_hz(self) -> float:
        """The fundamental [Hz] of which its lines are harmonics; zero where they are not."""
        lines = [_frequency_hz(c.addition) for c in self.chosen if c.name == LINE]
        waves = [1.0 / float(c.addition.effect.row("")["period"][0]) for c in self.chosen if c.name == WAVE]
        return beside_wave(waves, lines, self.record.duration) or comb_of(lines, self.record.duration)

    @property
    def is_closed(self) -> bool:
        """Whether its lines are a comb, which would have no end."""
        return self.comb_hz > 0.0

    @cached_property
    def base(self) -> Candidate:
        """The model with all that was chosen, fitted to the record without what changes samples."""
        priors = loosened(self.priors) if self.is_retuned else dict(self.priors)
        at = len(self.effects)
        times = {at + k: TIME_LIMITS[e.name] for k, e in enumerate(self.added) if e.name in TIME_LIMITS}
        problem = Problem(self.record, (*self.effects, *self.added), priors, times=times)
        fits = [maximise(problem)]
        if len(self.known) == len(problem.effects):
            # Else what is added next would be credited with leading out of a worse maximum.
            fits.append(maximise(problem.starting(self.known)))
        best = max(fits, key=lambda f: f.value)
        base = Candidate("", best, problem, 0.0)
        for effect in self.altering:
            series = series_of(base)
            clean = effect.removed_from(series)
            assert clean is not None
            (record,) = records_of(base.problem.record)
            record = replace(record, y=record.y - series.y + clean)
            problem = replace(problem, record=record, effects=base.fit.effects)
            base = Candidate("", maximise(problem), problem, 0.0)
        return base

    def ranked(self) -> list[Candidate]:
        """What could be added, by evidence, the best first.

        While what is random is kept back, nothing after the first shape where slow noise says far more than another one:
        shape upon shape would follow one course of that noise.
        """
        found = self.every_candidate
        allowed = [c for c in found if c.name not in self.waiting]
        slow = [c.gain for c in found if c.name in ABSORBERS & self.waiting] if self.chosen else []
        least = MIN_SHARE_OF_SLOW_NOISE * max(slow, default=0.0)
        return allowed if allowed and allowed[0].gain >= least else []

    @cached_property
    def every_candidate(self) -> list[Candidate]:
        """All that the record allows, by evidence, the best first."""
        used = {e.name for e in self.altering} | ({RETUNE} if self.is_retuned else set())
        without = frozenset(used) | self.without
        # These are kept beside the result, that no other object has the identity of one of them.
        made_of = (self.record, self.priors, *self.chosen)
        key = (tuple(map(id, made_of)), self.effects, self.known, without)
        return self.compared.recalled(key, lambda: (made_of, candidates(self.base, without)))[1]

    def objection(self, addition: Candidate, likelier: Sequence[Candidate]) -> str:
        """Why an addition is not to be added, see `kfgen.gap.rest.proof`; shapes resemble shapes, and noise noise."""
        is_shape = bool(addition.effect.coefficients())
        alike = any(bool(o.effect.coefficients()) == is_shape for o in likelier if o.name != RETUNE)
        return unproven(self.base, addition, 0.0 if alike else MAX_UNSEEN_LOSS_NATS)

    def refusing(self, refused: Sequence[Refused]) -> ChannelExplanation:
        """With these remembered as not added."""
        return replace(self, refused=(*self.refused, *refused))

    def plus(self, addition: Candidate, ranked: Sequence[Candidate]) -> ChannelExplanation:
        """With one more, out of what competed with it; how far those are from it that are not ruled out.

        Parameters
        ----------
        addition : Candidate
        ranked : sequence of Candidate
            All that competed, itself among them.
        """
        below, shares = self.base, probabilities(ranked)
        known = below.fit.effects if addition.changes_samples else addition.fit.effects
        near: dict[Label, Candidate] = {}
        for c in ranked:  # of a name that has several ranges of its numbers the best
            if shares[c.label] > CONFUSION_SET_MIN_PROBABILITY and not c.changes_samples:
                near.setdefault(c.label, c)
        near.pop(addition.label, None)
        others = (
            ()
            if addition.changes_samples
            else tuple(distinguishability(addition, c, below) for c in near.values())
        )
        if not addition.changes_samples:
            more = log_evidence(addition.problem, addition.fit) - self._base_evidence
            addition = replace(addition, choice_nats=more - addition.gain)
        return replace(self, chosen=(*self.chosen, Chosen(addition, shares, others)), known=known)

    def less(self, index: int) -> ChannelExplanation:
        """Without the effect at `index`."""
        place = self._place(index)
        known = self.known[:place] + self.known[place + _is_summed(self.chosen[index]) :]
        return replace(self, chosen=self.chosen[:index] + self.chosen[index + 1 :], known=known)

    def without_vanished(self) -> ChannelExplanation:
        """Without noise of which later additions left nothing: where time ended it was not put to the test again."""
        fitted = self.base.fit.effects
        data = self.base.problem.record.likelihood(fitted)
        value = data.log_likelihood(fitted).value
        for index in reversed(range(len(self.chosen))):
            place = self._place(index)
            if not _is_summed(self.chosen[index]) or fitted[place].coefficients():
                continue
            others = (*fitted[:place], *fitted[place + 1 :])
            if value - data.log_likelihood(others).value < MIN_NATS_OF_NOISE:
                return self.less(index).without_vanished()
        return self

    def moved(self, index: int) -> ChannelExplanation:
        """With the last effect put at `index`."""
        *rest, last = self.chosen
        known, place = self.known, self._place(index)
        if _is_summed(last):
            known = (*known[:place], known[-1], *known[place:-1])
        return replace(self, chosen=(*rest[:index], last, *rest[index:]), known=known)

    def merged(self, addition: Candidate) -> ChannelExplanation | None:
        """Where a second line stands beside a first: both as one resonance, if that is worth more."""
        if addition.name != LINE:
            return None
        reach = ONE_LINE_MAX_INVERSE_RECORDS / self.record.duration
        for index, chosen in enumerate(self.chosen):
            if chosen.name != LINE:
                continue
            if abs(_frequency_hz(chosen.addition) - _frequency_hz(addition)) < reach:
                rest = replace(self.less(index), without=self.without | {LINE})
                ranked = rest.ranked()
                if ranked and ranked[0].gain > chosen.gain + addition.gain:
                    return replace(rest.plus(ranked[0], ranked), without=self.without)
        return None

    def doubts(self) -> Sequence[bool]:
        """All: what stands beyond doubt is seen when its turn comes."""
        return [True] * len(self.chosen)

    def contest(self, index: int) -> Contest[ChannelExplanation, Candidate] | None:
        """What could stand in the place of an effect; None where one that had no rival is still worth much.

        Where time ended, of effects that are compared by their likelihood: those that are worth nothing any more are
        removed, and the others stay.
        """
        old, rest = self.chosen[index], self.less(index)
        special = old.addition.changes_samples or bool(self.altering) or old.name == RETUNE
        if search_is_over():
            left = not special and self._kept_nats(rest) - old.addition.choice_nats < MIN_EVIDENCE_NATS
            return Contest(rest, [], None) if left else None
        unrivalled = not special and old.probability >= UNRIVALLED_PROBABILITY
        if unrivalled and self._kept_nats(rest) > UNRIVALLED_EVIDENCE_NATS:
            return None
        ranked = [c for c in rest.every_candidate if c.name not in self.waiting]
        return Contest(rest, ranked, next((c for c in ranked if c.name == old.name), None))

    def _kept_nats(self, rest: ChannelExplanation) -> float:
        """Evidence beside all others of what is not in the rest, its choice not counted."""
        return self._base_evidence - rest._base_evidence

    @cached_property
    def _base_evidence(self) -> float:
        return log_evidence(self.base.problem, self.base.fit)

    @property
    def evidence(self) -> float:
        """Of all that was chosen together, less the costs of choosing [nats]."""
        bare = assumed(self.base.problem.record, self.effects, self.priors)
        altering = sum(c.gain for c in self.chosen if c.addition.changes_samples)
        costs = sum(c.addition.choice_nats for c in self.chosen)
        return altering + self._base_evidence - log_evidence(bare.problem, bare.fit) - costs

    def absorbers_last(self) -> ChannelExplanation | None:
        """With what is random kept back; None where there is none of it, or nothing else comes near."""
        names = {c.name for c in self.chosen}
        if not names & RANDOM:
            return None
        bare = replace(self, chosen=(), known=())
        sure = len(names) == 1 and _has_no_shape(self.chosen[0].probabilities)
        if sure and series_of(bare.base).driven < worth(self):
            return None
        # What is no shape takes what waits for noise of another colour, unless it stood beside it.
        other = {name for name, cls in catalogue().items() if not cls.coefficients()}
        return replace(bare, waiting=RANDOM | (other - names))

    def with_absorbers(self) -> ChannelExplanation:
        """With what is random allowed again."""
        return replace(self, waiting=frozenset())

    def _place(self, index: int) -> int:
        """Where the effect of the chosen one is among all that are fitted."""
        return len(self.effects) + sum(map(_is_summed, self.chosen[:index]))


def _is_summed(chosen: Chosen[Candidate]) -> bool:
    """Whether it adds a spectrum or a shape."""
    return not chosen.addition.changes_samples and chosen.name != RETUNE


def _has_no_shape(shares: Mapping[Label, float]) -> bool:
    """Whether nothing without randomness comes near."""
    rest = [p for (n, _), p in shares.items() if n not in RANDOM and n != "none"]
    return max(rest, default=0.0) < SHAPE_MIN_PROBABILITY


def _frequency_hz(line: Candidate) -> float:
    return float(line.effect.row("")["frequency"][0])
