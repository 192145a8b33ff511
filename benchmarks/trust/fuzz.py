"""Hostile inputs by the million: parsers, readers and whole commands, in processes of their own.

Usage: python benchmarks/trust/fuzz.py [--share 1.0] [--minutes 60] [--first SEED] [--only KINDS] [--with OUTPUT] [--docs]

The inputs are those of ``tests/hostile.py``, the rules those of ``tests/hostile_trials.py``. Chunks run in processes, so
that an input that kills the interpreter is counted and the next goes on. ``--docs`` writes the table into the page.
``--with`` adds what earlier runs printed, so that kinds can be shown at different times.
"""

from __future__ import annotations

import argparse
import os
import re
import resource
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from multiprocessing import get_context
from multiprocessing.connection import Connection
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "benchmarks"), str(ROOT / "tests")]

from docs_table import write_table  # noqa: E402
from hostile import Commands, Comparisons  # noqa: E402
from hostile_trials import commands, trials  # noqa: E402

DATA = Path(os.environ.get("KFGEN_DATA") or ROOT.parent / "shared" / "data")
CHUNK = 5000
"""Inputs that a process is shown."""
COUNTS = {
    **{"unit": 200_000, "quantity": 150_000, "formula": 250_000, "noise": 130_000, "model": 80_000},
    **{
        "filter": 80_000,
        "manoeuvre": 80_000,
        "csv": 50_000,
        "json_lines": 30_000,
        "npy": 30_000,
        "npz": 25_000,
    },
    **{
        "pos": 30_000,
        "gz": 8_000,
        "xz": 8_000,
        "mat": 6_000,
        "BIN": 3_000,
        "ulg": 2_000,
        "commands": 20_000,
        "comparisons": 4_000,
    },
}
"""Inputs of each kind."""
WHOLE = {"commands": Commands, "comparisons": Comparisons}
"""Kinds that are commands."""
TITLES = {
    **{"unit": "units", "quantity": "quantities", "formula": "formulas", "noise": "noise files"},
    **{
        "model": "model files",
        "filter": "filter files",
        "manoeuvre": "manoeuvre files",
        "commands": "whole commands",
        "comparisons": "whole commands that compare",
    },
    **{
        "json_lines": "logs: JSON lines",
        "BIN": "logs: ArduPilot",
        "ulg": "logs: PX4",
        "gz": "logs: CSV in gzip",
    },
    **{"xz": "logs: CSV in xz", "pos": "logs: RTKLIB", "mat": "logs: MAT"},
}


@dataclass
class Tally:
    """What was seen of one kind."""

    inputs: int = 0
    seconds: float = 0.0
    peak_mb: float = 0.0
    wrong: Counter[str] = field(default_factory=Counter)


def shown(kind: str, seed: int, count: int, end: Connection) -> None:
    """In a process of its own: show a chunk, send what is wrong."""
    os.chdir(tempfile.mkdtemp())
    begun = time.process_time()
    found = (
        commands(_command_line(), seed, count, WHOLE[kind])
        if kind in WHOLE
        else trials(kind, seed, count, DATA)
    )
    wrong, seen = Counter[str](), 0
    for said in found:
        seen += 1
        if said:
            wrong[said] += 1
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
    end.send((seen, time.process_time() - begun, peak, wrong))


def _command_line():
    """The command line in process, as the tests call it."""
    import conftest

    return conftest.kfgen.__wrapped__()


def chunk(kind: str, seed: int, count: int, tally: Tally) -> None:
    """Show one chunk; a process that dies is a defect of its own."""
    here, there = get_context("fork").Pipe(duplex=False)
    process = get_context("fork").Process(target=shown, args=(kind, seed, count, there))
    process.start()
    there.close()
    try:
        seen, seconds, peak, wrong = here.recv()
        tally.inputs += seen
        tally.seconds += seconds
        tally.peak_mb = max(tally.peak_mb, peak)
        tally.wrong.update(wrong)
    except EOFError:
        process.join()
        tally.wrong[f"the process died with {process.exitcode} (seed {seed})"] += 1
    process.join()


