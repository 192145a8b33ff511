"""The table of what a run of the blind benchmark found, one for each world."""

from __future__ import annotations

import math
from collections.abc import Sequence

from case import OBVIOUS
from docs_table import measured_at
from score import Score
from tables import share


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
    sure = [s for s in single if not math.isnan(s.probability) and s.probability > 0.9]
    held = [ok for s in scores for _, ok in s.covered]
    stacks = [s for s in scores if s.kind in ("pair", "triple")]
    said = [
        f"Nothing hidden: {sum(s.verdict != 'no_gap' for s in plain)} of {len(plain)} called a gap.",
        f"First names claimed above 90 %: right in {share(s.right_first for s in sure)}.",
        f"95 % intervals hold the truth in {share(held)}.",
        *([f"Pairs and triples named exactly: {share(s.exact for s in stacks)}."] if stacks else []),
        f"No answer: {sum(bool(s.error) for s in scores)}.",
    ]
    command = f"`python benchmarks/gap --world {world} {arguments} --docs`"
    return "\n".join([*lines, "", "\n".join(said), "", f"{measured_at(load)},\n{command}."])
