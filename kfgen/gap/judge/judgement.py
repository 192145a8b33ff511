"""`Judgement`: what a log and simulated records say of a declared effect."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import kfgen
from kfgen.core.numbers import finite
from kfgen.core.result import Result
from kfgen.gap.core.result import Comparison, Finding
from kfgen.gap.result import GapResult
from kfgen.gap.words import finding_sentence, percent

EARNS_ITS_PLACE, NOT_SHOWN, DOUBTFUL = "earns_its_place", "not_shown", "doubtful"
VERDICTS = {
    EARNS_ITS_PLACE: "{name} earns its place in the catalogue by this log",
    NOT_SHOWN: "The log does not show {name}",
    DOUBTFUL: "The log shows {name}, but it is no effect of the catalogue yet",
}
WITH_IT, WITHOUT_IT, STAND_IN = "with it", "without it", "with what stands in for it"
"""What simulated records hold."""
FOUND_SHARE, FALSE_SHARE, COVERED_SHARE = 0.9, 0.01, 0.95
"""Of records that hold it, in which it should be named; of records that do not; of its numbers in their intervals."""
OBJECTION_CHANCE = 0.01
"""Chance of a count as bad at these shares, below which it is an objection."""


@dataclass(frozen=True)
class Trials:
    """Simulated records, and what was named in them.

    Parameters
    ----------
    holding : str
        `WITH_IT`, `WITHOUT_IT` or `STAND_IN`.
    count : int
        Records.
    named : int
        In which the declared effect was named.
    others : mapping of str to int
        Names beside it or in its place, and in how many records.
    covered, numbers : int
        Numbers of it that lie in their 95 % intervals, and all of them; zero where it was not there.
    """

    holding: str
    count: int
    named: int
    others: Mapping[str, int] = field(default_factory=dict)
    covered: int = 0
    numbers: int = 0

    @property
    def share(self) -> float:
        """Of records in which it was named."""
        return self.named / self.count


@dataclass(frozen=True, repr=False)
class Judgement(Result):
    """What a log and simulated records say of a declared effect.

    Parameters
    ----------
    name : str
        Of the effect.
    without, found : GapResult
        The gap of the log by the catalogue, and by the catalogue with the declaration.
    trials : tuple of Trials
        Empty where the log does not show it, or where the sensors do not rest.
    """

    name: str
    without: GapResult
    found: GapResult
    trials: tuple[Trials, ...] = ()

    @property
    def shown(self) -> tuple[Comparison, Finding] | None:
        """Where the log shows it with most evidence; None where it does not."""
        every = [(c, f) for c in self.found.comparisons for f in c.findings if f.name == self.name]
        return max(every, key=lambda pair: pair[1].evidence_nats, default=None)

    @property
    def objections(self) -> tuple[str, ...]:
        """What speaks against it although the log shows it."""
        from scipy.stats import binom

        said = []
        before, after = self.without.gap.after, self.found.gap.after
        if self.shown is not None and after > before:
            said.append(
                f"the held-out mismatch is {after:.3g} nats per sample with it and {before:.3g} without"
            )
        for t in self.trials:
            if t.holding == WITH_IT and binom.cdf(t.named, t.count, FOUND_SHARE) < OBJECTION_CHANCE:
                said.append(f"it is named in {t.named} of {t.count} simulated records that hold it")
            if t.holding != WITH_IT and binom.sf(t.named - 1, t.count, FALSE_SHARE) < OBJECTION_CHANCE:
                said.append(f"it is named in {t.named} of {t.count} simulated records {t.holding}")
            if binom.cdf(t.covered, t.numbers, COVERED_SHARE) < OBJECTION_CHANCE:
                said.append(f"its intervals hold {t.covered} of {t.numbers} true numbers")
        return tuple(said)

    @property
    def verdict(self) -> str:
        """One of `VERDICTS`."""
        if self.shown is None:
            return NOT_SHOWN
        return DOUBTFUL if self.objections or not self.trials else EARNS_ITS_PLACE

    def summary(self) -> list[str]:
        """The verdict, what the log says, and what speaks against it."""
        lines = [VERDICTS[self.verdict].format(name=self.name)]
        if self.shown is None:
            rest = [r for c in self.found.comparisons for r in c.refused if r.effect == self.name]
            why = f": {rest[0].why}" if rest else ""
            return [*lines, f"it has no evidence above that of the catalogue{why}"]
        comparison, finding = self.shown
        lines.append(finding_sentence(comparison, finding).split(". ")[0])
        lines.append(
            f"evidence {finding.evidence_nats:.3g} nats, {percent(finding.probability)} probable; held-out mismatch "
            f"{_nats(self.found.gap.before)} as assumed, {_nats(self.without.gap.after)} by the catalogue, "
            f"{_nats(self.found.gap.after)} with it"
        )
        lines += [f"against it: {o}" for o in self.objections]
        return [
            *lines,
            *([] if self.trials else ["no record was simulated: that is done for sensors at rest"]),
        ]

    def short_table(self) -> tuple[list[str], list[list[str]]]:
        """Heads and rows: simulated records, how many name it, what else is named."""
        rows = [
            [
                t.holding,
                str(t.count),
                str(t.named),
                ", ".join(f"{n} ({k})" for n, k in t.others.items()) or "nothing",
                f"{t.covered} of {t.numbers}" if t.numbers else "",
            ]
            for t in self.trials
        ]
        return ["simulated records", "count", "named", "named beside it", "numbers in their interval"], rows

    def to_dict(self) -> dict[str, Any]:
        """The JSON of ``kfgen judge``."""
        shown = self.shown
        return {
            "format": "kfgen-judgement-1",
            "kfgen": kfgen.__version__,
            "effect": self.name,
            "verdict": self.verdict,
            "where": shown[1].where if shown else "",
            "evidence_nats": finite(shown[1].evidence_nats) if shown else 0.0,
            "probability": shown[1].probability if shown else 0.0,
            "parameters": {k: finite(v) for k, (v, _) in shown[1].effect.row("").items()} if shown else {},
            "held_out": {
                "assumed": finite(self.found.gap.before),
                "catalogue": finite(self.without.gap.after),
                "with_it": finite(self.found.gap.after),
            },
            "stand_ins": list(stand_ins(self.without, self.found)),
            "objections": list(self.objections),
            "trials": [
                {
                    "holding": t.holding,
                    "count": t.count,
                    "named": t.named,
                    "others": dict(t.others),
                    "covered": t.covered,
                    "numbers": t.numbers,
                }
                for t in self.trials
            ],
        }


def stand_ins(without: GapResult, found: GapResult) -> tuple[str, ...]:
    """What the catalogue names in the place of a declaration.

    Parameters
    ----------
    without, found : GapResult
        By the catalogue, and by the catalogue with the declaration.
    """
    named = {(f.name, f.where) for f in found.findings}
    return tuple(dict.fromkeys(f.name for f in without.findings if (f.name, f.where) not in named))


def _nats(value: float) -> str:
    return f"{value:.3g} nats per sample" if value > 0.0 else "none"