COUNTED = re.compile(r"(\w+) +(\d+) +([\d.]+) s +(\d+) MB")
WRONG = re.compile(r"    (\d+) x (.*)")


def printed(output: Path) -> dict[str, Tally]:
    """What an earlier run printed of each kind that it showed."""
    found, last = dict[str, Tally](), Tally()
    for line in output.read_text(encoding="utf-8").splitlines():
        if counted := COUNTED.fullmatch(line):
            kind, inputs, seconds, peak = counted.groups()
            last = found[kind] = Tally(int(inputs), float(seconds), float(peak))
        elif wrong := WRONG.fullmatch(line):
            last.wrong[wrong.group(2)] += int(wrong.group(1))
    return {kind: tally for kind, tally in found.items() if tally.inputs}


def with_earlier(tallies: dict[str, Tally], outputs: Sequence[Path]) -> dict[str, Tally]:
    """The tallies of this run and of earlier ones, in the order of the table; added where both have a kind."""
    out = {kind: Tally() for kind in COUNTS}
    for each in (tallies, *(printed(output) for output in outputs)):
        for kind, tally in each.items():
            known = out[kind]
            known.inputs, known.seconds = known.inputs + tally.inputs, known.seconds + tally.seconds
            known.peak_mb = max(known.peak_mb, tally.peak_mb)
            known.wrong.update(tally.wrong)
    return {kind: tally for kind, tally in out.items() if tally.inputs}


def table(tallies: dict[str, Tally]) -> str:
    """Markdown of what was seen."""
    rows = ["| input | shown | tracebacks, hangs, numbers that are none | peak memory |", "|---|---|---|---|"]
    for kind, t in tallies.items():
        name = TITLES.get(kind, f"logs: {kind.upper()}")
        rows.append(f"| {name} | {t.inputs:,} | {sum(t.wrong.values())} | {t.peak_mb:.0f} MB |")
    total, wrong = (
        sum(t.inputs for t in tallies.values()),
        sum(sum(t.wrong.values()) for t in tallies.values()),
    )
    return "\n".join(
        [*rows, f"| all | {total:,} | {wrong} | {max(t.peak_mb for t in tallies.values()):.0f} MB |"]
    )


def main() -> int:
    """Show them all, print what is wrong."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--share", type=float, default=1.0, help="of the inputs of each kind")
    parser.add_argument("--minutes", type=float, default=60.0)
    parser.add_argument("--first", type=int, default=0, help="the first seed")
    parser.add_argument("--only", default="", help="kinds, separated by commas")
    parser.add_argument(
        "--with", dest="earlier", action="append", default=[], type=Path, help="earlier output"
    )
    parser.add_argument("--docs", action="store_true")
    given = parser.parse_args()
    until, tallies = time.monotonic() + 60.0 * given.minutes, {}
    for kind, count in COUNTS.items():
        if given.only and kind not in given.only.split(","):
            continue
        if not given.share:
            continue
        tally = tallies[kind] = Tally()
        left, seed = round(given.share * count), given.first
        while left > 0 and time.monotonic() < until:
            chunk(kind, seed, min(left, CHUNK), tally)
            left, seed = left - CHUNK, seed + 1
        print(f"{kind:12s} {tally.inputs:8d} {tally.seconds:7.1f} s {tally.peak_mb:6.0f} MB", flush=True)
        for said, times in tally.wrong.most_common(10):
            print(f"    {times} x {said}", flush=True)
    tallies = with_earlier(tallies, given.earlier)
    print(table(tallies))
    if given.docs:
        write_table("trust.md", "fuzz", table(tallies))
    return int(any(t.wrong for t in tallies.values()))


if __name__ == "__main__":
    sys.exit(main())
