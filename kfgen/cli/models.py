"""Commands on models: list, derive, audit, emit, verify."""

from __future__ import annotations

from dataclasses import replace
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
    hashes,
    model_of,
    noise_of,
    ran_over,
    read,
)


@app.command("list")
def list_(json: Json = None, report: Report = None) -> None:
    """Library models, sensors, effects, manoeuvres, targets, cores, consumers, adaptive filters, estimators."""
    from kfgen.arma.estimate import estimators
    from kfgen.consumers import consumers
    from kfgen.effects import catalogue
    from kfgen.emit import targets
    from kfgen.manoeuvre.library import LIBRARY as MANOEUVRES
    from kfgen.model.library import LIBRARY, option_rows
    from kfgen.model.parts.sensors import sensors
    from kfgen.report.model import list_answer
    from kfgen.run.adaptive.rules import rules
    from kfgen.verify.compare import cores

    answer = list_answer(
        {
            "models": [(n, e.title) for n, e in LIBRARY.items()],
            "sensors": [(n, s.title) for n, s in sensors().items()],
            "options": option_rows(),
            "effects": [(n, e.title) for n, e in catalogue().items()],
            "manoeuvres": [(n, m.title) for n, m in MANOEUVRES.items()],
            "targets": [(n, t.TITLE) for n, t in targets().items()],
            "cores": list(cores().items()),
            "consumers": [(n, c.TITLE) for n, c in consumers().items()],
            "filters": [(n, c.title) for n, c in rules().items()],
            "estimators": [(n, c.title) for n, c in estimators().items()],
        }
    )
    deliver(answer, json, report)


@app.command()
def derive(
    model: ModelName,
    noise: Noise = None,
    set_: Set = None,
    sensor: Sensors = None,
    format: Annotated[str, typer.Option(help="text, latex or mathml.")] = "text",
    order: Order = 1,
    rate: SampleRate = 100.0,
    json: Json = None,
    report: Report = None,
) -> None:
    """States, F, G, H, Phi and Qd of a model."""
    from kfgen.core.errors import InputError
    from kfgen.model.discretise import DiscreteModel
    from kfgen.report.model import derive_answer

    if format not in ("text", "latex", "mathml"):
        raise InputError(
            f"there is no format '{format}'", where="--format", remedy="Known are text, latex, mathml"
        )
    built = model_of(model, noise, set_, sensor)
    deliver(derive_answer(DiscreteModel.at_rate(built, rate, order), format), json, report)


@app.command()
def audit(
    model: ModelName,
    noise: Noise = None,
    set_: Set = None,
    sensor: Sensors = None,
    manoeuvre: Annotated[
        list[str] | None,
        typer.Option(
            help="A manoeuvre of 'kfgen list' or a file (.toml); may be repeated. At rest when left out."
        ),
    ] = None,
    duration: Annotated[
        float | None, typer.Option(help="Seconds looked at; each manoeuvre's own when left out.")
    ] = None,
    rate: SampleRate = 100.0,
    want: Annotated[
        list[str] | None,
        typer.Option(help="How long until a state is known: 'phi_D=0.1 deg'; may be repeated."),
    ] = None,
    log: Annotated[
        Path | None, typer.Option(metavar="LOG", help="How well each state shows in this log.")
    ] = None,
    columns: Columns = None,
    json: Json = None,
    report: Report = None,
) -> None:
    """What cannot be seen, in words; what would free it; how well the rest shows."""
    from kfgen.audit.audit import audit as audited
    from kfgen.audit.audit import in_log
    from kfgen.audit.degree import Horizon
    from kfgen.core.errors import InputError
    from kfgen.manoeuvre.file import manoeuvre as manoeuvre_of
    from kfgen.report.audit import audit_answer

    if log is not None:
        if manoeuvre:
            raise InputError(
                "a log has its own motion", where="--manoeuvre", remedy="Give --log or --manoeuvre"
            )
        data = read(log, None, columns)
        built, t, deviation = ran_over(model_of(model, noise, set_, sensor), data)
        answer = in_log(built, Path(data.source).name or str(log), t, deviation)
        return deliver(audit_answer(answer, want or (), {str(log): data.sha256}), json, report)
    names = list(dict.fromkeys(manoeuvre or ()))
    flown = [manoeuvre_of(name) for name in names]
    built = model_of(model, noise, set_, sensor)
    answer = audited(built, flown, Horizon(duration, rate))
    files = [Path(f) for f in (model, str(noise) if noise else "", *names) if f.endswith(".toml")]
    return deliver(audit_answer(answer, want or (), hashes(files)), json, report)


@app.command()
def emit(
    model: ModelName,
    target: Annotated[str, typer.Option(help="See 'kfgen list'.")],
    output: Annotated[Path, typer.Option("-o", "--output", metavar="DIR", help="A new folder.")],
    noise: Noise = None,
    form: Annotated[str, typer.Option(help="p: the covariance; ud: its factors, never indefinite.")] = "p",
    real: Annotated[str, typer.Option(help="float or double.")] = "float",
    loops: Annotated[bool, typer.Option("--loops", help="Loops: less code, more instructions.")] = False,
    q_interval: Annotated[
        float, typer.Option(help="Add the process noise of bias states every so many seconds (UD form only).")
    ] = 0.0,
    core: Annotated[
        list[str] | None, typer.Option(help="m4f, ...: its instructions, stack and code go into the header.")
    ] = None,
    set_: Set = None,
    sensor: Sensors = None,
    order: Order = 1,
    max_step: MaxStep = None,
    rate: SampleRate = 100.0,
    json: Json = None,
    report: Report = None,
) -> None:
    """The filter as code, with its self-test."""
    from kfgen.emit.folder import write_folder
    from kfgen.emit.routines import Program
    from kfgen.model.discretise import DiscreteModel
    from kfgen.report.filter import emit_answer

    built = model_of(model, noise, set_, sensor)
    program = Program(DiscreteModel.at_rate(built, rate, order, max_step), form, real, loops, q_interval)
    if core:
        from kfgen.core.errors import InputError
        from kfgen.emit.targets.c import TARGET
        from kfgen.verify.compare import costs

        if target != TARGET:
            raise InputError(f"only target {TARGET} is counted", where="--core", remedy="Leave it out")
        program = replace(program, costs=costs(program, core))
    names = write_folder(program, target, noise_of(noise), output)
    deliver(emit_answer(program, target, str(output), names), json, report)


@app.command()
def verify(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="As 'emit' wrote it.")],
    core: Annotated[list[str] | None, typer.Option(help="host, m4f, ...; may be repeated.")] = None,
    contract: Annotated[
        bool,
        typer.Option(
            "--contract",
            help="Compile with fused products and sums; words may differ by a thousandth of a deviation.",
        ),
    ] = False,
    log: Annotated[
        Path | None, typer.Option(metavar="LOG", help="Prove it on this log instead of a simulated motion.")
    ] = None,
    columns: Columns = None,
    json: Json = None,
    report: Report = None,
) -> None:
    """Compile, run on host and emulated cores, compare every word, count instructions, stack and code."""
    from kfgen.emit.folder import read_folder
    from kfgen.report.proof import verify_answer
    from kfgen.verify.compare import verify as verified
    from kfgen.verify.rounding import over_log

    emitted = read_folder(folder)
    data = None if log is None else read(log, None, columns)
    played, beside = (None, None) if data is None else over_log(emitted.program, data)
    verdicts = verified(emitted, core or ["host"], contract, played)
    deliver(verify_answer(emitted.program.discrete.hash, verdicts, beside), json, report)
