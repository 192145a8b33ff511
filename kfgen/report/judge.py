"""The answer of ``judge``: whether a declared effect earns its place, and by what."""

from __future__ import annotations

from kfgen.gap.judge.judgement import EARNS_ITS_PLACE, Judgement
from kfgen.report.gap import gap_answer
from kfgen.report.page import Answer, Page, columns, figure, heading, sentence, table, text
from kfgen.report.plots import Picture, bars_picture


def judge_answer(judged: Judgement) -> Answer:
    """Text, JSON and page.

    Parameters
    ----------
    judged : Judgement
    """
    (first, *others), (head, rows) = judged.summary(), judged.short_table()
    lines = [f"{first}.", *(f"  {o}" for o in others)]
    parts = [sentence(f"{o[0].upper()}{o[1:]}.") for o in others]
    if rows:
        lines.append(columns([list(head), *rows]))
        parts += [
            table(head, rows, "Records on the times and drivers of the log, each compared anew."),
            figure(named_picture(judged), "Share of the simulated records in which it is named."),
        ]
    page = gap_answer(judged.found).page
    parts += [heading("The gap of the log with it"), *(text(v) for v in page.verdict), *page.parts]
    good = judged.verdict == EARNS_ITS_PLACE
    return Answer(
        "\n".join(lines),
        judged.to_dict(),
        Page(f"{judged.name} on trial", tuple(parts), (f"{first}.",), good, page.facts),
        ok=good,
        warnings=judged.found.warnings,
    )


def named_picture(judged: Judgement) -> Picture:
    """Share of the records of each kind in which the effect is named.

    Parameters
    ----------
    judged : Judgement
        With trials.
    """
    kinds, shares = [t.holding for t in judged.trials], [t.share for t in judged.trials]
    return bars_picture(kinds, shares, f"share that names {judged.name}", "judged")
