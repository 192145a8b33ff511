"""Commands on logs: identify, simulate, run, demo."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from kfgen.cli.app import app
from kfgen.cli.options import (
    Columns,
    Json,
    LogPath,
    ModelName,
    Noise,
    Output,
    Rate,
    Report,
    Sensors,
    Set,
    deliver,
    listed,
    model_of,
    not_over,
    read,
)

if TYPE_CHECKING:
    from kfgen.identify.evidence.record import Evidence
    from kfgen.identify.identify import Identified
    from kfgen.log.log import Log, StoredLog

BAND = ("_lo", "_hi")
DEFAULT_RATE_HZ = 100.0
"""Of a simulated log [Hz]."""
NOT_NOISY = ("ref_", "temperature", "movement", "input", "voltage")


def _evidence(logs: Sequence[Log | StoredLog], name: str) -> tuple[Evidence, list[str]]:
    """A channel of one log or of several, or a published curve, and what is to be said of its sampling."""
    from kfgen.core.errors import InputError
    from kfgen.core.units import parse_unit
    from kfgen.identify.evidence.joint import JointRecord
    from kfgen.identify.evidence.record import Record
    from kfgen.identify.evidence.sampling import evidence
    from kfgen.log.log import Log

    first = logs[0]
    if len(logs) == 1 and not isinstance(first, Log):
        return _condensed(first, name), []
    if isinstance(first, Log) and first.axis == "tau":
        return _published(first, name), []
    if len({log.sha256 for log in logs}) < len(logs):
        raise InputError("a log is given twice", where=first.source, remedy="Give each log once")
    parts, said = [], []
    for log in logs:
        if not parse_unit(log.channel(name).unit).same_dimension(parse_unit(first.channel(name).unit)):
            raise InputError(
                f"channel {name} is in {log.channel(name).unit} here, in {first.channel(name).unit} in {first.source}",
                where=log.source,
            )
        if not isinstance(log, Log):
            raise InputError("a log too long for memory is identified alone", where=log.source)
        drive = {"temperature": log.channels["temperature"].values} if "temperature" in log.channels else {}
        part, words = evidence(log.t, log.channel(name).values, drive)
        said += [f"{log.source}: {w}" if len(logs) > 1 else w for w in words]
        parts.append(part)
    if len(parts) == 1:
        return parts[0], said
    even = tuple(p for p in parts if isinstance(p, Record))
    if len(even) < len(parts):
        raise InputError(
            "a log with gaps or uneven time cannot be fitted together with others",
            remedy="Identify it alone, or cut it at its gaps",
        )
    return JointRecord(even), said


def _condensed(log: StoredLog, name: str) -> Evidence:
    from kfgen.identify.evidence.long import Stream, condense

    channel = log.channel(name)
    return condense(Stream(channel.chunks, channel.n, log.dt))


def _published(log: Log, name: str) -> Evidence:
    from kfgen.core.errors import InputError
    from kfgen.identify.evidence.published import Published

    band = [log.channels[name + end].values for end in BAND if name + end in log.channels]
    if len(band) == 1:
        raise InputError(f"the band of {name} has one end", where=log.source, remedy="Give both, or none")
    return Published.of(log.t, log.channel(name).values, *band)


def channels_identified(
    data: Sequence[Log | StoredLog], channels: str | None, effects: str | None, method: str
) -> dict[str, Identified]:
    """The noise terms of the channels of one log, or of several of one sensor, fitted together.

    Raises
    ------
    InputError
        There is nothing to identify, or a channel cannot be; the log and the channel are said.
    """
    from kfgen.core.errors import InputError
    from kfgen.identify.identify import identify as identified

    first = data[0]
    names = listed(channels) or [
        c
        for c in first.channels
        if not c.startswith(NOT_NOISY) and not (first.axis == "tau" and c.endswith(BAND))
    ]
    if not names:
        raise InputError(
            f"there is nothing to identify among {', '.join(first.channels)}",
            where=first.source,
            remedy="Name channels with --channels",
        )
    found = {}
    for name in names:
        try:
            evidence, said = _evidence(data, name)
            result = identified(evidence, listed(effects), method)
        except InputError as error:
            raise InputError(
                error.what, where=error.where or f"{first.source}: channel {name}", remedy=error.remedy
            ) from None
        found[name] = replace(result, warnings=(*said, *result.warnings))
    return found


@app.command()
def identify(
    logs: Annotated[
        list[Path],
        typer.Argument(
            metavar="LOG...",
            help="Logs of one sensor at rest, fitted together; or an Allan curve with a column tau.",
        ),
    ],
    rate: Rate = None,
    channels: Annotated[str | None, typer.Option(help="Only these, separated by commas.")] = None,
    effects: Annotated[
        str | None,
        typer.Option(help="Exactly these effects, separated by commas; chosen by the data when left out."),
    ] = None,
    method: Annotated[
        str | None,
        typer.Option(
            help="ml (maximum likelihood; the default), kalman (the same, exact at any times), "
            "allan (weighted fit of the Allan curve; the default for a curve), gmwm (wavelet moments), "
            "asymptotes (of the Allan plot), arma (equivalent ARMA model), ekf and em (its state space)."
        ),
    ] = None,
    columns: Columns = None,
    output: Output = None,
    json: Json = None,
    report: Report = None,
) -> None:
    """Noise terms of a log at rest, with intervals; what it cannot tell is said so."""
    from kfgen.core.errors import InputError
    from kfgen.effects.noise_model import write_noise
    from kfgen.log.readers import ColumnMap, read_long
    from kfgen.report.identify import identify_answer, noise_model

    for log in logs:
        not_over(output, log)
    mapped = ColumnMap.parse(columns) if columns else None
    data = [read_long(log, rate=rate, columns=mapped) for log in logs]
    first = data[0]
    if len(data) > 1 and any(d.axis == "tau" for d in data):
        curve = next(d for d in data if d.axis == "tau")
        raise InputError("an Allan curve is identified alone", where=curve.source)
    method = method or ("allan" if first.axis == "tau" else "ml")
    found = channels_identified(data, channels, effects, method)
    answer = identify_answer(data, found)
    if output:
        write_noise(noise_model(data, found, method), output)
    deliver(answer, json, report)


@app.command()
def simulate(
    model: ModelName,
    output: Annotated[Path, typer.Option("-o", "--output", metavar="LOG", help="A .npz or .csv.")],
    duration: Annotated[float, typer.Option(help="Length of the log [s].")] = 60.0,
    rate: Annotated[
        list[str] | None,
        typer.Option(
            metavar="HZ|SENSOR=HZ",
            help="Rate of the inputs and of the log [Hz], 100 where left out; or of a sensor (gnss=5). May be repeated.",
        ),
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the random numbers.")] = 0,
    manoeuvre: Annotated[str, typer.Option(help="See 'kfgen list', or a manoeuvre file (.toml).")] = "static",
    noise: Noise = None,
    set_: Set = None,
    sensor: Sensors = None,
    decoy: Annotated[
        list[str] | None,
        typer.Option(
            metavar="DRIVER",
            help="A driver in the log on which nothing depends (temperature). May be repeated.",
        ),
    ] = None,
    vibration: Annotated[
        str | None,
        typer.Option(
            metavar="ACCELERATION",
            help="Vibration that comes and goes on every axis, for example '0.5 m/s^2'.",
        ),
    ] = None,
    json: Json = None,
    report: Report = None,
) -> None:
    """A log from a model: its sensors at their own rates, and the truth beside them."""
    import numpy as np

    from kfgen.core.units import parse_quantity
    from kfgen.log.readers import write_log
    from kfgen.model.discretise import DiscreteModel
    from kfgen.report.filter import simulate_answer
    from kfgen.simulate.rates import read_rates
    from kfgen.simulate.simulate import simulate as simulated

    of_log, rates = read_rates(rate or (), DEFAULT_RATE_HZ)
    shaken = parse_quantity(vibration, "m/s^2", where="--vibration") if vibration else 0.0
    discrete = DiscreteModel.at_rate(model_of(model, noise, set_, sensor), of_log)
    rng = np.random.default_rng(seed)
    log = simulated(
        discrete, manoeuvre, duration, rng, rates=rates, decoys=tuple(decoy or ()), vibration=shaken
    )
    write_log(log, output)
    deliver(simulate_answer(log, str(output)), json, report)


@app.command()
def run(
    model: ModelName,
    log: LogPath,
    noise: Noise = None,
    adaptive: Annotated[
        str | None, typer.Option(help="Adapt P, Q or R by a rule: see 'kfgen denoise --filter'.")
    ] = None,
    set_: Set = None,
    sensor: Sensors = None,
    rate: Rate = None,
    columns: Columns = None,
    json: Json = None,
    report: Report = None,
) -> None:
    """The emitted filterpy filter over a log: estimates, innovations, NIS."""
    import numpy as np

    from kfgen.emit.routines import Program
    from kfgen.model.discretise import DiscreteModel
    from kfgen.report.filter import run_answer
    from kfgen.run.adaptive.rules import rule_named
    from kfgen.run.adaptive.wrapper import adapted
    from kfgen.run.filter_calls import rates_in
    from kfgen.run.run import attitude_error
    from kfgen.run.run import run as ran

    data = read(log, rate, columns)
    longest = max(0.1, 1.001 * float(np.diff(data.t).max(initial=data.dt)))
    built = model_of(model, noise, set_, sensor)
    rates = rates_in(data, built)
    program = Program(DiscreteModel.at_rate(built, 1.0 / data.dt, max_step=longest, rates=rates))
    rule = rule_named(adaptive, "--adaptive") if adaptive else None
    result = ran(program, data, (lambda emitted: adapted(emitted, rule)) if rule else None)
    deliver(run_answer(result, attitude_error(result, data), data), json, report)


@app.command()
def demo(
    out: Annotated[Path, typer.Option(metavar="DIR", help="Folder of the results.")] = Path("kfgen-demo"),
    json: Json = None,
) -> None:
    """The whole chain on a simulated sensor with a hidden effect; ends at a report."""
    from kfgen.demo import run_demo

    answer = run_demo(out, lambda line: print(line, file=sys.stderr))
    deliver(answer, json, None)
