"""The answers of ``emit``, ``run`` and ``simulate``."""

from __future__ import annotations

import numpy as np

import kfgen
from kfgen.emit.folder import EmittedFilter
from kfgen.log.log import Log
from kfgen.report.page import (
    Answer,
    Page,
    PagePart,
    code,
    columns,
    figure,
    heading,
    sentence,
    source_words,
    table,
)
from kfgen.report.plots import AFTER, MEASURED, Line, Picture, series_picture, thin
from kfgen.run.run import FilterRun
from kfgen.run.words import consistency

INNOVATION_COLORS = (AFTER, MEASURED, "#c4452f", "#7a8794")


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
    parts = [
        heading("Operations"),
        table(head, rows, "Additions, products and other operations of a call."),
        *([code("\n".join(program.costs), "Counted on processors")] if program.costs else []),
        heading("Files"),
        table(("file",), [[name] for name in emitted.files]),
    ]
    return Answer("\n".join(lines), emitted.to_dict(), Page(name, tuple(parts), verdict, None, facts))


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
    lines += [columns([head, *rows]), "  at the end:", columns(final, "    ")]
    parts += [
        heading("Innovations"),
        *(figure(run_picture(result, name), f"Innovations of {name}.") for name in result.updated),
        table(head, rows),
        table(("state at the end [SI]", "value"), final, "The state at the end", folded=True),
    ]
    verdict = tuple(
        f"{consistency(name, float(s.nis.mean()), s.t.size, s.expected_nis95)}."
        for name, s in result.updated.items()
    )
    facts = (("log", source_words(result.source, result.sha256)), ("length", f"{result.duration:.6g} s"))
    page = Page(f"{result.model} over {result.source.rsplit('/', 1)[-1]}", tuple(parts), verdict, None, facts)
    return Answer("\n".join(lines), result.to_dict(), page)


def run_picture(result: FilterRun, name: str) -> Picture:
    """The innovations of a sensor over time.

    Parameters
    ----------
    result : FilterRun
    name : str
        Of the sensor.
    """
    s = result.sensors[name]
    keep = thin(s.t)
    lines = [
        Line(s.channels[i], s.t[keep], s.innovation[keep, i], INNOVATION_COLORS[i % 4])
        for i in range(s.innovation.shape[1])
    ]
    return series_picture(lines, "innovation [SI]", f"innovation-{name}")


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
