"""Commands on noise files: plan, convert."""

from __future__ import annotations

from typing import Annotated

import typer

from kfgen.cli.app import app
from kfgen.cli.options import Json, NoisePath, Output, Report, SampleRate, deliver

Wanted = Annotated[float, typer.Option(help="The relative standard deviation that is asked for.")]
Consumer = Annotated[str, typer.Option(help="The program that takes the parameters, see 'kfgen list'.")]
ConsumerRate = Annotated[float | None, typer.Option(help="The rate [Hz] on which its numbers depend.")]
Safety = Annotated[float, typer.Option(help="A factor on every size.")]


@app.command()
def plan(
    noise: NoisePath,
    rate: SampleRate = 100.0,
    wanted: Wanted = 0.2,
    json: Json = None,
    report: Report = None,
) -> None:
    """How long to log for a wanted accuracy: the Cramér-Rao bound against the length of the record."""
    from kfgen.identify.plan import plan
    from kfgen.report.plan import plan_answer

    deliver(plan_answer(plan(noise, rate, wanted)), json, report)


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
    """Noise parameters in the file and the convention of a program that consumes them."""
    from kfgen.consumers import convert
    from kfgen.core.files.whole_file import write_text
    from kfgen.report.convert import convert_answer

    made = convert(noise, to, rate=rate, safety=safety)
    if output is not None:
        write_text(output, made.text + "\n")
    deliver(convert_answer(made, str(output or "")), json, report)
