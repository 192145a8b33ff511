"""The application: its commands register themselves on import."""

from __future__ import annotations

from typing import Annotated, Any

import typer
from typer.core import TyperCommand

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


class Guarded(TyperCommand):
    """A command that proves its outputs against its inputs first, and writes all of them or none."""

    def invoke(self, ctx: Any) -> Any:
        """Prove the outputs, then run the command."""
        from kfgen.core.outputs import GivenParameter, outputs_together

        given = [GivenParameter(str(p.name), p.opts[0], ctx.params.get(str(p.name))) for p in self.params]
        with outputs_together(given):
            return super().invoke(ctx)


from kfgen.cli import denoise, fleet, gap, logs, models, noise  # noqa: E402, F401 - commands register on import

for command in app.registered_commands:
    command.cls = Guarded
