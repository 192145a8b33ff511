"""The command on many logs: fleet."""

from __future__ import annotations

from contextlib import nullcontext
from pathlib import Path
from typing import Annotated

import typer

from kfgen.cli.app import app
from kfgen.cli.options import Columns, Json, Output, Rate, Report, deliver
from kfgen.core.elapsed import count

Logs = Annotated[list[str], typer.Argument(metavar="GLOB...", help="One log of each sensor: 'logs/*.csv'.")]
Model = Annotated[str | None, typer.Option(help="Assumed of each: then as 'gap', else as 'identify'.")]
Scheduler = Annotated[str | None, typer.Option(help="Address of a Dask cluster that sees the same paths.")]
Jobs = Annotated[int, typer.Option(min=0, help="Processes on this machine; 0: one a processor.")]
Table = Annotated[Path | None, typer.Option(help="Every number of every log as Parquet (.parquet).")]
Channels = Annotated[str | None, typer.Option(help="Only these, separated by commas.")]


@app.command()
def fleet(
    logs: Logs,
    model: Model = None,
    scheduler: Scheduler = None,
    jobs: Jobs = 0,
    channels: Channels = None,
    rate: Rate = None,
    columns: Columns = None,
    output: Output = None,
    table: Table = None,
    json: Json = None,
    report: Report = None,
) -> None:
    """Compare many sensors of one kind, a log of each. -o writes what they have in common; outliers are named."""
    from kfgen.fleet.fleet import fleet as over_fleet
    from kfgen.fleet.fleet_table import check_wanted, write_fleet
    from kfgen.fleet.journal import Journal
    from kfgen.report.fleet import fleet_answer

    check_wanted(model, output, table)
    read_as = {"channels": channels, "rate": rate, "columns": columns}
    with Journal.beside(json, output, report, table) or nullcontext() as journal:
        how = {"jobs": jobs, "scheduler": scheduler, "progress": count, "journal": journal, **read_as}
        found = over_fleet(logs, model, **how)  # type: ignore[arg-type]
        write_fleet(found, output, table)
        deliver(fleet_answer(found), json, report)
