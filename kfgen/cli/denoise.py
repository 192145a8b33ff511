"""The command ``denoise``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from kfgen.cli.app import app
from kfgen.cli.options import (
    Channels,
    Columns,
    Json,
    LogPath,
    Output,
    Rate,
    Report,
    deliver,
    listed,
    not_over,
    read,
)

Filter = Annotated[
    str, typer.Option(help="The rule of adaptation: kf, iae, iae-q, sage-husa, shafkf-p or shafkf-r.")
]
Resting = Annotated[
    Path | None,
    typer.Option(
        "--at-rest", metavar="LOG", help="Estimate the noise from this log at rest, not from LOG itself."
    ),
]
ProcessOrder = Annotated[
    str, typer.Option(help="The order p,q of the ARMA process; auto chooses by Akaike's criterion.")
]
Estimator = Annotated[
    str, typer.Option(help="The estimator of the process: ml, least-squares, burg, ..., see 'kfgen list'.")
]
Window = Annotated[int, typer.Option(help="The number of innovations that a rule looks at.")]
Ratio = Annotated[float, typer.Option(help="The ratio of R to Q; the paper has 980.")]


@app.command()
def denoise(
    log: LogPath,
    filter: Filter = "shafkf-r",
    at_rest: Resting = None,
    channels: Channels = None,
    order: ProcessOrder = "2,1",
    estimator: Estimator = "ml",
    window: Window = 15,
    ratio: Ratio = 980.0,
    rate: Rate = None,
    columns: Columns = None,
    output: Output = None,
    json: Json = None,
    report: Report = None,
) -> None:
    """The adaptive filters of Narasimhappa 2019 on a log, with what they cost under motion."""
    from kfgen.log.readers import write_log
    from kfgen.report.denoise import denoise_answer
    from kfgen.run.adaptive.denoise_log import denoise
    from kfgen.run.adaptive.rules import rule_named

    rule_named(filter)
    for source in (log, at_rest):
        if source is not None:
            not_over(output, source)
    data = read(log, rate, columns)
    still = read(at_rest, rate, columns) if at_rest else None
    how = {"order": order, "estimator": estimator, "window": window, "ratio": ratio}
    found = denoise(data, filter, listed(channels), still, **how)  # type: ignore[arg-type]
    if output:
        write_log(found.log, output)
    deliver(denoise_answer(found), json, report)
