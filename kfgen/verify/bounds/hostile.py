"""Hostile calls of the emitted C: what they raise, and how much of what is assumed they use.

A simulated motion, of whose calls some are spoiled: inputs at their limits and just beyond, zero, denormal, of any
size, no number, infinite; steps that are none; states that are held. The processor's own flags say whether a call
overflowed, divided by zero or asked for what is no number. A call that refuses its input may raise them: its guards
square what is given.
"""

from __future__ import annotations

import ctypes
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kfgen.emit.ir.ir import STATUS
from kfgen.emit.routines import Program
from kfgen.emit.scenario import calm
from kfgen.emit.targets.c import CPrinter, call_arguments
from kfgen.emit.targets.templates import render
from kfgen.verify.bounds.assumed import FilterRanges
from kfgen.verify.bounds.interval import KnownNumber
from kfgen.verify.core import DRIVEN, width, write_harness
from kfgen.verify.host import FLAGS, LANGUAGES, compiler, contraction, run

REFUSED = ("BAD_STEP", "BAD_INPUT")
"""What a call says that worked on nothing."""
FLAGS_RAISED = {1: "overflow", 2: "division by zero", 4: "no number"}
SPOILED, BEYOND = 8, 16
CALM_STEPS = 600
"""Predictions from one start to the next."""
SPOILED_SHARE, ELEMENT_SHARE, HELD_SHARE = 0.3, 0.4, 0.2
"""Of calls, of their numbers, of starts after which states are held."""
CHUNK = 100_000
FINE = 0.0625
SEED = 20261123
Array = NDArray[Any]


@dataclass(frozen=True)
class HostileCalls:
    """What hostile calls did.

    Parameters
    ----------
    calls, refused : int
        How many, and how many were refused.
    raised : dict of str to int
        Of calls that were not refused and found the filter within its ranges: flags, by routine and flag.
    beyond : int
        Calls that found a number beyond its range; what they raise is not counted.
    spoiled : int
        Calls after which a number of state or covariance was none.
    used : dict of str to float
        Largest share of a range that was used, of state and covariance.
    """

    calls: int
    refused: int
    raised: dict[str, int]
    beyond: int
    spoiled: int
    used: dict[str, float]

    @property
    def ok(self) -> bool:
        """Whether no flag was raised and every number stayed one."""
        return not self.raised and not self.spoiled


def write_hostile(program: Program, folder: Path) -> Path:
    """Write the calls by number beside the harness; returns the path.

    Parameters
    ----------
    program : Program
    folder : Path
        Where it is written.
    """
    write_harness(program, folder, bare=False)
    path, printer = folder / "hostile.c", CPrinter(program)
    text = render(
        "verify/hostile.c.j2",
        name=program.name,
        real=program.real,
        width=width(program),
        words=_words(program),
        calls=[(r.name, call_arguments(r, DRIVEN)) for r in program.entries],
        zero=printer.number(0.0),
        fine=printer.number(FINE),
    )
    path.write_text(text, encoding="utf-8")
    return path


def _words(program: Program) -> int:
    return len(program.discrete.nominal_names) + program.covariance.size


def hostile_calls(program: Program, folder: Path, count: int, seed: int = SEED) -> HostileCalls:
    """Make hostile calls on this machine.

    Parameters
    ----------
    program : Program
        In C.
    folder : Path
        Of its header.
    count : int
        Calls.
    seed : int

    Raises
    ------
    CheckFailed
        The header does not compile.
    MissingExtra
        There is no compiler.
    """
    with tempfile.TemporaryDirectory(prefix="kfgen-hostile-") as scratch:
        library = Path(scratch) / "hostile.so"
        source = write_hostile(program, Path(scratch))
        language = LANGUAGES["host"]
        flags = [*language.flags, *FLAGS, contraction(False), "-frounding-math", "-shared", "-fPIC"]
        made = [*compiler(language), *flags, f"-I{folder}", str(source), "-o", str(library), "-lm"]
        run(made, f"{program.name}.h with hostile calls")
        return _Driver(program, ctypes.CDLL(str(library))).drive(count, seed)


