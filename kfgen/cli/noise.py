"""Commands on noise files: plan, convert."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from kfgen.cli.app import app
from kfgen.cli.options import Json, NoisePath, Output, Report, SampleRate, Sensors, Set, deliver, model_of

NOISE = typer.Argument(metavar="[NOISE.toml]", help="The noise file; --between: of the filter's channels.")
WANTED = typer.Option(help="The relative standard deviation that is asked for, 0.2 where left out.")
BETWEEN = typer.Option(metavar="A,B", help="The manoeuvre that distinguishes effects EFFECT@PLACE[=SIZE].")
FLOWN = typer.Option(metavar="FILTER", help="The filter of --between, a name of 'kfgen list' or a file.")
SPEED = typer.Option(help="Speed of the manoeuvres that begin at one [m/s].")
ROOM = typer.Option(help="Leave out manoeuvres that are wider [m].")
Consumer = Annotated[str, typer.Option(help="The program that takes the parameters, see 'kfgen list'.")]
ConsumerRate = Annotated[float | None, typer.Option(help="The rate [Hz] on which its numbers depend.")]
Safety = Annotated[float, typer.Option(help="A factor on every size.")]


@app.command()
def plan(
    noise: Annotated[Path | None, NOISE] = None,
    rate: SampleRate = 100.0,
    wanted: Annotated[float | None, WANTED] = None,
    between: Annotated[str | None, BETWEEN] = None,
    model: Annotated[str | None, FLOWN] = None,
    speed: Annotated[float | None, SPEED] = None,
    room: Annotated[float | None, ROOM] = None,
    set_: Set = None,
    sensor: Sensors = None,
    json: Json = None,
    report: Report = None,
) -> None:
    """Plan how long to log, or which manoeuvre to fly. For an accuracy of noise; or to distinguish two effects."""
    from kfgen.report.plan import between_answer, record_answer

    flown: dict[str, object] = {"--between": between, "--model": model, "--speed": speed, "--room": room}
    if between is None or model is None:
        flown |= {"--set": set_, "--sensor": sensor}
        return deliver(record_answer(noise, rate, wanted, flown), json, report)
    built = model_of(model, noise, set_, sensor)
    deliver(between_answer(between, built, rate, speed, room, wanted), json, report)


@app.command()
def convert(
    noise: NoisePath,
    to: Consumer,
    rate: ConsumerRate = None,
    safety: Safety = 1.0,
    output: Output = None,
    json: Json = None,
    report: Report = None,
) -> None:
    """Convert noise to the file of another program. Numbers are in its convention; what it lacks is said."""
    from kfgen.consumers import convert
    from kfgen.core.files.whole_file import write_text
    from kfgen.report.convert import convert_answer

    made = convert(noise, to, rate=rate, safety=safety)
    if output is not None:
        write_text(output, made.text + "\n")
    deliver(convert_answer(made, str(output or "")), json, report)
