"""The answer of ``convert``, and the table of what each consumer calls B."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import kfgen
from kfgen.consumers import Converted, Value, consumers
from kfgen.consumers.table import MEANING_COLUMNS, labelled, meaning_rows, plain
from kfgen.effects import Effect
from kfgen.effects.noise_model import NoiseModel
from kfgen.report.page import Answer, Page, PagePart, code, columns, heading, sentence, table
from kfgen.report.page import text as paragraph


@dataclass(frozen=True)
class Request:
    """What was asked for: the noise file and its hash, the consumer, rate [Hz], safety, the file to write."""

    noise: str
    sha256: str
    consumer: str
    rate: float | None
    safety: float
    output: str = ""


def convert_answer(noise: NoiseModel, made: Converted, request: Request) -> Answer:
    """The consumer's text, its parameters, and every meaning of B."""
    module = consumers()[request.consumer]
    rows = [[name, _shown(v), v.words] for name, v in made.values.items()]
    data: dict[str, Any] = {
        "format": "kfgen-convert-1",
        "kfgen": kfgen.__version__,
        "consumer": request.consumer,
        "noise": request.noise,
        "sha256": request.sha256,
        "rate_hz": request.rate,
        "safety": request.safety,
        "source": module.SOURCE,
        "parameters": {name: _entry(v, module.SOURCE) for name, v in made.values.items()},
        "meanings": _meanings(noise, request.safety),
        "text": made.text,
        "warnings": list(made.warnings),
    }
    safety = "no safety factor" if request.safety == 1.0 else f"a safety factor of {request.safety:g}"
    parts = [
        sentence(f"The parameters of {request.noise.rsplit('/', 1)[-1]} for {module.TITLE}, with {safety}."),
        table(("parameter", "value", "from"), rows),
        *(paragraph(w) for w in made.warnings),
        code(made.text, f"Convention: {module.SOURCE}."),
    ]
    for name, channel in noise.channels.items():
        found = meaning_parts(name, channel.effects, channel.unit, request.safety)
        parts += [heading(name), *found] if found else []
    lines = [f"{module.TITLE} in {request.output}", columns(rows)] if request.output else [made.text]
    page = Page(f"Noise parameters for {request.consumer}", tuple(parts))
    return Answer("\n".join(lines), data, page, warnings=made.warnings)


def meaning_parts(channel: str, effects: Iterable[Effect], unit: str, safety: float = 1.0) -> list[PagePart]:
    """A table for each term of a channel whose size has several names: what each consumer calls B."""
    return [
        table(MEANING_COLUMNS, rows, f"What each consumer calls B of {channel}: {effect.title}.")
        for effect in effects
        if (rows := meaning_rows(effect, unit, safety))
    ]


def _meanings(noise: NoiseModel, safety: float) -> dict[str, Any]:
    """The numbers of each term, times the safety factor, by channel, term and name."""
    found: dict[str, Any] = {}
    for name, channel in noise.channels.items():
        for label, term in labelled(channel):
            titles = {m.name: m for m in term.effect.meanings}
            called = term.effect.called(channel.unit)
            if called:
                entry: dict[str, Any] = {
                    m: {
                        "value": safety * v,
                        "unit": plain(u),
                        "meaning": titles[m].title,
                        "users": titles[m].users,
                    }
                    for m, (v, u) in called.items()
                }
                times = {p.name for p in term.effect.parameters() if p.kind == "time"}
                row = term.effect.row(channel.unit)
                entry |= {t: {"value": row[t][0], "unit": row[t][1]} for t in sorted(times)}
                found.setdefault(name, {})[label] = entry
    return found


def _entry(v: Value, source: str) -> dict[str, Any]:
    number: Any = None if not v.numbers else v.numbers[0] if len(v.numbers) == 1 else list(v.numbers)
    return {"value": number, "unit": v.unit, "from": v.words, "source": source}


def _shown(v: Value) -> str:
    if not v.numbers:
        return "not identified"
    return f"{', '.join(f'{n:.6g}' for n in v.numbers)} {v.unit}"
