"""Noise that channels share: correlations of what the models leave of them.

A correlation ``r`` of n pairs raises the log-likelihood by ``-n/2 ln(1 - r^2)``; log-uniform in its size
before the record, as every coefficient, it is known to ``(1 - r^2) / sqrt(n)`` after it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from itertools import combinations

import numpy as np

from kfgen.effects import catalogue
from kfgen.effects.noise_model import ChannelNoise, Term
from kfgen.effects.samples.cross_axis import CrossAxisNoise
from kfgen.effects.series import OF_A_COEFFICIENT
from kfgen.gap.core.battery import Test
from kfgen.gap.core.result import EFFECTS_FOUND, NO_GAP, Finding, beside_misfit
from kfgen.gap.core.search import NO_EFFECT
from kfgen.gap.rest.comparison import ChannelGap
from kfgen.gap.rest.explanation import search_limits


def with_pairs(gaps: Mapping[str, ChannelGap]) -> dict[str, ChannelGap]:
    """The answers with the noise that their channels share, by channel."""
    out = dict(gaps)
    pairs = [
        (a, b)
        for a, b in combinations(gaps, 2)
        if gaps[a].white.size == gaps[b].white.size > 0
        and not (_assumes(gaps[a].updated) and _assumes(gaps[b].updated))
    ]
    cost = float(np.log(len(catalogue()) + 1) + np.log(max(len(pairs), 1)))
    limits = search_limits()  # the cost counts the pairs
    for a, b in pairs:
        x, y = gaps[a].white, gaps[b].white
        n = x.size
        r = float(x @ y / np.sqrt((x @ x) * (y @ y)))
        sd = (1.0 - r * r) / float(np.sqrt(n))
        evidence = -0.5 * n * float(np.log1p(-min(r * r, 1.0 - 1e-12)))
        evidence += 0.5 * float(np.log(2.0 * np.pi)) + float(np.log(max(sd, 1e-300))) - cost
        evidence -= float(np.log(OF_A_COEFFICIENT * max(abs(r), sd)))
        if evidence > (
            limits.min_evidence_nats
            if gaps[a].findings or gaps[b].findings
            else limits.min_first_evidence_nats
        ):
            out[a] = _with(out[a], r, sd, evidence, named=True)
            out[b] = _with(out[b], r, sd, evidence, named=False)
    return out


def _assumes(noise: ChannelNoise) -> bool:
    return any(isinstance(t.effect, CrossAxisNoise) for t in noise.terms)


def _with(g: ChannelGap, r: float, sd: float, evidence: float, *, named: bool) -> ChannelGap:
    """One channel's answer with the term; `named` on the first of a pair only."""
    effect, ci95 = CrossAxisNoise(r), {"rho": (r - 1.96 * sd, r + 1.96 * sd)}
    updated = replace(g.updated, terms=(*g.updated.terms, Term(effect, ci95)))
    if not named:
        return replace(g, updated=updated)
    none = 1.0 / (1.0 + float(np.exp(min(evidence, 700.0))))
    whole = (0.0, 0.5 / g.record.dt)
    test = Test(
        "correlation of two channels",
        float(np.exp(-min(evidence, 700.0))),
        whole,
        1.0 + abs(r),
        channel=g.channel,
    )
    finding = Finding(effect, g.channel, g.unit, ci95, 1.0 - none, evidence, ((*NO_EFFECT, none),), test=test)
    verdict = EFFECTS_FOUND if g.verdict == NO_GAP else g.verdict
    found = (finding,) if verdict == EFFECTS_FOUND else beside_misfit([finding])
    return replace(
        g, verdict=verdict, findings=(*g.findings, *found), updated=updated, before=(test, *g.before)
    )
