"""The command ``denoise``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from kfgen.cli import options as opt
from kfgen.cli.app import app
from kfgen.cli.options import deliver, listed, read

FILTER = typer.Option(help="The rule of adaptation: kf, iae, iae-q, sage-husa, shafkf-p or shafkf-r.")
AT_REST = typer.Option(metavar="LOG", help="Estimate the noise from this log at rest, not from LOG itself.")
ORDER = typer.Option(help="The order p,q of the ARMA process; auto chooses by Akaike's criterion.")
ESTIMATOR = typer.Option(help="The estimator of the process: ml, least-squares, burg, ..., see 'kfgen list'.")
WINDOW = typer.Option(help="The number of innovations that a rule looks at.")
RATIO = typer.Option(help="The ratio of R to Q; the paper has 980.")


@app.command()
def denoise(
    log: opt.LogPath,
    filter: Annotated[str, FILTER] = "shafkf-r",
    at_rest: Annotated[Path | None, AT_REST] = None,
    channels: opt.Channels = None,
    order: Annotated[str, ORDER] = "2,1",
    estimator: Annotated[str, ESTIMATOR] = "ml",
    window: Annotated[int, WINDOW] = 15,
    ratio: Annotated[float, RATIO] = 980.0,
    rate: opt.Rate = None,
    columns: opt.Columns = None,
    output: opt.Output = None,
    json: opt.Json = None,
    report: opt.Report = None,
) -> None:
    """The adaptive filters of Narasimhappa 2019 on a log, with what they cost under motion."""
    from kfgen.log.readers import write_log
    from kfgen.report.denoise import denoise_answer
    from kfgen.run.adaptive.denoise_log import denoise
    from kfgen.run.adaptive.rules import rule_named

    rule_named(filter)
    data = read(log, rate, columns)
    still = read(at_rest, rate, columns) if at_rest else None
    how = {"order": order, "estimator": estimator, "window": window, "ratio": ratio}
    found = denoise(data, filter, listed(channels), still, **how)  # type: ignore[arg-type]
    if output:
        write_log(found.log, output)
    deliver(denoise_answer(found), json, report)
