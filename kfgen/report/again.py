"""What another recording says of what was found, appended to the answer of ``gap``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from kfgen.gap.core.holdout import Gap
from kfgen.gap.rest.finding import ChannelGap
from kfgen.gap.rest.second_recording import happens_once
from kfgen.log.log import Log
from kfgen.report.gap import gap_rows
from kfgen.report.page import Answer, Page, PagePart, columns, heading, table, text

Proof = tuple[Log, Mapping[str, Gap]]
"""Another recording, and the gap of each channel over it."""


def with_proofs(answer: Answer, gaps: Mapping[str, ChannelGap], proofs: Sequence[Proof]) -> Answer:
    """The answer with what other recordings say."""
    lines: list[str] = []
    parts: list[PagePart] = []
    data: list[dict[str, Any]] = []
    for log, found in proofs:
        for name, gap in found.items():
            once = [f.effect.title for f in gaps[name].findings if happens_once(f.effect)]
            head = f"{name} on another recording, {gap.held_out}"
            rows = gap_rows(gap, bool(gaps[name].findings or gaps[name].retuned))
            rows = [[r[0].removeprefix("held-out "), *r[1:]] for r in rows]
            said = f"{' and '.join(once)}: happened once, and is not looked for there" if once else ""
            lines += ["", head, columns(rows), *([f"  {said}"] if said else [])]
            parts += [heading(head), table(("gap", ""), rows), *([text(said)] if said else [])]
            data.append(_entry(log, name, gap))
    page = Page(answer.page.title, (*answer.page.parts, *parts))
    return replace(
        answer, text="\n".join([answer.text, *lines]), data={**answer.data, "proofs": data}, page=page
    )


def _entry(log: Log, name: str, gap: Gap) -> dict[str, Any]:
    return {
        "log": log.source,
        "sha256": log.sha256,
        "channel": name,
        "before": gap.before,
        "after": gap.after,
        "closed_fraction": gap.closed,
        "ci95": list(gap.ci95),
    }
