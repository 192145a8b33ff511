"""The table of what a run of the blind benchmark found, one for each world."""

from __future__ import annotations

import math
from collections.abc import Sequence
from textwrap import fill

from case import OBVIOUS
from docs_table import measured_at
from score import Score
from tables import BINS, share

LINE_CHARACTERS = 120
"""Of the documentation."""


def worlds_table(world: str, scores: Sequence[Score], arguments: str, load: float) -> str:
    """Markdown: a row for each strength, then the sums.

    Parameters
    ----------
    world : str
    scores : sequence of Score
        Of that world.
    arguments : str
        With which the same is drawn again.
    load : float
        By other work when it began.
    """
    single = [s for s in scores if s.kind == "single"]
    plain = [s for s in scores if s.kind == "null"]
    lines = [
        "| size or X | right name first | in the printed set | mean size of the set | nothing said |",
        "|---|---|---|---|---|",
    ]
    for strength in sorted({s.strength for s in single}, reverse=True):
        of = [s for s in single if s.strength == strength]
        seen = [s for s in of if s.named]
        mean = sum(s.set_size for s in seen) / max(len(seen), 1)
        name = "that people meet" if strength == OBVIOUS else f"{strength:g} nats"
        lines.append(
            f"| {name} | {share(s.right_first for s in of)} | {share(s.in_set for s in seen)} | {mean:.2f} | "
            f"{len(of) - len(seen)} |"
        )
    seen = [s for s in single if s.named]
    mean = sum(s.set_size for s in seen) / max(len(seen), 1)
    lines.append(
        f"| all | {share(s.right_first for s in single)} | {share(s.in_set for s in seen)} | {mean:.2f} | "
        f"{len(single) - len(seen)} |"
    )
    sure = [s for s in single if not math.isnan(s.probability) and s.probability > 0.9]
    held = [ok for s in scores for _, ok in s.covered]
    stacks = [(kind, [s for s in scores if s.kind == kind]) for kind in ("pair", "triple")]
    outside = [s for s in scores if s.kind == "unknown"]
    said = [
        f"Nothing hidden: {sum(s.verdict != 'no_gap' for s in plain)} of {len(plain)} called a gap.",
        f"First names claimed above 90 %: right in {share(s.right_first for s in sure)}.",
        f"First names by the probability claimed, hidden themselves and claimed: {_reliability(single)}.",
        f"95 % intervals hold the truth in {share(held)}.",
        *(f"Each {kind} named exactly: {share(s.exact for s in of)}." for kind, of in stacks if of),
        *([f"Outside of the catalogue, said unknown: {_unknown(outside)}."] if outside else []),
        f"No answer: {sum(bool(s.error) for s in scores)}.",
    ]
    command = f"`python benchmarks/gap --world {world} {arguments} --docs`"
    kept = "\n".join(
        fill(x, LINE_CHARACTERS, break_on_hyphens=False) for line in said for x in line.splitlines()
    )
    return "\n".join([*lines, "", kept, "", f"{measured_at(load)},\n{command}."])


def _reliability(single: Sequence[Score]) -> str:
    """Of every bin of the probability: how many were hidden themselves, and the mean that was claimed."""
    out = []
    for lo, hi in BINS:
        of = [s for s in single if lo <= s.probability < hi]
        if of:
            mean = sum(s.probability for s in of) / len(of)
            out.append(f"{sum(s.first_is_hidden for s in of)} of {len(of)} and {100.0 * mean:.1f} %")
    return "; ".join(out)


def unknown_table(scores: Sequence[Score], arguments: str, load: float) -> str:
    """Markdown: a row for each disturbance that the catalogue does not hold.

    Parameters
    ----------
    scores : sequence of Score
        Of them.
    arguments : str
        With which the same is drawn again.
    load : float
        By other work when it began.
    """
    lines = ["| hidden, 100 nats | said unknown | else named first, and how probable |", "|---|---|---|"]
    for cell in dict.fromkeys(s.cell for s in scores):
        of = [s for s in scores if s.cell == cell]
        named = [s for s in of if s.verdict != "unknown_effect"]
        shown = "; ".join(f"{s.first} {_probable(s)}" for s in named) or "-"
        lines.append(f"| {cell} | {share(s.verdict == 'unknown_effect' for s in of)} | {shown} |")
    lines.append(f"| all | {share(s.verdict == 'unknown_effect' for s in scores)} | |")
    command = f"`python benchmarks/gap --world static {arguments} --docs`"
    return "\n".join([*lines, "", f"{measured_at(load)},\n{command}."])


def _probable(s: Score) -> str:
    return "" if math.isnan(s.probability) else f"{100.0 * s.probability:.0f} %"


def _unknown(outside: Sequence[Score]) -> str:
    said = share(s.verdict == "unknown_effect" for s in outside)
    closed = share(s.verdict == "unknown_effect" or s.closed >= 0.9 for s in outside)
    return f"{said};\nthat, or nine tenths of the gap closed by a stand-in: {closed}"
