"""Options that commands share, and how an answer is delivered."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from kfgen.core.elapsed import end_elapsed_time, warn
from kfgen.core.errors import InputError
from kfgen.core.terminal import INTERRUPTED, first_interrupt
from kfgen.core.time_budget import end_search, forget_end, is_ended_by_user

if TYPE_CHECKING:
    from kfgen.log.log import Log
    from kfgen.model.filter import FilterModel
    from kfgen.report.page import Answer

of_model, of_log, of_answer = (
    partial(typer.Option, rich_help_panel=p) for p in ("Model", "How the log is read", "Answer")
)
LogPath = Annotated[Path, typer.Argument(metavar="LOG", help="The log, in a format of 'kfgen list'.")]
ModelName = Annotated[str, typer.Argument(metavar="MODEL", help="One of 'kfgen list', or a file (.toml).")]
NoisePath = Annotated[Path, typer.Argument(metavar="NOISE.toml", help="The noise file of 'identify -o'.")]
Rate = Annotated[float | None, of_log(help="Sampling rate [Hz] in place of the log's own time.")]
SampleRate = Annotated[float, of_model("--rate", help="The sampling rate of the sensors [Hz].")]
COLUMNS_HELP = "Foreign columns as channels: 'gyro_x=gx [deg/s/131], accel_x=#1 [g/16384]'."
Columns = Annotated[str | None, of_log(help=COLUMNS_HELP)]
Topic = Annotated[str, of_log(help="Topic or message of a flight log to prefer, see 'kfgen list LOG'.")]
Instance = Annotated[int | None, of_log(help="Which of several inertial sensors of a flight log.")]
Channels = Annotated[str | None, typer.Option(help="Only these channels, separated by commas.")]
Noise = Annotated[Path | None, of_model(help="The noise file, as 'identify -o' writes it.")]
OUTPUT = of_answer("-o", "--output", metavar="FILE", help="The file to be written.")
Output = Annotated[Path | None, OUTPUT]
Json = Annotated[str | None, of_answer(metavar="FILE", help="Write the answer as JSON; - to print it.")]
Report = Annotated[Path | None, of_answer(metavar="FILE.html", help="Write the answer as a page.")]
Order = Annotated[int, of_model(help="The order in the step of the motion's coupling, 1 to 3.")]
MAX_STEP_HELP = "The longest step [s]; 0.1, or what the fastest effect allows, where left out."
MaxStep = Annotated[float | None, of_model(help=MAX_STEP_HELP)]
CHOICE = of_model("--set", metavar="NAME=VALUE", help="An option of 'kfgen list'; repeatable.")
Set = Annotated[list[str] | None, CHOICE]
AIDING = of_model(metavar="NAME", help="A sensor, in place of the model's own; repeatable.")
Sensors = Annotated[list[str] | None, AIDING]


def read(path: Path, rate: float | None, columns: str | None, topic: str = "", k: int | None = None) -> Log:
    """A log over time, with its columns mapped and sensor `k` of several."""
    from kfgen.log.readers import log_of, read_log

    return log_of(read_log(path, rate=rate, columns=columns, topic=topic, instance=k))


def model_of(model: str, noise: Path | None, set_: list[str] | None, sensor: list[str] | None) -> FilterModel:
    """A filter model with its noise and what was chosen of its options; what is not in it is said."""
    from kfgen.model.build import build, said_of_noise
    from kfgen.model.option import read_pairs

    built = build(model, noise, read_pairs(set_ or ()), sensor)
    for said in (*(o.sentence for o in built.omitted), *said_of_noise(built)):
        warn(said)
    return built


def sensor_rates(pairs: list[str] | None) -> dict[str, float]:
    """Rates of sensors [Hz] by name, as they are typed."""
    from kfgen.model.option import read_pairs

    found: dict[str, float] = {}
    for name, text in read_pairs(pairs or (), "--sensor-rate").items():
        try:
            found[name] = float(text)
        except ValueError:
            raise InputError(
                f"the rate of {name} must be a number of hertz, not '{text}'",
                where="--sensor-rate",
                remedy=f"Write it like --sensor-rate {name}=10",
            ) from None
    return found


@contextmanager
def best_so_far() -> Iterator[None]:
    """Ctrl-C ends the search inside with the best so far, which is delivered; a second one ends the command at once."""
    forget_end()
    try:
        with first_interrupt(_search_ends):
            yield
    finally:
        forget_end()


def _search_ends() -> bool:
    if not end_search():
        return False
    # Inside the handler of a signal: a buffer may be half written.
    os.write(2, b"\nthe search ends with the best so far; Ctrl-C again ends at once\n")
    return True


def deliver(answer: Answer, json_to: str | None, report: Path | None) -> None:
    """Print an answer, write what was asked for, and exit with 1 when a check failed, with 130 when it is unfinished."""
    from kfgen.core.files.whole_file import publish, write_text
    from kfgen.core.terminal import json_text
    from kfgen.report.page import write_page

    for warning in answer.warnings:
        warn(warning)
    data = json_text(answer.data)
    if report is not None:
        write_page(answer.page, report)
    if json_to and json_to != "-":
        write_text(json_to, data + "\n")
    publish()
    end_elapsed_time()
    print(data if json_to == "-" else answer.shown())
    if is_ended_by_user():
        raise typer.Exit(INTERRUPTED)
    if not answer.ok:
        raise typer.Exit(1)
