"""Commands on models: list, derive, audit, emit, verify."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from kfgen.cli.app import app
from kfgen.cli.options import (
    Columns,
    Json,
    MaxStep,
    ModelName,
    Noise,
    Order,
    Report,
    SampleRate,
    Sensors,
    Set,
    deliver,
    model_of,
    read,
)

EmittedFolder = Annotated[
    Path, typer.Argument(metavar="DIR", help="The folder of the filter, as 'emit' wrote it.")
]
Format = Annotated[str, typer.Option(help="How matrices are printed: text, latex or mathml.")]
Manoeuvres = Annotated[
    list[str] | None,
    typer.Option(help="A manoeuvre of 'kfgen list' or a file (.toml). Repeatable; at rest where left out."),
]
Duration = Annotated[
    float | None, typer.Option(help="How long is measured [s]; each manoeuvre's own length where left out.")
]
Want = Annotated[
    list[str] | None,
    typer.Option(help="Say when a standard deviation is reached: 'phi_D=0.1 deg'. Repeatable."),
]
Seen = Annotated[
    Path | None, typer.Option("--log", metavar="LOG", help="Say how well each state shows in this log.")
]
Target = Annotated[str, typer.Option(help="The language of the code, see 'kfgen list'.")]
NewFolder = Annotated[
    Path, typer.Option("-o", "--output", metavar="DIR", help="A new folder, or that of an emitted filter.")
]
Form = Annotated[
    str, typer.Option(help="Store the covariance (p) or its UD factors (ud), which are never indefinite.")
]
Real = Annotated[str, typer.Option(help="The type of the numbers: float or double.")]
Loops = Annotated[bool, typer.Option("--loops", help="Write loops: less code, more instructions.")]
QInterval = Annotated[
    float, typer.Option(help="Add process noise of bias states every SECONDS (UD form only).")
]
Counted = Annotated[
    list[str] | None,
    typer.Option(help="Count instructions, stack and code on this core for the header (m4f). Repeatable."),
]
Cores = Annotated[
    list[str] | None, typer.Option(help="Run on this core (host, m4f, ...), see 'kfgen list'. Repeatable.")
]
Contract = Annotated[
    bool,
    typer.Option(
        "--contract",
        help="Compile with fused products and sums: values may then differ by 1e-3 standard deviations.",
    ),
]
Replayed = Annotated[
    Path | None, typer.Option("--log", metavar="LOG", help="Make the calls of this log, not simulated ones.")
]


@app.command("list")
def list_(json: Json = None, report: Report = None) -> None:
    """Library models, sensors, effects, manoeuvres, targets, cores, consumers, adaptive filters, estimators."""
    from kfgen.catalogue import list_all
    from kfgen.report.model import list_answer

    deliver(list_answer(list_all()), json, report)


@app.command()
def derive(
    model: ModelName,
    noise: Noise = None,
    set_: Set = None,
    sensor: Sensors = None,
    format: Format = "text",
    order: Order = 1,
    rate: SampleRate = 100.0,
    json: Json = None,
    report: Report = None,
) -> None:
    """States, F, G, H, Phi and Qd of a model."""
    from kfgen.model.derive import derive
    from kfgen.report.model import derive_answer

    found = derive(model_of(model, noise, set_, sensor), rate=rate, order=order)
    deliver(derive_answer(found, format), json, report)


@app.command()
def audit(
    model: ModelName,
    noise: Noise = None,
    set_: Set = None,
    sensor: Sensors = None,
    manoeuvre: Manoeuvres = None,
    duration: Duration = None,
    rate: SampleRate = 100.0,
    want: Want = None,
    log: Seen = None,
    columns: Columns = None,
    json: Json = None,
    report: Report = None,
) -> None:
    """Unobservable states in words, what would make them observable, and how well the rest shows."""
    from dataclasses import replace

    from kfgen.core.whole_file import hashes
    from kfgen.report.audit import audit_answer
    from kfgen.run.audit import audit

    names = manoeuvre or []
    data = read(log, None, columns) if log is not None and not names else log
    built = model_of(model, noise, set_, sensor)
    found = audit(built, names, duration=duration, rate=rate, log=data, want=want or ())
    if log is None:
        files = [Path(f) for f in (model, str(noise or ""), *names) if f.endswith(".toml")]
        found = replace(found, inputs=hashes(files))
    deliver(audit_answer(found), json, report)


@app.command()
def emit(
    model: ModelName,
    target: Target,
    output: NewFolder,
    noise: Noise = None,
    form: Form = "p",
    real: Real = "float",
    loops: Loops = False,
    q_interval: QInterval = 0.0,
    core: Counted = None,
    set_: Set = None,
    sensor: Sensors = None,
    order: Order = 1,
    max_step: MaxStep = None,
    rate: SampleRate = 100.0,
    json: Json = None,
    report: Report = None,
) -> None:
    """The filter as code, with its self-test."""
    from kfgen.core.errors import InputError
    from kfgen.emit.emit import emit
    from kfgen.report.filter import emit_answer
    from kfgen.verify.compare import costs

    if core and target != "c":
        raise InputError(f"a filter in {target} cannot be counted", where="--core", remedy="Leave it out")
    emitted = emit(
        model_of(model, noise, set_, sensor),
        output,
        target,
        form,
        real,
        rate=rate,
        order=order,
        max_step=max_step,
        loops=loops,
        q_interval=q_interval,
        costs=partial(costs, names=core) if core else None,
    )
    deliver(emit_answer(emitted), json, report)


@app.command()
def verify(
    folder: EmittedFolder,
    core: Cores = None,
    contract: Contract = False,
    log: Replayed = None,
    columns: Columns = None,
    json: Json = None,
    report: Report = None,
) -> None:
    """Compile, run on host and emulated cores, compare bit patterns, count instructions, stack and code."""
    from kfgen.emit.folder import read_folder
    from kfgen.report.proof import verify_answer
    from kfgen.verify.compare import verify

    emitted = read_folder(folder)
    data = None if log is None else read(log, None, columns)
    deliver(verify_answer(verify(emitted, core or ["host"], data, contract)), json, report)
