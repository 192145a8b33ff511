"""`Guarded`: a command that proves its outputs against its inputs first, and writes all of them or none."""

from __future__ import annotations

from typing import Any

from typer.core import TyperCommand


class Guarded(TyperCommand):
    """A command whose outputs appear together, when it delivers its answer."""

    def invoke(self, ctx: Any) -> Any:
        """Prove the outputs, then run the command."""
        from kfgen.core.outputs import GivenParameter, outputs_together

        given = [GivenParameter(str(p.name), p.opts[0], ctx.params.get(str(p.name))) for p in self.params]
        with outputs_together(given):
            return super().invoke(ctx)
