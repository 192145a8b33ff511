"""What a core is to the proof: it holds one compiled filter and runs its routines."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from kfgen.emit.geodetic.origin import Border
from kfgen.emit.routines import Program
from kfgen.emit.targets.c import call_arguments
from kfgen.emit.targets.templates import render

DRIVEN = "driven_filter"
"""The filter in the driver: no argument of the header has this name (MISRA C:2012, rule 5.8)."""
Words = NDArray[np.unsignedinteger[Any]]


@dataclass(frozen=True)
class InstructionCount:
    """What the routines cost on a core: exact counts, None where it cannot count.

    Parameters
    ----------
    instructions : dict of str to int
        Executed by a call of each routine, the most of those counted.
    stack_bytes, text_bytes : int or None
        Deepest stack of any call; size of the code.
    stacks, texts : dict of str to int
        The same by routine [B].
    least : dict of str to int
        Executed by a call of each routine, the least of those counted.
    """

    instructions: dict[str, int] = field(default_factory=dict)
    stack_bytes: int | None = None
    text_bytes: int | None = None
    stacks: dict[str, int] = field(default_factory=dict)
    texts: dict[str, int] = field(default_factory=dict)
    least: dict[str, int] = field(default_factory=dict)


@dataclass(frozen=True)
class CoreVerdict:
    """How one core compares.

    Parameters
    ----------
    words, differing : int
        Values compared over all calls, and how many differ: in any bit, or beyond a stated tolerance
        where the target has an arithmetic of its own.
    max_ulp : int
        The largest difference in units of the last place.
    calls : int
    cost : Cost
    tolerance : float
        Zero where every bit counts; else the standard deviations by which a value may differ.
    """

    core: str
    words: int
    differing: int
    max_ulp: int
    calls: int
    cost: InstructionCount
    tolerance: float = 0.0

    @property
    def row(self) -> list[str]:
        """Core, values, differing, instructions, stack and code as texts."""
        counts = ", ".join(f"{r} {n}" for r, n in self.cost.instructions.items())
        sizes = ["-" if n is None else str(n) for n in (self.cost.stack_bytes, self.cost.text_bytes)]
        return [self.core, str(self.words), str(self.differing), counts or "not counted", *sizes]

    def to_dict(self) -> dict[str, Any]:
        """Its counts."""
        return {
            "words": self.words,
            "differing": self.differing,
            "max_ulp": self.max_ulp,
            "tolerance": self.tolerance,
            "calls": self.calls,
            "instructions": self.cost.instructions,
            "stack_bytes": self.cost.stack_bytes,
            "text_bytes": self.cost.text_bytes,
            "stack_bytes_by_routine": self.cost.stacks,
            "text_bytes_by_routine": self.cost.texts,
        }


class Core(Protocol):
    """A core with a compiled filter on it."""

    def call(self, routine: str, inputs: Sequence[float]) -> None:
        """Run one routine on the filter.

        Parameters
        ----------
        routine : str
            Its name.
        inputs : sequence of float
            All its arguments in a row.
        """

    def put(self, array: str, values: Sequence[float]) -> None:
        """Write the first numbers of one of the filter's arrays.

        Parameters
        ----------
        array : str
            Its name.
        values : sequence of float
        """

    def status(self) -> int:
        """Number of the status that the last call returned."""

    def words(self) -> Words:
        """State, covariance and supervisor as bit patterns."""

    def cost(self) -> InstructionCount:
        """What the calls so far have cost."""


def place_of(program: Program | Border, array: str) -> int:
    """Numbers of the filter's memory that stand before an array.

    Parameters
    ----------
    program : Program
    array : str
        Its name.
    """
    sizes = {name: size for name, (size, _) in program.arrays.items()}
    return sum(list(sizes.values())[: list(sizes).index(array)])


def write_harness(program: Program | Border, folder: Path, *, bare: bool) -> Path:
    """Write the harness that a core drives; returns its path.

    Parameters
    ----------
    program : Program
    folder : Path
        Where it is written.
    bare : bool
        Without an operating system.
    """
    path = folder / "harness.c"
    path.write_text(
        render(
            "verify/harness.c.j2",
            name=program.name,
            real=program.real,
            width=width(program),
            calls=[(r.name, call_arguments(r, DRIVEN)) for r in program.entries],
            bare=bare,
        ),
        encoding="utf-8",
    )
    return path


def width(program: Program | Border) -> int:
    """Floats that the longest argument list needs."""
    return max(sum(a.size or 1 for a in r.required) for r in program.entries)
