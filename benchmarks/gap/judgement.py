"""`Judgement`: what an ideal analyst thinks of one record of the blind benchmark."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from case import Case, Request
from scipy.special import logsumexp

Names = frozenset[str]
"""The names that are right where a hypothesis is true."""

Found = Iterable[tuple[Names, float, float]]
"""Names that are right, how often that is hidden, and the likelihood over that without an effect [nats]."""


@dataclass(frozen=True, eq=False)
class Judgement:
    """Of one record.

    Parameters
    ----------
    request : Request
    truth : frozenset of str
        The names that are right; empty where nothing is hidden.
    logs : mapping of frozenset of str to float
        The likelihood over that without an effect, of each kind of hypothesis, times its probability before; as logarithm.
    """

    request: Request
    truth: Names
    logs: Mapping[Names, float]

    @cached_property
    def evidence(self) -> float:
        """That something is hidden [nats]."""
        return float(logsumexp(list(self.logs.values())))

    @cached_property
    def names(self) -> tuple[tuple[str, float], ...]:
        """In the order in which they are named, with what each adds to the probability that one of them is right."""
        weight = {k: float(np.exp(v - self.evidence)) for k, v in self.logs.items()}
        out = []
        while weight:
            gained = {name: 0.0 for names in weight for name in sorted(names)}
            for names, w in weight.items():
                for name in names:
                    gained[name] += w
            best = max(gained, key=lambda name: gained[name])
            out.append((best, gained[best]))
            weight = {names: w for names, w in weight.items() if best not in names}
        return tuple(out)

    @property
    def right(self) -> bool:
        """Whether the first name is."""
        return self.names[0][0] in self.truth


def judgement(request: Request, case: Case, found: Found) -> Judgement:
    """From the likelihood of every hypothesis."""
    logs: dict[Names, list[float]] = {}
    whole = 0.0
    for names, often, log in found:
        whole += often
        logs.setdefault(names, []).append(log + float(np.log(often)))
    truth = frozenset(n for h in case.hidden for n in (h.effect, *h.also))
    return Judgement(request, truth, {k: float(logsumexp(v)) - float(np.log(whole)) for k, v in logs.items()})


def sets_that_hold(level: float, judgements: Sequence[Judgement]) -> tuple[list[int], list[bool]]:
    """Sizes of the smallest sets of names of which this share should hold the truth, and which do.

    Names are taken in the order of what they add, over all records, until the mean probability is reached.
    """
    adds = sorted((p for j in judgements for _, p in j.names), reverse=True)
    enough = int(np.searchsorted(np.cumsum(adds), level * len(judgements)))
    least = adds[min(enough, len(adds) - 1)]
    kept = [{name for k, (name, p) in enumerate(j.names) if k == 0 or p >= least} for j in judgements]
    return [len(k) for k in kept], [bool(k & j.truth) for k, j in zip(kept, judgements)]


def together(judgements: Sequence[Judgement]) -> Judgement:
    """Of one record for several strengths that are equally likely."""
    keys = {k for j in judgements for k in j.logs}
    logs = {
        k: float(logsumexp([j.logs[k] for j in judgements if k in j.logs])) for k in sorted(keys, key=sorted)
    }
    whole = float(np.log(len(judgements)))
    return replace(judgements[0], logs={k: v - whole for k, v in logs.items()})
