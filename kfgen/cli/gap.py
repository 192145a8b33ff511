"""The commands ``gap``, where model and record disagree, and ``judge``, whether a new effect explains it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from kfgen.cli.app import app
from kfgen.cli.options import (
    Channels,
    Columns,
    Instance,
    Json,
    LogPath,
    Output,
    Rate,
    Report,
    Topic,
    best_so_far,
    deliver,
    read,
)

FAIL_ON_GAP = typer.Option("--fail-on-gap", help="End with exit status 3 where model and log disagree.")
LOGS = typer.Argument(metavar="LOG...", help="A log; or several of one sensor at rest, compared together.")
MODEL = typer.Option(help="What is assumed: a noise file, a model file or a library model.")
DECLARATION = typer.Argument(metavar="EFFECT.py", help="Python that declares one effect; it is executed.")
CASES = typer.Option(help="Records that are simulated with it, without it, and with what stands in for it.")
PROOF = typer.Option(help="Another recording of the sensor at rest, to prove it on.")


@app.command()
def gap(
    logs: Annotated[list[Path], LOGS],
    model: Annotated[str, MODEL],
    channels: Annotated[str | None, typer.Option(help="Only these, separated by commas.")] = None,
    fail_on_gap: Annotated[bool, FAIL_ON_GAP] = False,
    proof: Annotated[list[Path] | None, PROOF] = None,
    rate: Rate = None,
    columns: Columns = None,
    topic: Topic = "",
    instance: Instance = None,
    output: Output = None,
    json: Json = None,
    report: Report = None,
) -> None:
    """Find what a model is missing, by name. -o writes the updated model; the mismatch before and after."""
    from kfgen.core.files.whole_file import write_text
    from kfgen.gap.core.result import NO_GAP
    from kfgen.gap.find_gap import find_gap
    from kfgen.log.readers import read_long
    from kfgen.report.gap import gap_answer

    with best_so_far():
        given = [read_long(p, rate=rate, columns=columns, topic=topic, instance=instance) for p in logs]
        another = [read(p, rate, columns, topic, instance) for p in proof or ()]
        found = find_gap(given, model, channels=channels, proof=another)
        if output:
            write_text(output, found.updated_text)
        deliver(gap_answer(found), json, report)
    if fail_on_gap and found.verdict != NO_GAP:
        raise typer.Exit(3)


@app.command()
def judge(
    declaration: Annotated[Path, DECLARATION],
    log: LogPath,
    model: Annotated[str, MODEL],
    channels: Channels = None,
    cases: Annotated[int, CASES] = 8,
    seed: Annotated[int, typer.Option(help="Of the simulated noise.")] = 0,
    rate: Rate = None,
    columns: Columns = None,
    json: Json = None,
    report: Report = None,
) -> None:
    """Judge an effect of your own by a log. Its evidence, the held-out mismatch, recovery and confusions."""
    from kfgen.gap.judge.judge import judge
    from kfgen.report.judge import judge_answer

    data = read(log, rate, columns)
    deliver(
        judge_answer(judge(declaration, data, model, channels=channels, cases=cases, seed=seed)), json, report
    )
