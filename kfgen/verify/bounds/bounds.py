"""The bounds of an emitted filter: what is proven of every operation, what that assumes, and what hostile calls say of it."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

import kfgen
from kfgen.core.elapsed import counted
from kfgen.core.errors import InputError
from kfgen.core.result import Result, ShortTable
from kfgen.emit.covariance.forms import ANY_HELD, HELD
from kfgen.emit.folder import EmittedFilter
from kfgen.emit.ir.ir import Routine
from kfgen.emit.routines import Program
from kfgen.emit.targets.c import TARGET
from kfgen.emit.watch.supervisor import ARRAY as SUPERVISOR
from kfgen.verify.bounds.assumed import ASSUMPTIONS, FilterRanges
from kfgen.verify.bounds.hostile import SEED, HostileCalls, hostile_calls, hostile_rows
from kfgen.verify.bounds.walk import Open, Walk
from kfgen.verify.emulated import CHIPS, Emulated

HOSTILE_CALLS = 1_000_000
"""On this machine."""
COUNTED_CALLS = 1500
"""On an emulated core, each of them counted; the second half of them hold a state."""
HEAD = ("routine", "operations", "open", "instructions", "branches on")


@dataclass(frozen=True)
class RoutineBounds:
    """What is proven of a routine.

    Parameters
    ----------
    name : str
    operations : int
        Of the longest way through it and all that it calls: additions, products, quotients, roots and the like.
    open : tuple of Open
        Operations that may overflow, divide by zero or take the root of what is negative, as far as intervals tell.
    branches : tuple of str
        Numbers on which the way through it depends.
    """

    name: str
    operations: int
    open: tuple[Open, ...]
    branches: tuple[str, ...]


@dataclass(frozen=True, repr=False)
class BoundsProof(Result):
    """The bounds of an emitted filter.

    Parameters
    ----------
    model_hash : str
        SHA-256 of the filter's equations and numbers.
    routines : tuple of RoutineBounds
    hostile : HostileCalls
    instructions : dict of str to dict of str to int
        By core and routine: the most that a hostile call took.
    """

    model_hash: str
    routines: tuple[RoutineBounds, ...]
    hostile: HostileCalls
    instructions: dict[str, dict[str, int]] = field(default_factory=dict)

    @property
    def ok(self) -> bool:
        """Whether no hostile call raised a flag within the ranges, or spoiled a number."""
        return self.hostile.ok

    def summary(self) -> list[str]:
        """What is proven, what is open, what hostile calls did."""
        sound = [r for r in self.routines if not r.open]
        open_ = list(dict.fromkeys(o.sentence for r in self.routines for o in r.open))
        h = self.hostile
        said = [
            f"{len(sound)} of {len(self.routines)} routines: no operation overflows, divides by zero or takes the root "
            f"of a negative number, whatever the input, as long as what is assumed holds"
        ]
        if open_:
            said.append("intervals do not show it of " + "; ".join(open_))
        raised = ", ".join(f"{n} of {k}" for k, n in h.raised.items()) or "none raised a flag"
        spoiled = f"{h.spoiled} spoiled a number" if h.spoiled else "every number stayed one"
        used = ", ".join(f"{name} {share:.2g}" for name, share in h.used.items())
        said.append(
            f"{h.calls} hostile calls, {h.refused} refused, {h.beyond} beyond what is assumed: {raised}, {spoiled}; "
            f"shares of the ranges used: {used}"
        )
        return said

    def short_table(self) -> ShortTable:
        """A row for each routine."""
        return HEAD, [self._row(r) for r in self.routines]

    def _row(self, r: RoutineBounds) -> list[str]:
        counts = [f"{core} {of[r.name]}" for core, of in self.instructions.items() if r.name in of]
        what = f"{len(r.open)}" if r.open else "-"
        return [r.name, str(r.operations), what, ", ".join(counts) or "-", ", ".join(r.branches) or "-"]

    def to_dict(self) -> dict[str, Any]:
        """The same in numbers, and what is assumed."""
        return {
            "format": "kfgen-bounds-1",
            "kfgen": kfgen.__version__,
            "model_hash": self.model_hash,
            "ok": self.ok,
            "assumed": {a.name: {"bound": a.bound, "kept_by": a.kept} for a in ASSUMPTIONS},
            "routines": {
                r.name: {
                    "operations": r.operations,
                    "open": [o.sentence for o in r.open],
                    "branches_on": list(r.branches),
                }
                for r in self.routines
            },
            "hostile": {
                "calls": self.hostile.calls,
                "refused": self.hostile.refused,
                "beyond_assumed": self.hostile.beyond,
                "raised": self.hostile.raised,
                "spoiled": self.hostile.spoiled,
                "range_used": self.hostile.used,
            },
            "instructions": self.instructions,
        }


def bounds(
    emitted: EmittedFilter, cores: Sequence[str] = ("host",), calls: int = HOSTILE_CALLS, seed: int = SEED
) -> BoundsProof:
    """Bound every operation of an emitted filter by intervals, and call it with hostile inputs.

    Parameters
    ----------
    emitted : EmittedFilter
        In C.
    cores : sequence of str
        Emulated ones count the instructions of hostile calls; the host makes `calls` of them always.
    calls : int
        Hostile calls, about.
    seed : int
        Of what is hostile.

    Returns
    -------
    BoundsProof

    Raises
    ------
    InputError
        A filter in another language, or a core that is unknown or does not count.
    CheckFailed
        The header does not compile.
    MissingExtra
        There is no compiler, or no emulator.
    """
    program = emitted.program
    if emitted.target != TARGET:
        raise InputError(
            f"a filter in {emitted.target} has no bounds of its own",
            where="--bounds",
            remedy="Emit it with --target c",
        )
    unknown = [c for c in cores if c != "host" and c not in CHIPS]
    if unknown:
        raise InputError(
            f"the core '{unknown[0]}' counts nothing",
            where="--core",
            remedy=f"Known are host, {', '.join(CHIPS)}",
        )
    routines = tuple(routine_bounds(program, r) for r in program.entries)
    hostile = hostile_calls(program, emitted.folder, calls, seed)
    counts = {c: _counts(program, emitted.folder, c, seed) for c in cores if c != "host"}
    return BoundsProof(emitted.model_hash, routines, hostile, counts)


def routine_bounds(program: Program, routine: Routine) -> RoutineBounds:
    """What intervals show of a routine of a program.

    Parameters
    ----------
    program : Program
    routine : Routine
        One of its entries.
    """
    ranges = FilterRanges(program)
    known = {r.name: r for r in (*program.routines, *program.helpers)}
    walk = Walk(program.real, program.n, known, ranges.assumed, ranges.memory())
    operations = walk.run(routine, ranges.arguments(routine))
    names = dict.fromkeys(_named(program, b) for b in walk.branches)
    return RoutineBounds(routine.name, operations, tuple(walk.open), tuple(names))


def _named(program: Program, branch: str) -> str:
    """What a branch looks at, by the name that the header gives it."""
    array, _, index = branch.rstrip("]").partition("[")
    if not index.isdigit():
        return array
    if array == SUPERVISOR:
        return program.supervisor.places[int(index)][0]
    return program.constants[int(index)].name if array == "k" else array


def _counts(program: Program, folder: Path, core: str, seed: int) -> dict[str, int]:
    """The most instructions of each routine in hostile calls."""
    with tempfile.TemporaryDirectory(prefix="kfgen-bounds-") as scratch:
        chip = Emulated(CHIPS[core], program, folder, Path(scratch), counted=lambda function, number: True)
        which, rows = next(hostile_rows(program, COUNTED_CALLS, np.random.default_rng(seed)))
        for k in counted(range(min(len(which), COUNTED_CALLS)), f"hostile calls on {core}", alike=True):
            if k == COUNTED_CALLS // 2:
                chip.put(HELD, [1.0])
                chip.put(ANY_HELD.name, [1.0])
            if which[k] < len(program.entries):
                routine = program.entries[which[k]]
                size = sum(a.size or 1 for a in routine.required)
                chip.call(routine.name, rows[k, :size].tolist())
        return dict(chip.cost().instructions)
