"""The answers of ``emit``, ``run`` and ``simulate``."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

import kfgen
from kfgen.emit.cautions import cautions
from kfgen.emit.folder import EmittedFilter
from kfgen.log.log import Log
from kfgen.report.figures.run_figures import run_parts
from kfgen.report.page import (
    Answer,
    Page,
    PagePart,
    code,
    columns,
    heading,
    sentence,
    source_words,
    table,
)
from kfgen.run.run import FilterRun


def emit_answer(emitted: EmittedFilter) -> Answer:
    """What was written."""
    program, (head, rows) = emitted.program, emitted.short_table()
    name = f"{program.discrete.model.name} as {emitted.target}"
    lines = [
        f"{name} in {emitted.folder}: {', '.join(emitted.files)}",
        f"  {program.n} states, hash {emitted.model_hash[:16]}",
        columns(rows),
        *(f"  {line}" for line in program.costs),
    ]
    verdict = (
        f"{len(emitted.files)} files in {emitted.folder}; prove them with: kfgen verify {emitted.folder}",
    )
    facts = (
        ("model", program.discrete.model.title),
        ("hash", emitted.model_hash[:16]),
        ("form", program.form),
    )
    said = cautions(program)
    parts = [
        *_warnings(said),
        heading("Operations"),
        table(head, rows, "Additions, products and other operations of a call."),
        *([code("\n".join(program.costs), "Counted on processors")] if program.costs else []),
        heading("Files"),
        table(("file",), [[name] for name in emitted.files]),
    ]
    return Answer(
        "\n".join(lines), emitted.to_dict(), Page(name, tuple(parts), verdict, None, facts), warnings=said
    )


def _warnings(said: Sequence[str]) -> list[PagePart]:
    """The part of a page that warns, where there is something to warn of."""
    return [heading("Warnings"), *map(sentence, said)] if said else []


def run_answer(result: FilterRun) -> Answer:
    """Estimates, innovations and the distance from a reference."""
    lines = [result.title]
    parts: list[PagePart] = []
    if (error := result.attitude) is not None:
        inclination, north, total = np.degrees([error.inclination, error.heading, error.total])
        words = (
            f"inclination RMSE {inclination:.3g} deg, heading RMSE {north:.3g} deg against the reference "
            f"attitude ({error.samples} samples)"
        )
        lines.append(f"  {words}")
        lines.append(f"  total RMSE {total:.3g} deg after removing the constant heading offset")
        parts.append(sentence(words[0].upper() + words[1:] + "."))
    head, rows = result.short_table()
    final = [[n, f"{v:.6g}"] for n, v in zip(result.names, result.estimate[-1])]
    lines += [columns([head, *rows])]
    said = [result.consistency(name) for name in result.updated]
    lines += [f"  {words}" for name, words in zip(result.updated, said) if result.updated[name].beyond_gate]
    lines += ["  at the end:", columns(final, "    ")]
    parts += [
        *_warnings(result.cautions),
        *run_parts(result),
        table(head, rows, "Samples beyond the gate are fused here; the emitted filter would reject them."),
        table(("state at the end [SI]", "value"), final, "The state at the end", folded=True),
    ]
    verdict = tuple(f"{words}." for words in said)
    facts = (("log", source_words(result.source, result.sha256)), ("length", f"{result.duration:.6g} s"))
    page = Page(f"{result.model} over {result.source.rsplit('/', 1)[-1]}", tuple(parts), verdict, None, facts)
    return Answer("\n".join(lines), result.to_dict(), page, warnings=result.cautions)


def simulate_answer(log: Log, path: str) -> Answer:
    """What was simulated.

    Parameters
    ----------
    log : Log
    path : str
        Of its file.
    """
    text = f"{log.source}: {log.n} samples, {log.duration:.6g} s, {len(log.channels)} channels in {path}"
    data = {
        "format": "kfgen-simulate-1",
        "kfgen": kfgen.__version__,
        "samples": log.n,
        "path": path,
        "channels": {n: c.unit for n, c in log.channels.items()},
    }
    rows = [[name, channel.unit] for name, channel in log.channels.items()]
    page = Page("Simulated log", (table(("channel", "unit"), rows),), (text + ".",))
    return Answer(text, data, page)
