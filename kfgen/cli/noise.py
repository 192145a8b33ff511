"""Commands on noise files: plan, convert."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from kfgen.cli.app import app
from kfgen.cli.options import Json, Report, SampleRate, deliver, not_over

NoisePath = Annotated[Path, typer.Argument(metavar="NOISE.toml", help="As 'identify -o' writes it.")]


@app.command()
def plan(
    noise: NoisePath,
    rate: SampleRate = 100.0,
    wanted: Annotated[float, typer.Option(help="Wanted relative deviation.")] = 0.2,
    json: Json = None,
    report: Report = None,
) -> None:
    """How long to log for a wanted accuracy: the Cramér-Rao bound against the length of the record."""
    from kfgen.core.errors import InputError
    from kfgen.effects.noise_model import read_noise
    from kfgen.report.plan import plan_answer

    if not 0.0 < wanted < 10.0 or not 0.0 < rate < float("inf"):
        raise InputError(
            "an accuracy and a rate are positive numbers", remedy="Give --wanted 0.2 --rate 100, say"
        )
    deliver(plan_answer(read_noise(noise), rate, wanted), json, report)


@app.command()
def convert(
    noise: NoisePath,
    to: Annotated[str, typer.Option(help="The consumer, see 'kfgen list'.")],
    rate: Annotated[float | None, typer.Option(help="The rate that the consumer works at [Hz].")] = None,
    safety: Annotated[float, typer.Option(help="Multiplies every size.")] = 1.0,
    output: Annotated[Path | None, typer.Option("-o", "--output", metavar="FILE")] = None,
    json: Json = None,
    report: Report = None,
) -> None:
    """Noise parameters in the file and the convention of a program that consumes them."""
    import hashlib

    from kfgen.consumers import convert as converted
    from kfgen.core.whole_file import write_text
    from kfgen.effects.noise_model import read_noise
    from kfgen.report.convert import Request, convert_answer

    model = read_noise(noise)
    not_over(output, noise)
    made = converted(model, to, rate=rate, safety=safety, origin=noise.name)
    sha256 = hashlib.sha256(noise.read_bytes()).hexdigest()
    name = str(noise).encode("utf-8", "replace").decode()
    request = Request(name, sha256, to, rate, safety, str(output) if output else "")
    answer = convert_answer(model, made, request)
    if output is not None:
        write_text(output, made.text + "\n")
    deliver(answer, json, report)
