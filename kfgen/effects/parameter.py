"""`Parameter`: a number of an effect, declared with its unit and its kind."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True)
class Parameter:
    """A parameter of an effect.

    Parameters
    ----------
    name : str
        Its letter in the literature.
    unit : str
        Unit template, ``U`` being the unit of the channel.
    kind : str
        ``size`` scales the output (zero: no effect), ``time`` is a time constant, ``frequency`` and
        ``ratio`` say so, ``corner`` is a frequency that may lie above half the sampling rate, ``slope``
        is how steeply a spectrum falls: these are positive and fitted in their logarithm. ``width`` is searched on a grid,
        ``signed`` is a coefficient that may be negative, ``solved`` follows from coefficients (an
        amplitude), ``place`` is where in time or frequency it is: looked for, then held. ``setting`` is
        chosen and never estimated.
    """

    name: str
    unit: str
    kind: str

    @property
    def is_phase(self) -> bool:
        """Whether it is an angle of an oscillation: the same after a turn, and another in the next record."""
        return self.kind == "solved" and self.unit == "rad"


def parameter(unit: str, kind: str = "size", default: Any = ...) -> Any:
    """Declare a parameter of an effect (a dataclass field with its unit and kind)."""
    metadata = {"unit": unit, "kind": kind}
    return field(metadata=metadata) if default is ... else field(default=default, metadata=metadata)
