"""The answers of ``emit``, ``run`` and ``simulate``."""

from __future__ import annotations

import numpy as np

import kfgen
from kfgen.emit.routines import Program
from kfgen.log.log import Log
from kfgen.report.page import Answer, Page, PagePart, columns, figure, heading, sentence, table
from kfgen.report.plots import AFTER, MEASURED, Line, series_picture, thin
from kfgen.run.run import AttitudeError, FilterRun

OPERATIONS = ("routine", "operations")


def operation_rows(program: Program) -> list[list[str]]:
    """Operations of each routine."""
    return [[r.name, str(r.operations)] for r in program.routines if r.operations]


def emit_answer(program: Program, target: str, folder: str, names: list[str]) -> Answer:
    """What was written."""
    model = program.discrete.model
    lines = [
        f"{model.name} as {target} in {folder}: {', '.join(names)}",
        f"  {program.n} states, hash {program.discrete.hash[:16]}",
        columns(operation_rows(program)),
        *(f"  {line}" for line in program.costs),
    ]
    data = {
        "format": "kfgen-emit-1",
        "kfgen": kfgen.__version__,
        "model": model.name,
        "target": target,
        "model_hash": program.discrete.hash,
        "form": program.form,
        "real": program.real,
        "loops": program.loops,
        "files": names,
        "operations": {r.name: r.operations for r in program.routines},
    }
    page = Page(f"{model.name} as {target}", (table(OPERATIONS, operation_rows(program)),))
    return Answer("\n".join(lines), data, page)


def run_answer(result: FilterRun, error: AttitudeError | None, log: Log) -> Answer:
    """Estimates, innovations and the distance from a reference."""
    lines = [f"{result.model} over {log.duration:.6g} s of {log.source}"]
    parts: list[PagePart] = []
    data: dict[str, object] = {
        "format": "kfgen-run-1",
        "kfgen": kfgen.__version__,
        "model": result.model,
        "log": log.source,
        "sha256": log.sha256,
        "duration_s": log.duration,
    }
    if error is not None:
        words = (
            f"inclination RMSE {np.degrees(error.inclination):.3g} deg, heading RMSE "
            f"{np.degrees(error.heading):.3g} deg against the reference attitude ({error.samples} samples)"
        )
        lines.append(f"  {words}")
        lines.append(
            f"  total RMSE {np.degrees(error.total):.3g} deg, the constant difference of the norths taken out"
        )
        parts.append(sentence(words[0].upper() + words[1:] + "."))
        data["attitude_error"] = {
            "inclination_rmse": error.inclination,
            "heading_rmse": error.heading,
            "total_rmse": error.total,
            "unit": "rad",
            "samples": error.samples,
        }
    rows = [
        [name, str(s.t.size), str(s.innovation.shape[1] if s.t.size else 0), f"{s.nis.mean():.3g}"]
        for name, s in result.sensors.items()
        if s.t.size
    ]
    head = ["sensor", "updates", "rows", "mean NIS"]
    lines.append(columns([head, *rows]))
    final = [[n, f"{v:.6g}"] for n, v in zip(result.names, result.estimate[-1])]
    lines += ["  at the end:", columns(final, "    ")]
    data["sensors"] = {
        name: {"updates": int(s.t.size), "mean_nis": float(s.nis.mean())}
        for name, s in result.sensors.items()
        if s.t.size
    }
    data["final"] = dict(zip(result.names, result.estimate[-1].tolist()))
    parts += [
        heading("Innovations"),
        table(head, rows),
        heading("At the end"),
        table(("state", "value"), final),
    ]
    parts += [
        figure(_innovations(result, name), f"Innovations of {name}.")
        for name, s in result.sensors.items()
        if s.t.size
    ]
    return Answer(
        "\n".join(lines), data, Page(f"{result.model} over {log.source.rsplit('/', 1)[-1]}", tuple(parts))
    )


def _innovations(result: FilterRun, name: str) -> str:
    s = result.sensors[name]
    keep = thin(s.t)
    colors = (AFTER, MEASURED, "#c4452f", "#7a8794")
    lines = [
        Line(f"row {i + 1}", s.t[keep], s.innovation[keep, i], colors[i % 4])
        for i in range(s.innovation.shape[1])
    ]
    return series_picture(lines, f"{name} innovation [SI]", f"innovation-{name}")


def simulate_answer(log: Log, path: str) -> Answer:
    """What was simulated."""
    text = f"{log.source}: {log.n} samples, {log.duration:.6g} s, {len(log.channels)} channels in {path}"
    data = {
        "format": "kfgen-simulate-1",
        "kfgen": kfgen.__version__,
        "samples": log.n,
        "path": path,
        "channels": {n: c.unit for n, c in log.channels.items()},
    }
    return Answer(text, data, Page("Simulated log", (sentence(text + "."),)))
