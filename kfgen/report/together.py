"""The answer of ``gap`` over several recordings of one sensor."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from kfgen.effects.noise_model import NoiseModel
from kfgen.gap.rest.finding import Finding
from kfgen.gap.rest.several_recordings import JointGap
from kfgen.log.log import Log
from kfgen.report.gap import gap_answer, step_data
from kfgen.report.gap_words import VERDICTS, finding_sentence
from kfgen.report.page import Answer, Page, heading, table, text


def together_answer(logs: Sequence[Log], believed: NoiseModel, found: Mapping[str, JointGap]) -> Answer:
    """Text, JSON and page: first what lasts, of all recordings; then each by itself, and what happened once in it."""
    gaps = {n: replace(t.gap, verdict=_verdict(t)) for n, t in found.items()}
    answer = gap_answer(logs[0], believed, gaps)
    once = [(name, f"{finding_sentence(g, f)}.") for t in found.values() for name, g, f in t.once]
    rows = [[n, name, _alone(t, name)] for n, t in found.items() for name, _ in t.alone]
    head = (
        f"{len(logs)} recordings together; the figures are of each recording in turn, pictures of the first."
    )
    lines = [head, "", answer.text, "", "Each by itself:"]
    lines += [f"  {channel} of {name}: {words}" for channel, name, words in rows]
    lines += [f"Once, in {name} only: {words}" for name, words in once]
    parts = (
        text(head),
        *answer.page.parts,
        heading("Each recording by itself"),
        table(("channel", "recording", "answer"), rows),
        *(text(f"Once, in {name} only: {words}") for name, words in once),
    )
    data: dict[str, Any] = dict(answer.data)
    data["steps"] = [*data["steps"], *(_once(*o) for t in found.values() for o in t.once)]
    data["recordings"] = [
        {
            "log": log.source,
            "sha256": log.sha256,
            "verdicts": {n: dict(t.alone)[log.source].verdict for n, t in found.items()},
        }
        for log in logs
    ]
    return replace(
        answer, text="\n".join(lines), data=data, page=Page(f"Model against {len(logs)} recordings", parts)
    )


def _verdict(found: JointGap) -> str:
    """Of all: what happened once is a gap too."""
    return "effects_found" if found.gap.verdict == "no_gap" and found.once else found.gap.verdict


def _alone(found: JointGap, name: str) -> str:
    g = dict(found.alone)[name]
    names = ", ".join(f"{f.effect.name} ({100.0 * f.probability:.3g} %)" for f in g.findings)
    return f"{VERDICTS[g.verdict]}{': ' if names else ''}{names}"


def _once(name: str, g: Any, f: Finding) -> dict[str, Any]:
    return {**step_data(g, f), "recording": name}
