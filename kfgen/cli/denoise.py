"""The command ``denoise``."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from kfgen.cli.app import app
from kfgen.cli.options import Columns, Json, LogPath, Rate, Report, deliver, not_over, read


def _order(text: str) -> tuple[int, int] | None:
    from kfgen.core.errors import InputError

    if text == "auto":
        return None
    parts = text.split(",")
    if len(parts) != 2 or not all(p.strip().isdigit() for p in parts) or max(map(int, parts)) > 20:
        raise InputError(f"'{text}' is no order", where="--order", remedy="Write it like 2,1, or auto")
    return int(parts[0]), int(parts[1])


@app.command()
def denoise(
    log: LogPath,
    filter: Annotated[
        str, typer.Option(help="kf, iae, iae-q, sage-husa, shafkf-p or shafkf-r.")
    ] = "shafkf-r",
    at_rest: Annotated[
        Path | None,
        typer.Option(metavar="LOG", help="A log at rest that tells the noise; this one when left out."),
    ] = None,
    channels: Annotated[str | None, typer.Option(help="Only these, separated by commas.")] = None,
    order: Annotated[str, typer.Option(help="Of the ARMA process, p,q; auto by Akaike's criterion.")] = "2,1",
    estimator: Annotated[
        str, typer.Option(help="ml, least-squares, modified-yule-walker, burg, yule-walker, ...")
    ] = "ml",
    window: Annotated[int, typer.Option(help="Innovations that a rule looks at.")] = 15,
    ratio: Annotated[float, typer.Option(help="R over Q; 980 in the paper.")] = 980.0,
    rate: Rate = None,
    columns: Columns = None,
    output: Annotated[Path | None, typer.Option("-o", "--output", metavar="LOG")] = None,
    json: Json = None,
    report: Report = None,
) -> None:
    """The adaptive filters of Narasimhappa 2019 on a log, with what they cost under motion."""
    from kfgen.core.errors import InputError
    from kfgen.log.log import Channel
    from kfgen.log.readers import write_log
    from kfgen.report.denoise import denoise_answer
    from kfgen.run.adaptive.denoise import Settings
    from kfgen.run.adaptive.denoise import at_rest as resting
    from kfgen.run.adaptive.denoise import denoise as denoised
    from kfgen.run.adaptive.rules import rule_named

    rule_named(filter)
    if not 0.0 < ratio < float("inf"):
        raise InputError(f"a ratio of {ratio:g} is none", where="--ratio", remedy="Give a positive number")
    settings = Settings(filter, _order(order), estimator, window, ratio)
    for source in (log, at_rest):
        if source is not None:
            not_over(output, source)
    data = read(log, rate, columns)
    still = read(at_rest, rate, columns) if at_rest else data
    wanted = [c.strip() for c in channels.split(",")] if channels else [
        c for c in data.channels if c.startswith(("gyro", "accel"))
    ]  # fmt: skip
    if not wanted:
        raise InputError(
            f"there is no gyro or accel among {', '.join(data.channels)}",
            where=data.source,
            remedy="Name channels with --channels",
        )
    dt, found, filtered = data.uniform_dt(), {}, dict(data.channels)
    for name in wanted:
        try:
            rest = resting(still.channel(name).values, settings)
            found[name] = denoised(data.channel(name).values, dt, settings, rest)
        except InputError as error:
            where = error.where or f"{still.source}: channel {name}"
            raise InputError(error.what, where=where, remedy=error.remedy) from None
        filtered[name] = Channel(found[name].values, data.channels[name].unit)
    answer = denoise_answer(data, found, settings)
    if output:
        write_log(replace(data, channels=filtered), output)
    deliver(answer, json, report)
