"""The application: its commands register themselves on import."""

from __future__ import annotations

from typing import Annotated, Any

import typer
from typer.core import TyperCommand, TyperGroup

import kfgen
from kfgen.core.elapsed import be_quiet, elapsed_time
from kfgen.report.help import CommandHelp, GroupHelp


class Groups(GroupHelp, TyperGroup):
    """The commands in groups, and examples."""


app = typer.Typer(
    name="kfgen",
    cls=Groups,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)


def _version(wanted: bool) -> None:
    if wanted:
        print(f"kfgen {kfgen.__version__}")
        raise typer.Exit


VERSION = typer.Option("--version", callback=_version, is_eager=True, help="Show the version.")
QUIET = typer.Option("--quiet", help="Say only the answer and errors: no warnings, no progress. Anywhere.")


@app.callback()
def top(version: Annotated[bool, VERSION] = False, quiet: Annotated[bool, QUIET] = False) -> None:
    """From a log of a real sensor to a Kalman filter that is proven on its target."""
    be_quiet(quiet)


class Guarded(CommandHelp, TyperCommand):
    """A command that proves its outputs against its inputs first, writes all or none."""

    def invoke(self, ctx: Any) -> Any:
        """Prove the outputs, then run the command."""
        from kfgen.core.files.outputs import GivenParameter, outputs_together

        given = [GivenParameter(str(p.name), p.opts[0], ctx.params.get(str(p.name))) for p in self.params]
        with outputs_together(given), elapsed_time(ctx.command_path):
            return super().invoke(ctx)


from kfgen.cli import fleet, gap, logs, models, noise  # noqa: E402, F401 - commands register on import

for command in app.registered_commands:
    command.cls = Guarded
