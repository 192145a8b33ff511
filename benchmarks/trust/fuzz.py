"""Hostile inputs by the million: parsers, readers and whole commands, in processes of their own.

Usage: python benchmarks/trust/fuzz.py [--share 1.0] [--minutes 60] [--first SEED] [--only KINDS] [--kept FILE] [--docs]

The inputs are those of ``tests/hostile.py``, the rules those of ``tests/hostile_trials.py``. Chunks run in processes, so
that an input that kills the interpreter is counted and the next goes on. ``--kept`` writes what each chunk showed into a
file as it ends, and a run with the same file goes on where that one ended. ``--docs`` writes the rows of the kinds that
were shown into the page, and leaves the others.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import resource
import sys
import tempfile
import time
from collections import Counter
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
CHUNK, CHUNK_OF_COMMANDS = 5000, 100
"""Inputs, and whole commands, that a process is shown."""
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

    def add(self, other: Tally) -> None:
        """What a chunk showed."""
        self.inputs, self.seconds = self.inputs + other.inputs, self.seconds + other.seconds
        self.peak_mb = max(self.peak_mb, other.peak_mb)
        self.wrong.update(other.wrong)


@dataclass
class Journal:
    """What every chunk showed, in a file that grows as they end; without a path nothing is kept."""

    path: Path | None
    ended: dict[str, Tally] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for line in (
            self.path.read_text(encoding="utf-8").splitlines() if self.path and self.path.exists() else ()
        ):
            chunk = json.loads(line)
            self.ended[chunk["chunk"]] = Tally(
                chunk["inputs"], chunk["seconds"], chunk["peak_mb"], Counter(chunk["wrong"])
            )

    def shown(self, kind: str, seed: int, count: int) -> Tally:
        """What a chunk showed, now or in an earlier run."""
        name = f"{kind} {seed} {count}"
        if name not in self.ended:
            self.ended[name] = chunk(kind, seed, count)
            if self.path:
                with self.path.open("a", encoding="utf-8") as file:
                    file.write(json.dumps({"chunk": name, **vars(self.ended[name])}) + "\n")
        return self.ended[name]


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


def chunk(kind: str, seed: int, count: int) -> Tally:
    """Show one chunk; a process that dies is a defect of its own."""
    here, there = get_context("fork").Pipe(duplex=False)
    process = get_context("fork").Process(target=shown, args=(kind, seed, count, there))
    process.start()
    there.close()
    try:
        return Tally(*here.recv())
    except EOFError:
        process.join()
        return Tally(wrong=Counter({f"the process died with {process.exitcode} (seed {seed})": 1}))
    finally:
        process.join()


ROW = re.compile(r"\| ([^|]+) \| ([\d,]+) \| (\d+) \| (\d+) MB \|")


def with_the_others(tallies: dict[str, Tally], page: str) -> dict[str, Tally]:
    """The tallies of this run, and of the other kinds those of a page, in the order of the table."""
    said = {name: row for name, *row in ROW.findall(page)}
    out = {}
    for kind in COUNTS:
        if kind in tallies:
            out[kind] = tallies[kind]
        elif row := said.get(title(kind)):
            wrong = Counter({"in an earlier run": int(row[1])})
            out[kind] = Tally(int(row[0].replace(",", "")), 0.0, float(row[2]), wrong)
    return out


def title(kind: str) -> str:
    """How a kind is called in the table."""
    return TITLES.get(kind, f"logs: {kind.upper()}")


def table(tallies: dict[str, Tally]) -> str:
    """Markdown of what was seen."""
    rows = ["| input | shown | tracebacks, hangs, numbers that are none | peak memory |", "|---|---|---|---|"]
    for kind, t in tallies.items():
        rows.append(f"| {title(kind)} | {t.inputs:,} | {sum(t.wrong.values())} | {t.peak_mb:.0f} MB |")
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
    parser.add_argument("--kept", type=Path, help="a file of what each chunk showed")
    parser.add_argument("--docs", action="store_true")
    given = parser.parse_args()
    until, tallies, journal = time.monotonic() + 60.0 * given.minutes, {}, Journal(given.kept)
    for kind, count in COUNTS.items():
        if given.only and kind not in given.only.split(","):
            continue
        if not given.share:
            continue
        tally = tallies[kind] = Tally()
        left, seed, most = (
            round(given.share * count),
            given.first,
            CHUNK_OF_COMMANDS if kind in WHOLE else CHUNK,
        )
        while left > 0 and time.monotonic() < until:
            tally.add(journal.shown(kind, seed, min(left, most)))
            left, seed = left - most, seed + 1
        print(f"{kind:12s} {tally.inputs:8d} {tally.seconds:7.1f} s {tally.peak_mb:6.0f} MB", flush=True)
        for said, times in tally.wrong.most_common(10):
            print(f"    {times} x {said}", flush=True)
    print(table(tallies))
    if given.docs:
        page = (ROOT / "docs/trust.md").read_text(encoding="utf-8")
        write_table("trust.md", "fuzz", table(with_the_others(tallies, page)))
    return int(any(t.wrong for t in tallies.values()))


if __name__ == "__main__":
    sys.exit(main())
