"""What came out, as a table of the documentation."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from trial import Score

CLAIMED = (0.0, 0.5, 0.9, 0.99, 1.0)
"""Edges of the probabilities that are counted together."""


def table(scores: Sequence[Score]) -> str:
    """Right names, sets, probabilities, intervals, false alarms, in markdown."""
    lines = [
        "| flights | right first | in the printed set | mean set | nothing said |",
        "|---|---|---|---|---|",
    ]
    singles = [s for s in scores if s.case.effect and not s.case.beside]
    for X in sorted({s.case.strength for s in singles}, reverse=True):
        of = [s for s in singles if s.case.strength == X]
        said = [s for s in of if s.findings]
        right = sum(s.first == s.case.label for s in of)
        sets = float(np.mean([s.set_size for s in said])) if said else 0.0
        inside = sum(s.in_set for s in said)
        lines.append(
            f"| X = {X:g} | {right} of {len(of)} | {inside} of {len(said)} | {sets:.2f} | {len(of) - len(said)} |"
        )
    nulls = [s for s in scores if not s.case.effect and not s.case.unlisted]
    alarms = [s for s in nulls if s.verdict != "no_gap"]
    lines.append(f"| nothing hidden | {len(nulls) - len(alarms)} of {len(nulls)} silent | | | |")
    others = [s for s in scores if s.case.unlisted]
    unknown = sum(s.verdict == "unknown_effect" for s in others)
    lines.append(f"| outside of the catalogue | {unknown} of {len(others)} said unknown | | | |")
    for kind, count in (("pairs", 1), ("triples", 2)):
        of = [s for s in scores if len(s.case.beside) == count]
        if of:
            exact = sum(s.is_exact for s in of)
            lines.append(f"| {kind}, X = {of[0].case.strength:g} each | {exact} of {len(of)} exactly | | | |")
    covered = [c for s in scores for c in s.covered]
    held = f"95 % intervals hold the truth in {sum(covered)} of {len(covered)}"
    lines += [
        "",
        f"{held}. {_reliability(scores)} "
        f"A flight of {scores[0].case.duration_s:g} s takes {np.median([s.seconds for s in scores]):.1f} s (median).",
    ]
    return "\n".join(lines)


def _reliability(scores: Sequence[Score]) -> str:
    """How often the first name is right, by what was claimed of it."""
    said = []
    for lo, hi in pairwise(CLAIMED):
        of = [s for s in scores if lo < s.probability <= hi and not s.case.unlisted]
        if of:
            right = sum(s.first in {c.label for c in (s.case, *s.case.beside)} for s in of)
            mean = 100.0 * float(np.mean([s.probability for s in of]))
            said.append(f"{100 * lo:g} to {100 * hi:g} % (mean {mean:.3g} %): {right} of {len(of)}")
    return f"First names right, by the probability claimed: {'; '.join(said)}."
