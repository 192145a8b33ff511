"""The search: add what has most evidence, again, and take out what a later effect makes superfluous."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

from kfgen.effects import Effect
from kfgen.gap.rest.comb import comb_of
from kfgen.gap.rest.distinguishability import Distinguishability, apart
from kfgen.gap.rest.evidence import (
    ABOVE,
    BETWEEN,
    Candidate,
    believed,
    candidates,
    log_evidence,
    loosened,
    probabilities,
    series_of,
)
from kfgen.identify.evidence.joint import records_of
from kfgen.identify.evidence.record import Evidence
from kfgen.identify.fit.fit import Key, Prior, Problem, maximise

MOST = 8
"""Effects on one channel: beyond, what is missing is no list of effects."""
FIRST = 0.3
"""Nats of evidence above which a first effect is named: of 200 records without a gap one reached 1.43, one 0.11, all others
less than zero."""
ROUNDS = 3
"""Times that the whole list is gone through again."""
SURE = 0.9999
"""Probability of a name that had no rival."""
PLENTY = 40.0
"""Nats of evidence that a name keeps beside the others, above which it is not judged anew."""
LINE = "sinusoid"
BESIDE = 40.0
"""Inverse lengths of the record within which two lines may be one that wanders."""
SET = 0.05
"""Probability above which another name belongs to what cannot be told apart."""
BETTER = 1.0
"""Nats by which another name must be better to take a place."""
RETUNE = "retune"
ABSORBERS = frozenset({"bias_instability", "gauss_markov", "rate_random_walk"})
"""Slow noise, of which one realisation looks like a drift, a step or a telegraph."""
UNLIKELY = 1e-12
"""Probability of a shape beside slow noise below which it is not followed."""


@dataclass(frozen=True)
class Chosen:
    """An effect that was added: the candidate, and what else competed for its place."""

    candidate: Candidate
    shares: Mapping[str, float]
    others: tuple[Distinguishability, ...] = ()

    @property
    def name(self) -> str:
        """Of the effect."""
        return self.candidate.name


@dataclass(frozen=True)
class Search:
    """A record against what is believed of it, and what was added so far.

    Parameters
    ----------
    record : Evidence
        One record, or several together; less the trusted deterministic terms.
    effects : tuple of Effect
        The believed random ones, with `priors`.
    chosen : tuple of Chosen
    known : tuple of Effect
        The believed and the chosen ones as they were fitted together last.
    """

    record: Evidence
    effects: tuple[Effect, ...]
    priors: Mapping[Key, Prior]
    chosen: tuple[Chosen, ...] = ()
    without: frozenset[str] = field(default_factory=frozenset)
    known: tuple[Effect, ...] = ()

    @property
    def added(self) -> tuple[Effect, ...]:
        """The chosen effects that are sums of a spectrum or a shape."""
        return tuple(c.candidate.effect for c in self.chosen if _is_summed(c))

    @property
    def altering(self) -> tuple[Effect, ...]:
        """The chosen effects that alter samples."""
        return tuple(c.candidate.effect for c in self.chosen if _alters(c))

    @property
    def worth(self) -> float:
        """Evidence of all that was chosen [nats]."""
        return sum(c.candidate.gain for c in self.chosen)

    @property
    def comb(self) -> float:
        """The fundamental [Hz] of which its lines are harmonics; zero where they are not."""
        lines = [_frequency(c.candidate) for c in self.chosen if c.name == LINE]
        return comb_of(lines, self.record.duration)

    def base(self) -> Candidate:
        """The model with all that was chosen, fitted to the record without what alters samples."""
        retuned = any(c.name == RETUNE for c in self.chosen)
        priors = loosened(self.priors) if retuned else dict(self.priors)
        at = len(self.effects)
        times = {at + k: BETWEEN[e.name] for k, e in enumerate(self.added) if e.name in BETWEEN}
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

    def ranked(self, base: Candidate) -> list[Candidate]:
        """What could be added to it."""
        taken = {e.name for e in self.altering}
        if any(c.name == RETUNE for c in self.chosen):
            taken.add(RETUNE)
        return candidates(base, frozenset(taken) | self.without)

    def plus(self, candidate: Candidate, ranked: Sequence[Candidate], below: Candidate) -> Search:
        """With one more."""
        known = below.fit.effects if candidate.changes_samples else candidate.fit.effects
        return replace(self, chosen=(*self.chosen, _chosen(candidate, ranked, below)), known=known)

    def less(self, index: int) -> Search:
        """With one fewer."""
        place = self._place(index)
        known = self.known[:place] + self.known[place + _is_summed(self.chosen[index]) :]
        return replace(self, chosen=self.chosen[:index] + self.chosen[index + 1 :], known=known)

    def moved(self, index: int) -> Search:
        """With the last one put at `index`."""
        *rest, last = self.chosen
        known, place = self.known, self._place(index)
        if _is_summed(last):
            known = (*known[:place], known[-1], *known[place:-1])
        return replace(self, chosen=(*rest[:index], last, *rest[index:]), known=known)

    def _place(self, index: int) -> int:
        """Where the effect of the chosen one is among all that are fitted."""
        return len(self.effects) + sum(map(_is_summed, self.chosen[:index]))


def _alters(chosen: Chosen) -> bool:
    return chosen.candidate.changes_samples


def _is_summed(chosen: Chosen) -> bool:
    """Whether it adds a spectrum or a shape."""
    return not _alters(chosen) and chosen.name != RETUNE


def _chosen(candidate: Candidate, ranked: Sequence[Candidate], below: Candidate) -> Chosen:
    """A candidate, with how far those are from it that the record does not rule out."""
    shares = probabilities(ranked)
    near = [c for c in ranked if shares[c.name] > SET and c is not candidate and not c.changes_samples]
    others = () if candidate.changes_samples else tuple(apart(candidate, c, below) for c in near)
    return Chosen(candidate, shares, others)


def searched(start: Search) -> Search:
    """The list of effects with most evidence, of two: grown freely, and grown without absorbers first."""
    free = grown(start)
    names = {c.name for c in free.chosen}
    alone = len(names) == len(names & ABSORBERS) == 1 and _sure(free.chosen[0])
    if not names & ABSORBERS or (alone and series_of(start.base()).driven < free.worth):
        return settled(free)
    shaped = grown(replace(start, without=start.without | ABSORBERS))
    if not shaped.chosen:
        return settled(free)
    shaped = grown(replace(shaped, without=start.without))
    return settled(shaped if shaped.worth > free.worth else free)


def _sure(chosen: Chosen) -> bool:
    """Whether nothing without randomness comes near."""
    rest = [p for n, p in chosen.shares.items() if n not in ABSORBERS and n not in ("none", RETUNE)]
    return max(rest, default=0.0) < UNLIKELY


def settled(search: Search) -> Search:
    """Pruned, and grown again where that made room."""
    for _ in range(ROUNDS):
        if len(search.chosen) < 2:
            break
        better = reconsidered(search)
        if [c.name for c in better.chosen] == [c.name for c in search.chosen]:
            return better
        search = grown(better)
    return search


def grown(search: Search) -> Search:
    """With every addition that has evidence, the best first; a comb of lines would have no end."""
    while len(search.chosen) < MOST and not search.comb:
        below = search.base()
        ranked = search.ranked(below)
        if not ranked or ranked[0].gain < (ABOVE if search.chosen else FIRST):
            break
        search = _wandering(search, ranked[0]) or search.plus(ranked[0], ranked, below)
    return search


def _wandering(search: Search, line: Candidate) -> Search | None:
    """Where a second line stands beside a first: both as one resonance, if that is worth more."""
    if line.name != LINE:
        return None
    reach = BESIDE / search.record.duration
    for index, chosen in enumerate(search.chosen):
        near = chosen.name == LINE and abs(_frequency(chosen.candidate) - _frequency(line)) < reach
        if near:
            rest = replace(search.less(index), without=search.without | {LINE})
            below = rest.base()
            ranked = rest.ranked(below)
            if ranked and ranked[0].gain > chosen.candidate.gain + line.gain:
                return replace(rest.plus(ranked[0], ranked, below), without=search.without)
    return None


def _frequency(line: Candidate) -> float:
    return float(line.effect.row("")["frequency"][0])


def _stands(search: Search, chosen: Chosen, below: Candidate) -> bool:
    """Whether an effect that had no rival is still worth much: then nothing needs to be ranked again."""
    if _alters(chosen) or search.altering or chosen.name == RETUNE or chosen.shares[chosen.name] < SURE:
        return False
    base = search.base()
    worth = log_evidence(base.problem, base.fit) - log_evidence(below.problem, below.fit)
    return worth > PLENTY


def reconsidered(search: Search) -> Search:
    """Each effect judged anew beside all others: kept, taken out, or replaced by a better name."""
    index = 0
    while index < len(search.chosen):
        rest = search.less(index)
        old = search.chosen[index]
        below = rest.base()
        if _stands(search, old, below):
            index += 1
            continue
        ranked = rest.ranked(below)
        same = next((c for c in ranked if c.name == old.name), None)
        best = ranked[0]
        if best.gain < ABOVE:
            search = rest
            continue
        keep = same if same is not None and best.gain - same.gain < BETTER else best
        search = rest.plus(keep, ranked, below).moved(index)
        index += 1
    return search


__all__ = ["ABOVE", "Chosen", "Search", "believed", "grown", "log_evidence", "reconsidered", "searched"]