class _Driver:
    def __init__(self, program: Program, library: ctypes.CDLL) -> None:
        self.program, self.library = program, library
        self.type = program.type
        memory = FilterRanges(program).memory()
        names = ("x", program.covariance.ARRAY)
        self.ranges = [v for n in names for v in _values(memory[n])]
        self.low, self.high = (np.zeros(len(self.ranges), self.type) for _ in range(2))

    def drive(self, count: int, seed: int) -> HostileCalls:
        """Chunk by chunk."""
        rng, entries = np.random.default_rng(seed), self.program.entries
        lo, hi = (np.array(v, self.type) for v in zip(*((r.lo, r.hi) for r in self.ranges)))
        refused = beyond = spoiled = done = 0
        raised: dict[str, int] = {}
        for which, rows in hostile_rows(self.program, count, rng):
            said, found = (np.zeros(len(which), np.uint8) for _ in range(2))
            arrays = (which, rows, lo, hi, said, found, self.low, self.high)
            self.library.drive(len(which), *(a.ctypes.data_as(ctypes.c_void_p) for a in arrays))
            called = which < len(entries)
            away = np.isin(said, [STATUS.index(s) for s in REFUSED]) & called
            outside = (found & BEYOND > 0) & called
            done += int(called.sum())
            refused += int(away.sum())
            beyond += int((outside & ~away).sum())
            spoiled += int((found & SPOILED > 0).sum())
            for bit, flag in FLAGS_RAISED.items():
                guilty = (found & bit > 0) & called & ~away & ~outside
                for k in np.unique(which[guilty]):
                    name = f"{entries[k].name}: {flag}"
                    raised[name] = raised.get(name, 0) + int((which[guilty] == k).sum())
        return HostileCalls(done, refused, raised, beyond, spoiled, self._used())

    def _used(self) -> dict[str, float]:
        reached = np.maximum(np.abs(self.low.astype(float)), np.abs(self.high.astype(float)))
        share = reached / np.array([v.most for v in self.ranges])
        nx = len(self.program.discrete.nominal_names)
        attitude = self.program.discrete.model.attitude
        unit = set(attitude.nominal_names if attitude else ())
        moving = [k for k, n in enumerate(self.program.discrete.nominal_names) if n not in unit]
        state = max((float(share[k]) for k in moving), default=0.0)
        return {"state": state, "covariance": float(share[nx:].max(initial=0.0))}


def _values(array: KnownNumber | Sequence[KnownNumber]) -> list[KnownNumber]:
    assert not isinstance(array, KnownNumber)
    return list(array)


def hostile_rows(
    program: Program, count: int, rng: np.random.Generator
) -> Iterator[tuple[NDArray[np.uint8], Array]]:
    """Numbers of routines and rows of their inputs, in chunks.

    Parameters
    ----------
    program : Program
    count : int
        Rows in all, about.
    rng : Generator
    """
    names = [r.name for r in program.entries]
    calls = [("init", ()), *((r.name, i) for r, i in calm(program, CALM_STEPS))]
    which = np.array([names.index(n) for n, _ in calls], np.uint8)
    rows = np.zeros((len(calls), width(program)), program.type)
    for k, (_, inputs) in enumerate(calls):
        rows[k, : len(inputs)] = inputs
    sizes = np.array([len(i) for _, i in calls])
    step = np.array(["dt" in {a.name for a in r.required} for r in program.entries])[which]
    times = max(1, min(CHUNK, count) // len(calls))
    while count > 0:
        many, all_rows = np.tile(which, times), np.tile(rows, (times, 1))
        size, stepped = np.tile(sizes, times), np.tile(step, times)
        _spoil(program, all_rows, size, stepped, rng)
        held = (many == names.index("init")) & (rng.random(len(many)) < HELD_SHARE)
        after = np.flatnonzero(held) + 1
        many[after[after < len(many)]] = len(names) + rng.integers(program.n)
        yield many, all_rows
        count -= len(many)


def _spoil(
    program: Program,
    rows: Array,
    sizes: NDArray[np.int64],
    stepped: NDArray[np.bool_],
    rng: np.random.Generator,
) -> None:
    """Spoil some numbers of some rows, in place."""
    there = np.arange(rows.shape[1])[None, :] < sizes[:, None]
    bad = (rng.random(len(rows)) < SPOILED_SHARE)[:, None] & (rng.random(rows.shape) < ELEMENT_SHARE) & there
    kind = rng.integers(0, 8, bad.sum())
    sign = rng.choice([-1.0, 1.0], bad.sum())
    limits = np.array([c.value for c in program.settings.values() if c.name.startswith("MAX_")])
    edge = rng.choice(limits, bad.sum()) * (1.0 + rng.choice([-1e-6, 0.0, 1e-6], bad.sum()))
    tiny = float(np.finfo(program.type).smallest_subnormal)
    drawn = np.choose(
        kind,
        [
            sign * edge,
            sign * edge * rng.random(bad.sum()),
            np.zeros(bad.sum()),
            sign * tiny * rng.integers(1, 1000, bad.sum()),
            sign * 10.0 ** rng.uniform(-38.0, 38.0, bad.sum()),
            np.full(bad.sum(), np.nan),
            sign * np.inf,
            rows[bad] * (1.0 + 1e3 * rng.normal(size=int(bad.sum()))),
        ],
    )
    with np.errstate(over="ignore"):
        rows[bad] = drawn
    last = np.maximum(sizes - 1, 0)
    irregular = stepped & (rng.random(len(rows)) < 0.5 * SPOILED_SHARE)
    steps = [1e-6, program.discrete.max_step, 0.5 / program.discrete.rate, 0.0, -0.01, np.nan, np.inf, 10.0]
    rows[irregular, last[irregular]] = rng.choice(steps, int(irregular.sum()))
