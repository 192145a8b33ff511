"""Commands on models: list, derive, audit, emit, verify."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from kfgen.cli.app import app
from kfgen.cli.options import (
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
    noise_of,
)


@app.command("list")
def list_(json: Json = None, report: Report = None) -> None:
    """Library models, sensors, effects, manoeuvres, targets, cores and consumers of noise parameters."""
    from kfgen.consumers import consumers
    from kfgen.effects import catalogue
    from kfgen.emit import targets
    from kfgen.model.library import LIBRARY, option_rows
    from kfgen.model.sensors import sensors
    from kfgen.report.model import list_answer
    from kfgen.simulate import MANOEUVRES
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
    from kfgen.discretise import DiscreteModel
    from kfgen.errors import InputError
    from kfgen.report.model import derive_answer

    if format not in ("text", "latex", "mathml"):
        raise InputError(
            f"there is no format '{format}'", where="--format", remedy="Known are text, latex, mathml"
        )
    built = model_of(model, noise, set_, sensor)
    deliver(derive_answer(DiscreteModel.stepping(built, rate, order), format), json, report)


@app.command()
def audit(
    model: ModelName,
    noise: Noise = None,
    set_: Set = None,
    sensor: Sensors = None,
    manoeuvre: Annotated[list[str] | None, typer.Option(help="The motion: static.")] = None,
    json: Json = None,
    report: Report = None,
) -> None:
    """What cannot be seen, in words."""
    from kfgen.audit.audit import audit as audited
    from kfgen.errors import InputError
    from kfgen.report.model import audit_answer

    for name in manoeuvre or ():
        if name != "static":
            raise InputError(
                f"the audit knows no manoeuvre '{name}'", where="--manoeuvre", remedy="Known is static"
            )
    deliver(audit_answer([audited(model_of(model, noise, set_, sensor))]), json, report)


@app.command()
def emit(
    model: ModelName,
    target: Annotated[str, typer.Option(help="See 'kfgen list'.")],
    output: Annotated[Path, typer.Option("-o", "--output", metavar="DIR", help="A new folder.")],
    noise: Noise = None,
    form: Annotated[str, typer.Option(help="p: the covariance; ud: its factors, never indefinite.")] = "p",
    real: Annotated[str, typer.Option(help="float or double.")] = "float",
    loops: Annotated[bool, typer.Option("--loops", help="Loops: less code, more instructions.")] = False,
    lump: Annotated[
        float, typer.Option(help="With ud: noise of constant states comes in after so long [s].")
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
    from kfgen.discretise import DiscreteModel
    from kfgen.emit.folder import write_folder
    from kfgen.emit.routines import Program
    from kfgen.report.filter import emit_answer

    built = model_of(model, noise, set_, sensor)
    program = Program(DiscreteModel.stepping(built, rate, order, max_step), form, real, loops, lump)
    if core:
        from kfgen.emit.c import TARGET
        from kfgen.errors import InputError
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
        bool, typer.Option("--contract", help="Compile with fused products and sums; words may then differ.")
    ] = False,
    json: Json = None,
    report: Report = None,
) -> None:
    """Compile, run on host and emulated cores, compare every word, count instructions, stack and code."""
    from kfgen.emit.folder import read_folder
    from kfgen.report.filter import verify_answer
    from kfgen.verify.compare import verify as verified

    emitted = read_folder(folder)
    verdicts = verified(emitted, core or ["host"], contract)
    deliver(verify_answer(emitted.program.discrete.hash, verdicts), json, report)
