"""The application: its commands register themselves on import."""

from __future__ import annotations

from typing import Annotated

import typer

import kfgen

app = typer.Typer(
    name="kfgen",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    help="From a log of a real sensor to a Kalman filter that is proven on its target.",
)


def _version(wanted: bool) -> None:
    if wanted:
        print(f"kfgen {kfgen.__version__}")
        raise typer.Exit


@app.callback()
def top(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Show the version.")
    ] = False,
) -> None:
    """From a log of a real sensor to a Kalman filter that is proven on its target."""


from kfgen.cli import denoise, fleet, gap, logs, models, noise  # noqa: E402, F401 - commands register on import
from kfgen.cli.guard import Guarded  # noqa: E402

for command in app.registered_commands:
    command.cls = Guarded
