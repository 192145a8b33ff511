"""Options that commands share, and how an answer is delivered."""

from __future__ import annotations

import hashlib
import json
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from kfgen.effects.noise_model import NoiseModel
    from kfgen.log.log import Log
    from kfgen.model.filter import FilterModel
    from kfgen.report.page import Answer

    Array = NDArray[np.float64]

LogPath = Annotated[Path, typer.Argument(metavar="LOG", help="A log: CSV or NPZ.")]
ModelName = Annotated[str, typer.Argument(metavar="MODEL", help="A library model, see 'kfgen list'.")]
Rate = Annotated[float | None, typer.Option(help="Sampling rate [Hz]; replaces the log's own time.")]
Columns = Annotated[
    str | None,
    typer.Option(help="Foreign columns as channels: 'gyro_x=gx [deg/s/131], accel_x=#1 [g/16384]'."),
]
Noise = Annotated[Path | None, typer.Option(help="A noise file, as 'identify -o' writes it.")]
Output = Annotated[Path | None, typer.Option("-o", "--output", metavar="FILE", help="Where to write.")]
Json = Annotated[
    str | None, typer.Option("--json", metavar="FILE", help="The answer as JSON; - for standard output.")
]
Report = Annotated[Path | None, typer.Option(metavar="FILE.html", help="The answer as a page.")]
Order = Annotated[int, typer.Option(help="Order in the step of the motion's coupling, 1 to 3.")]
MaxStep = Annotated[
    float | None, typer.Option(help="Longest step [s]; 0.1, or what the fastest effect allows.")
]
Set = Annotated[
    list[str] | None,
    typer.Option(
        "--set", metavar="NAME=VALUE", help="An option of the model, see 'kfgen list'; may be repeated."
    ),
]
Sensors = Annotated[
    list[str] | None,
    typer.Option("--sensor", metavar="NAME", help="A sensor, instead of the model's own; may be repeated."),
]
SampleRate = Annotated[float, typer.Option("--rate", help="Rate of the sensors [Hz].")]


def read(path: Path, rate: float | None, columns: str | None) -> Log:
    """A log with its columns mapped."""
    from kfgen.core.errors import InputError
    from kfgen.log.readers import ColumnMap, read_log

    log = read_log(path, rate=rate, columns=ColumnMap.parse(columns) if columns else None)
    if log.axis != "t":
        raise InputError("it is an Allan curve and no log", where=str(path), remedy="Give the log itself")
    return log


def noise_of(path: Path | None) -> NoiseModel | None:
    """The noise file, where one is given."""
    from kfgen.effects.noise_model import read_noise

    return read_noise(path) if path else None


def model_of(model: str, noise: Path | None, set_: list[str] | None, sensor: list[str] | None) -> FilterModel:
    """A library model with its noise and what was chosen of its options."""
    from kfgen.core.errors import InputError
    from kfgen.model.library import build
    from kfgen.model.option import read_pairs

    options = read_pairs(set_ or ())
    if sensor and "sensors" in options:
        raise InputError(
            "the sensors are given twice", where="--sensor", remedy="Give --sensor or --set sensors"
        )
    return build(model, noise_of(noise), options | ({"sensors": ",".join(sensor)} if sensor else {}))


def ran_over(model: FilterModel, log: Log) -> tuple[FilterModel, Array, Array]:
    """A filter over a log: the model with the sensors that the log has, times [s], deviations (n, states) [SI]."""
    from dataclasses import replace

    import numpy as np

    from kfgen.emit.routines import Program
    from kfgen.model.discretise import DiscreteModel
    from kfgen.run.filter_calls import rates_in
    from kfgen.run.run import run

    longest = max(0.1, 1.001 * float(np.diff(log.t).max(initial=log.dt)))
    rates = rates_in(log, model)
    result = run(Program(DiscreteModel.at_rate(model, 1.0 / log.dt, max_step=longest, rates=rates)), log)
    present = tuple(s for s in model.sensors if s.name in result.sensors)
    return replace(model, sensors=present), log.t, result.deviation


def hashes(files: Iterable[Path]) -> dict[str, str]:
    """SHA-256 of the files that were read, by name."""
    return {str(f): hashlib.sha256(f.read_bytes()).hexdigest() for f in files}


def not_over(output: Path | None, source: Path) -> None:
    """An output must not overwrite what the command reads."""
    from kfgen.core.errors import InputError

    if output is not None and output.resolve() == source.resolve():
        raise InputError("the output would overwrite the input", where=str(output), remedy="Give another -o")


def deliver(answer: Answer, json_to: str | None, report: Path | None) -> None:
    """Print an answer, write what was asked for, and exit with 1 when a check failed."""
    from kfgen.core.whole_file import write_text
    from kfgen.report.page import write_page

    for warning in answer.warnings:
        print(f"warning: {warning}", file=sys.stderr)
    if report is not None:
        write_page(answer.page, report)
    data = json.dumps(answer.data, indent=1, allow_nan=False) if json_to else ""
    if json_to and json_to != "-":
        write_text(json_to, data + "\n")
    print(data if json_to == "-" else answer.text)
    if not answer.ok:
        raise typer.Exit(1)


def listed(text: str | None) -> list[str] | None:
    """Names separated by commas."""
    return [part.strip() for part in text.split(",") if part.strip()] if text else None
