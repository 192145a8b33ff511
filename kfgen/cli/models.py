"""Commands on models: list, derive, audit, emit, verify."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Annotated, Any

import typer

from kfgen.cli import options as opt
from kfgen.cli.app import app
from kfgen.cli.options import deliver, model_of, read

DIR = typer.Argument(metavar="DIR", help="The folder of the filter, as 'emit' wrote it.")
FORMAT = typer.Option(help="How matrices are printed: text, latex or mathml.")
MANOEUVRE = typer.Option(help="A manoeuvre of 'kfgen list' or a file (.toml); repeatable. At rest without.")
DURATION = typer.Option(help="How long is measured [s]; each manoeuvre's own length where left out.")
WANT = typer.Option(help="Say when a standard deviation is reached: 'phi_D=0.1 deg'; repeatable.")
SEEN = typer.Option(metavar="LOG", help="Say how well each state shows in this log.")
TARGET = typer.Option(help="The language of the code, see 'kfgen list'.")
OUTPUT = typer.Option("-o", "--output", metavar="DIR", help="A new folder, or that of an emitted filter.")
FORM = typer.Option(help="Store UD factors, never indefinite (ud; not of filterpy), or the covariance (p).")
REAL = typer.Option(help="The type of the numbers: float or double.")
LOOPS = typer.Option("--loops", help="Write loops: less code, more instructions.")
FORCE = typer.Option("--force", help="Replace also files of the folder that you changed.")
Q_INTERVAL = typer.Option(
    help="Add noise of biases every SECONDS (UD form only); 1 by default, 0: each step."
)
HORIZON = typer.Option(help="Fuse stamped measurements up to this age [s]; by default of the longest delay.")
WITHOUT = typer.Option(metavar="PART", help="Leave out a part of the supervisor (docs/emit.md); repeatable.")
LANES = typer.Option("--lanes", help="With hooks for firmware that has several filters (docs/emit.md).")
COUNTED = typer.Option(help="Count instructions, stack and code on this core (m4f); repeatable.")
CORE = typer.Option(help="Run on this core (host, m4f, ...), see 'kfgen list'; repeatable.")
CONTRACT = typer.Option("--contract", help="Fuse products and sums: equal within 1e-3 standard deviations.")
LISTED = typer.Argument(metavar="[LOG]", help="A log: say what is inside, with rates, gaps and clocks.")
FAULTS = typer.Option("--faults", help="Fly simulated faults: what is reported, when it is right again.")
BOUNDS = typer.Option("--bounds", help="Bound every operation whatever the input, and make hostile calls.")
SENSOR_RATE = typer.Option(
    metavar="NAME=HZ", help="How often a sensor has a sample, for a second's instructions; repeatable."
)
REPLAYED = typer.Option(metavar="LOG", help="Make the calls of this log, not simulated ones.")


@app.command("list")
def list_(
    log: Annotated[Path | None, LISTED] = None,
    rate: opt.Rate = None,
    columns: opt.Columns = None,
    topic: opt.Topic = "",
    instance: opt.Instance = None,
    json: opt.Json = None,
    report: opt.Report = None,
) -> None:
    """List models, sensors, effects; or what is inside a log."""
    from kfgen.report.catalogue import listed_answer

    deliver(listed_answer(log, rate=rate, columns=columns, topic=topic, instance=instance), json, report)


@app.command()
def derive(
    model: opt.ModelName,
    noise: opt.Noise = None,
    set_: opt.Set = None,
    sensor: opt.Sensors = None,
    format: Annotated[str, FORMAT] = "text",
    order: opt.Order = 1,
    rate: opt.SampleRate = 100.0,
    json: opt.Json = None,
    report: opt.Report = None,
) -> None:
    """Derive states, F, G, H, Phi and Qd of a model."""
    from kfgen.model.derive import derive
    from kfgen.report.model import derive_answer

    model_ = model_of(model, noise, set_, sensor)
    deliver(derive_answer(derive(model_, rate=rate, order=order), format), json, report)


@app.command()
def audit(
    model: opt.ModelName,
    noise: opt.Noise = None,
    set_: opt.Set = None,
    sensor: opt.Sensors = None,
    manoeuvre: Annotated[list[str] | None, MANOEUVRE] = None,
    duration: Annotated[float | None, DURATION] = None,
    rate: opt.SampleRate = 100.0,
    want: Annotated[list[str] | None, WANT] = None,
    log: Annotated[Path | None, SEEN] = None,
    columns: opt.Columns = None,
    json: opt.Json = None,
    report: opt.Report = None,
) -> None:
    """Say which states are unobservable, and what would help. Also how well the others show."""
    from kfgen.report.audit import audit_answer
    from kfgen.run.audit import audit

    names = manoeuvre or []
    data = read(log, None, columns) if log is not None and not names else log
    built = model_of(model, noise, set_, sensor)
    files = [model, str(noise or "")]
    found = audit(built, names, duration=duration, rate=rate, log=data, want=want or (), files=files)
    deliver(audit_answer(found), json, report)


@app.command()
def emit(
    model: opt.ModelName,
    target: Annotated[str, TARGET],
    output: Annotated[Path, OUTPUT],
    noise: opt.Noise = None,
    form: Annotated[str | None, FORM] = None,
    real: Annotated[str, REAL] = "float",
    loops: Annotated[bool, LOOPS] = False,
    q_interval: Annotated[float | None, Q_INTERVAL] = None,
    horizon: Annotated[float | None, HORIZON] = None,
    without: Annotated[list[str] | None, WITHOUT] = None,
    lanes: Annotated[bool, LANES] = False,
    core: Annotated[list[str] | None, COUNTED] = None,
    force: Annotated[bool, FORCE] = False,
    set_: opt.Set = None,
    sensor: opt.Sensors = None,
    order: opt.Order = 1,
    max_step: opt.MaxStep = None,
    rate: opt.SampleRate = 100.0,
    json: opt.Json = None,
    report: opt.Report = None,
) -> None:
    """Emit the filter as code, with its self-test."""
    from kfgen.emit.emit import emit
    from kfgen.report.filter import emit_answer
    from kfgen.verify.compare import costs

    how: Any = {"rate": rate, "order": order, "max_step": max_step, "loops": loops, "q_interval": q_interval}
    built = model_of(model, noise, set_, sensor)
    how |= {"horizon": horizon, "without": without or (), "lanes": lanes, "force": force}
    how |= {"costs": partial(costs, names=core) if core else None}
    deliver(emit_answer(emit(built, output, target, form, real, **how)), json, report)


@app.command()
def verify(
    folder: Annotated[Path, DIR],
    core: Annotated[list[str] | None, CORE] = None,
    contract: Annotated[bool, CONTRACT] = False,
    log: Annotated[Path | None, REPLAYED] = None,
    faults: Annotated[bool, FAULTS] = False,
    bounds: Annotated[bool, BOUNDS] = False,
    sensor_rate: Annotated[list[str] | None, SENSOR_RATE] = None,
    columns: opt.Columns = None,
    json: opt.Json = None,
    report: opt.Report = None,
) -> None:
    """Prove emitted code on host and emulated cores. Compares bit patterns, counts instructions, stack and code."""
    from kfgen.report.proof import folder_answer

    data = None if log is None else read(log, None, columns)
    compared = {"log": data, "contract": contract, "sensor_rates": opt.sensor_rates(sensor_rate)}
    answer = folder_answer(folder, core or ["host"], faults=faults, bounded=bounds, **compared)
    deliver(answer, json, report)
