"""The table of effects planted in recordings that move, and of these recordings as they are."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence

from docs_table import measured_at
from score import Score

NOTHING = "nothing"


def recorded_table(scores: Sequence[Score], seed: int, load: float) -> str:
    """Markdown: one row a case, then the sums.

    Parameters
    ----------
    scores : sequence of Score
        Of the world ``recorded``.
    seed : int
    load : float
        By other work when it began.
    """
    planted = [s for s in scores if s.kind == "single"]
    plain = [s for s in scores if s.kind == "null"]
    lines = [
        "| trial and sensor | planted | said first | also said | probability | numbers agree with the first part |",
        "|---|---|---|---|---|---|",
        *(_row(s) for s in (*planted, *plain)),
    ]
    held = [ok for s in planted for _, ok in s.covered]
    named, many = [s for s in plain if s.named], sum(len(s.named) for s in plain)
    lines += [
        "",
        f"Planted: {sum(s.right_first for s in planted)} of {len(planted)} said first, "
        f"{sum(bool(set(s.truths) & set(s.named)) for s in planted)} among the names; of their numbers {sum(held)} of {len(held)}",
        "agree with those that were found in the first part, where the same was planted, within the 95 % interval of the",
        f"difference. Nothing planted: {len(plain) - len(named)} of {len(plain)} without a name, {many} names in",
        f"the others, {sum(s.probability > 0.9 for s in named)} of them above 90 %. No answer: "
        f"{sum(bool(s.error) for s in scores)}.",
        "",
        f"{measured_at(load)},\n`python benchmarks/gap --world recorded --seed {seed} --docs`.",
    ]
    return "\n".join(lines)


def _row(s: Score) -> str:
    others = Counter(s.named)
    others[s.first] -= 1
    also = ", ".join(f"{n} ({k})" if k > 1 else n for n, k in others.items() if k > 0)
    said = s.first if s.named else (s.error or NOTHING)
    share = "" if math.isnan(s.probability) else f"{100.0 * s.probability:.0f} %"
    held = f"{sum(ok for _, ok in s.covered)} of {len(s.covered)}" if s.covered else ""
    return f"| {s.variant} | {', '.join(s.truths) or NOTHING} | {said} | {also} | {share} | {held} |"
