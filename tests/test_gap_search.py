"""Proves the search with a world that is a table: which names explain which units of evidence.

An effect explains a set of parts of the record; its evidence beside others is the worth of the parts that these do not
explain, less a cost. All numbers are exact, so every decision of the loop is.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import exp, log
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from kfgen.effects import make
from kfgen.gap.core import search
from kfgen.gap.core.search import (
    NO_EFFECT,
    Chosen,
    Contest,
    Distinguishability,
    Label,
    Refused,
    grown,
    labels,
    likeliest_first,
    probabilities,
    proven,
    reconsidered,
    refused_of,
    searched,
    settled,
)
from kfgen.gap.core.thresholds import MIN_EVIDENCE_NATS, SearchLimits
from kfgen.gap.rest import explanation
from kfgen.gap.scene import explanation as scene_explanation
from kfgen.gap.scene.assumed_parameters import FIRST_LIMITS, SHORT_LIMITS

LIMITS = explanation.search_limits()
"""Those of a channel at rest."""


@dataclass(frozen=True)
class Name:
    """An effect of the table with its evidence."""

    name: str
    gain: float

    @property
    def label(self) -> Label:
        return self.name, ""


@dataclass(frozen=True)
class Table:
    """Names and the parts that each explains, parts and their worth [nats]."""

    parts: Mapping[str, str]
    worth: Mapping[str, float]
    cost: float = 0.0
    bonus: Mapping[str, float] = field(default_factory=dict)
    chosen: tuple[Chosen[Name], ...] = ()
    absorbers: frozenset[str] = frozenset()
    waits: bool = False
    sure: frozenset[str] = frozenset()
    pairs: Mapping[tuple[str, str], str] = field(default_factory=dict)
    is_closed: bool = False
    is_contradicted: bool = False
    losing: frozenset[str] = frozenset()
    substitutes: frozenset[str] = frozenset()
    refused: tuple[Refused, ...] = ()

    def left(self) -> set[str]:
        there = {p for c in self.chosen for p in self.parts[c.name]}
        return set(self.worth) - there

    @property
    def evidence(self) -> float:
        parts = {p for c in self.chosen for p in self.parts[c.name]}
        own = sum(self.bonus.get(c.name, 0.0) - self.cost for c in self.chosen)
        return sum(self.worth[p] for p in parts) + own

    def ranked(self) -> list[Name]:
        names = set(self.parts) - {c.name for c in self.chosen} - (self.absorbers if self.waits else set())
        gains = {
            n: sum(self.worth[p] for p in self.parts[n] if p in self.left())
            + self.bonus.get(n, 0.0)
            - self.cost
            for n in names
        }
        return sorted((Name(n, g) for n, g in gains.items()), key=lambda a: (-a.gain, a.name))

    def objection(self, addition: Name, likelier: Sequence[Name]) -> str:
        worse = addition.name in self.substitutes and any(o.gain > addition.gain for o in likelier)
        return "it loses" if addition.name in self.losing or worse else ""

    def refusing(self, refused: Sequence[Refused]) -> Table:
        return replace(self, refused=(*self.refused, *refused))

    def plus(self, addition: Name, ranked: Sequence[Name]) -> Table:
        return replace(self, chosen=(*self.chosen, Chosen(addition, probabilities(ranked))))

    def less(self, index: int) -> Table:
        return replace(self, chosen=self.chosen[:index] + self.chosen[index + 1 :])

    def moved(self, index: int) -> Table:
        *rest, last = self.chosen
        return replace(self, chosen=(*rest[:index], last, *rest[index:]))

    def merged(self, addition: Name) -> Table | None:
        for index, c in enumerate(self.chosen):
            if both := self.pairs.get((c.name, addition.name)):
                rest = self.less(index)
                ranked = [a for a in rest.ranked() if a.name == both]
                return rest.plus(ranked[0], ranked)
        return None

    def doubts(self) -> list[bool]:
        return [c.name not in self.sure for c in self.chosen]

    def contest(self, index: int) -> Contest[Table, Name]:
        rest, name = self.less(index), self.chosen[index].name
        ranked = rest.ranked()
        return Contest(rest, ranked, next((a for a in ranked if a.name == name), None))

    def absorbers_last(self) -> Table | None:
        if not {c.name for c in self.chosen} & self.absorbers:
            return None
        return replace(self, chosen=(), waits=True)

    def with_absorbers(self) -> Table:
        return replace(self, waits=False)

    def having(self, *names: str) -> Table:
        """With these chosen, in order."""
        out = self
        for name in names:
            ranked = out.ranked()
            out = out.plus(next(a for a in ranked if a.name == name), ranked)
        return out


def names(table: Table) -> list[str]:
    return [name for name, _ in labels(table)]


def test_the_thresholds_of_the_worlds() -> None:
    """Those with which the rates of false alarms were measured."""
    assert SearchLimits(8, 1.0, 3.0, 1.0, 3) == LIMITS
    assert explanation.search_limits(6).min_first_evidence_nats == pytest.approx(2.7918, abs=1e-4)
    assert SearchLimits(10, 1.0, 3.0, 1.0, 3) == scene_explanation.LIMITS
    assert SearchLimits(4, 1.0, 3.0, 1.0, 0) == SHORT_LIMITS
    assert SearchLimits(4, 0.0, 3.0, 1.0, 0, first_counts_rivals=True) == FIRST_LIMITS
    assert SearchLimits(4, 1.0, 3.0, 1.0, 1) == scene_explanation.LIMITS_UNDER_MISFIT


@pytest.mark.parametrize(("evidence", "found"), [(0.99, []), (1.01, ["a"]), (5.0, ["a"])])
def test_a_first_effect_needs_the_evidence_that_its_world_asks_for(evidence: float, found: list[str]) -> None:
    assert names(grown(Table({"a": "1"}, {"1": evidence}), LIMITS)) == found


@pytest.mark.parametrize(("evidence", "found"), [(2.99, ["a"]), (3.01, ["a", "b"])])
def test_one_more_effect_needs_three_nats(evidence: float, found: list[str]) -> None:
    table = Table({"a": "1", "b": "2"}, {"1": 50.0, "2": evidence})
    assert names(grown(table, LIMITS)) == found


def test_the_best_comes_first() -> None:
    table = Table({"a": "1", "b": "2", "c": "3"}, {"1": 10.0, "2": 30.0, "3": 20.0})
    assert names(grown(table, LIMITS)) == ["b", "c", "a"]


def test_no_more_effects_than_the_world_allows() -> None:
    table = Table({n: n for n in "abcdefgh"}, dict.fromkeys("abcdefgh", 50.0))
    assert len(grown(table, replace(LIMITS, max_effects=3)).chosen) == 3
    assert not grown(replace(table, is_closed=True), LIMITS).chosen


@pytest.mark.parametrize(("better", "kept"), [(0.9, "a"), (1.1, "b")])
def test_the_name_that_stands_keeps_its_place_in_a_tie(better: float, kept: str) -> None:
    """Two names explain the same part; another is better by less than a nat, or by more."""
    table = Table({"a": "1", "b": "1", "c": "2"}, {"1": 40.0, "2": 30.0}, bonus={"b": better})
    again = reconsidered(table.having("a", "c"), LIMITS)
    assert names(again) == [kept, "c"]


def test_an_effect_that_a_later_one_makes_superfluous_is_removed() -> None:
    """What two effects explain a third explains alone, with a part of its own that makes it worth adding."""
    table = Table({"a": "12", "b": "123", "c": "4"}, {"1": 20.0, "2": 20.0, "3": 10.0, "4": 30.0})
    grown_ = table.having("a", "b", "c")
    assert names(reconsidered(grown_, LIMITS)) == ["b", "c"]
    assert names(settled(grown_, LIMITS)) == ["b", "c"]


def test_what_was_reconsidered_keeps_its_order() -> None:
    table = Table({n: n for n in "abcd"}, {"a": 40.0, "b": 30.0, "c": 20.0, "d": 10.0})
    assert names(reconsidered(table.having("c", "a", "d", "b"), LIMITS)) == ["c", "a", "d", "b"]


def test_what_is_beyond_doubt_is_not_judged_again() -> None:
    table = Table({"a": "1", "b": "1"}, {"1": 40.0}, bonus={"b": 5.0})
    assert names(reconsidered(table.having("a"), LIMITS)) == ["b"]
    assert names(reconsidered(replace(table, sure=frozenset("a")).having("a"), LIMITS)) == ["a"]


def test_room_that_was_made_is_filled() -> None:
    """Without the effect that was superfluous another is worth its evidence: the list settles on it."""
    table = Table(
        {"a": "12", "b": "13", "c": "24", "d": "5"}, {"1": 9.0, "2": 9.0, "3": 8.0, "4": 8.0, "5": 30.0}
    )
    found = searched(table, LIMITS)
    assert names(found) == ["d", "b", "c"]


def test_a_list_that_never_settles_ends() -> None:
    """Each of two names is better than the other by more than a tie: as often as is allowed, no more."""

    @dataclass(frozen=True)
    class Restless(Table):
        asked: list[int] = field(default_factory=list)

        def ranked(self) -> list[Name]:
            self.asked.append(1)
            there = {c.name for c in self.chosen}
            best = "ab"[len(self.asked) % 2]
            every = [Name(best, 50.0), Name("ab"["ab".index(best) - 1], 40.0), Name("c", 30.0)]
            return [n for n in every if n.name not in there]

    table = Restless({"a": "1", "b": "1", "c": "2"}, {"1": 40.0, "2": 30.0})
    settled(table.having("a", "c"), replace(LIMITS, max_iterations=3))
    assert len(table.asked) < 30


def test_two_effects_may_be_one_of_another_name() -> None:
    table = Table({"a": "1", "b": "2", "ab": "12"}, {"1": 20.0, "2": 10.0}, bonus={"ab": -15.0})
    assert names(grown(table, LIMITS)) == ["a", "b"]
    assert names(grown(replace(table, pairs={("a", "b"): "ab"}), LIMITS)) == ["ab"]


def test_what_absorbs_others_is_added_last_where_that_is_worth_more() -> None:
    """It explains most at first, but with the shapes first more is explained."""
    worth = {"1": 20.0, "2": 15.0, "3": 4.0}
    table = Table({"slow": "123", "x": "1", "y": "2"}, worth, absorbers=frozenset({"slow"}))
    assert names(searched(table, LIMITS)) == ["slow"]  # 39 nats against 35 and then 4: no more
    better = replace(table, bonus={"x": 2.0, "slow": -1.0}, sure=frozenset("xy"))
    assert names(searched(better, LIMITS)) == ["x", "y", "slow"]
    assert names(grown(better, LIMITS)) == ["slow"]


def test_of_two_lists_that_are_nearly_alike_both_are_pruned_before_they_are_compared() -> None:
    """Both explain everything; what absorbed is removed where it costs more than what was added later."""
    parts = {"slow": "12", "a": "1", "b": "2", "c": "45", "d": "46"}
    worth = {"1": 10.0, "2": 9.0, "4": 20.0, "5": 5.0, "6": 4.0}
    table = Table(parts, worth, absorbers=frozenset({"slow"}))
    free = searched(table, LIMITS)
    assert free.evidence == pytest.approx(sum(worth.values()))
    cut = replace(table, bonus={"slow": -60.0})
    assert "slow" not in names(searched(cut, LIMITS))


def test_probabilities_are_those_of_the_evidence() -> None:
    found = probabilities([Name("a", 2.0), Name("b", 1.0), Name("a", 0.0)])
    total = 1.0 + exp(2.0) + exp(1.0) + 1.0
    assert found[NO_EFFECT] == pytest.approx(1.0 / total)
    assert found["a", ""] == pytest.approx((exp(2.0) + 1.0) / total)
    chosen = Chosen(Name("a", 2.0), found)
    name, _, share = chosen.alternatives[0]
    assert (name, share) == ("b", pytest.approx(exp(1.0) / total))


def test_what_loses_on_unseen_data_is_not_added_and_is_remembered() -> None:
    """The next best that is proven takes its place; the probability of what was refused is shared by the others."""
    table = Table({"wrong": "ab", "right": "a"}, {"a": 30.0, "b": 20.0}, losing=frozenset({"wrong"}))
    found = searched(table, LIMITS)
    assert names(found) == ["right"]
    assert [(r.effect, r.evidence_nats, r.why) for r in refused_of(found)] == [
        ("wrong", 50.0, "it loses"),
        ("wrong", 20.0, "it loses"),
    ][-1:]
    assert found.chosen[0].probabilities.keys() == {NO_EFFECT, ("right", "")}


def test_what_time_left_unproven_is_not_added_to_what_was(monkeypatch: pytest.MonkeyPatch) -> None:
    """On a log of nine channels a third effect, added as time ended, left twice the mismatch that there was before."""
    table = Table({"a": "a", "b": "b"}, {"a": 30.0, "b": 20.0})
    over = iter([False, False, True])  # as the second is ranked
    monkeypatch.setattr(search, "search_is_over", lambda: next(over))
    assert names(grown(table, LIMITS)) == ["a"]


def test_what_is_added_after_all_is_not_said_to_be_refused() -> None:
    table = Table({"a": "a"}, {"a": 30.0}, refused=(Refused("a", "", 30.0, "it loses"),))
    assert refused_of(searched(table, LIMITS)) == ()


def test_an_effect_that_loses_beside_a_later_one_is_removed() -> None:
    table = Table({"a": "a", "b": "b"}, {"a": 30.0, "b": 20.0}).having("a", "b")
    found = reconsidered(replace(table, losing=frozenset({"a"})), LIMITS)
    assert names(found) == ["b"]


# Weights and thresholds at their edges.


def test_probabilities_of_overwhelming_evidence_are_numbers() -> None:
    found = probabilities([Name("a", 2000.0), Name("b", 2000.0 - log(3.0))])
    assert [found[Name(n, 0.0).label] for n in "ab"] == pytest.approx([0.75, 0.25])
    assert found[NO_EFFECT] == 0.0


def test_starts_of_one_effect_count_together() -> None:
    """Two starts of 1 nat each are 1 + log 2 = 1.69 nats, more than 1.5."""
    b, a, c = Name("b", 1.5), Name("a", 1.0), Name("a", 0.999)
    assert likeliest_first([b, a, c]) == [a, c, b]
    assert likeliest_first([b, a]) == [b, a]


def test_what_reaches_the_least_evidence_may_be_refused() -> None:
    """One that has exactly as much evidence as is asked for counts: it is added, or refused in words."""
    table = Table({"a": ("p",)}, {"p": 3.0}, losing=frozenset({"a"}))
    gain = table.ranked()[0].gain
    left, ranked = proven(table, table.ranked(), gain)
    assert [r.effect for r in left.refused] == [table.ranked()[0].label[0]]
    assert ranked == []
    left, ranked = proven(table, table.ranked(), gain + 1e-9)
    assert left.refused == ()
    assert len(ranked) == 1


def test_what_stands_in_for_a_refused_one_is_refused_too() -> None:
    """b is asked beside the likelier one that was refused; c, which is no substitute, is added."""
    table = Table(
        {"a": ("p",), "b": ("q",), "c": ("r",)},
        {"p": 9.0, "q": 7.0, "r": 5.0},
        losing=frozenset("a"),
        substitutes=frozenset("b"),
    )
    left, ranked = proven(table, table.ranked(), 0.0)
    assert [r.effect for r in left.refused] == [Name(n, 0.0).label[0] for n in "ab"]
    assert [a.name for a in ranked] == ["c"]
    alone, ranked = proven(replace(table, losing=frozenset()), table.ranked()[1:], 0.0)
    assert (alone.refused, [a.name for a in ranked]) == ((), ["b", "c"])


def test_only_what_resembles_a_refused_one_must_gain(monkeypatch: pytest.MonkeyPatch) -> None:
    """Directions at cos^2 = 0.5 and 0 of a scene; at rest shapes among shapes, and noise among noise."""
    for module in (scene_explanation, explanation):
        monkeypatch.setattr(module, "unproven", lambda *given: str(given[-1]))
    refused, near, far = (
        SimpleNamespace(direction=np.array(d)) for d in ([1.0, 0.0], [1.0, 1.0], [0.0, 1.0])
    )
    scene: Any = SimpleNamespace(scene=None, fit=None)
    for addition in (refused, near, far):
        addition.fit = None
    asked = [
        scene_explanation.SceneExplanation.objection(scene, a, o)  # type: ignore[arg-type]
        for a, o in ((near, [refused]), (far, [refused]), (near, []))
    ]
    assert asked == ["0.0", "3.0", "3.0"]
    ramp, walk = (
        SimpleNamespace(effect=make(n, **v), name=n)
        for n, v in (("rate_ramp", {"R": 1.0}), ("rate_random_walk", {"K": 1.0}))
    )
    rest: Any = SimpleNamespace(base=None)
    asked = [
        explanation.ChannelExplanation.objection(rest, a, o)  # type: ignore[arg-type]
        for a, o in ((ramp, [ramp]), (ramp, [walk]), (walk, [walk]), (walk, []))
    ]
    assert asked == ["0.0", "3.0", "0.0", "3.0"]


# Every decision at its edge.


def test_how_much_longer_a_record_would_have_to_be() -> None:
    """The evidence that is asked for over what is expected, never below one; nobody knows where it was not computed."""
    half = Distinguishability("bias", "", 0.9, 0.5 * MIN_EVIDENCE_NATS)
    assert half.record_factor == pytest.approx(2.0)
    assert replace(half, nats=4.0 * MIN_EVIDENCE_NATS).record_factor == 1.0
    assert replace(half, nats=0.0).record_factor == pytest.approx(MIN_EVIDENCE_NATS / 1e-9)
    assert replace(half, nats=None).record_factor is None


def test_of_two_searches_that_are_worth_the_same_the_free_one_stays() -> None:
    """With the shapes first 35 nats and no more; freely 35 by what absorbs."""
    table = Table({"slow": "12", "x": "1", "y": "2"}, {"1": 20.0, "2": 15.0}, absorbers=frozenset({"slow"}))
    assert names(searched(table, LIMITS)) == ["slow"]


def test_two_effects_are_enough_for_a_second_look() -> None:
    """The first of two that the second makes superfluous is removed; one alone is never looked at again."""
    table = Table({"a": "1", "b": "12"}, {"1": 20.0, "2": 10.0})
    assert names(settled(table.having("a", "b"), LIMITS)) == ["b"]
    asked: list[int] = []

    class Watched(Table):
        def doubts(self) -> list[bool]:
            asked.append(len(self.chosen))
            return super().doubts()

    alone = Watched({"a": "1"}, {"1": 20.0})
    settled(alone.having("a"), LIMITS)
    assert asked == []
    settled(Watched({"a": "1", "b": "2"}, {"1": 20.0, "2": 10.0}).having("a", "b"), LIMITS)
    assert asked == [2]  # nothing changed: once


def test_evidence_that_is_just_enough_keeps_an_effect() -> None:
    table = Table({"a": "1", "b": "2"}, {"1": 20.0, "2": LIMITS.min_evidence_nats})
    assert names(reconsidered(table.having("a", "b"), LIMITS)) == ["a", "b"]
    less = replace(table, worth={"1": 20.0, "2": LIMITS.min_evidence_nats - 1e-9})
    assert names(reconsidered(less.having("a", "b"), LIMITS)) == ["a"]


def test_a_whole_tie_goes_to_the_better_name() -> None:
    table = Table({"a": "1", "b": "1"}, {"1": 40.0}, bonus={"b": LIMITS.tie_nats})
    assert names(reconsidered(table.having("a"), LIMITS)) == ["b"]


def test_a_first_effect_with_just_enough_evidence_is_added() -> None:
    assert names(grown(Table({"a": "1"}, {"1": LIMITS.min_first_evidence_nats}), LIMITS)) == ["a"]


def test_where_there_surely_is_a_gap_a_first_name_need_only_be_likelier_than_none() -> None:
    """A record that contradicts the numbers of the model is no null: nothing is a false alarm of a gap there."""
    faint = Table({"walk": "a"}, {"a": 0.5})
    assert not grown(faint, LIMITS).chosen
    assert labels(grown(replace(faint, is_contradicted=True), LIMITS)) == [("walk", "")]
    assert not grown(replace(faint, worth={"a": -0.5}, is_contradicted=True), LIMITS).chosen
