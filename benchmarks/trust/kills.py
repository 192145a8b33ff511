"""Commands that are killed at a random moment: every earlier result is still whole, or the new one is.

Usage: python benchmarks/trust/kills.py [--count 208] [--minutes 40] [--seed 0] [--docs]

A command runs once to its end. Then it runs over its own outputs and gets SIGKILL: every second time at a moment by
chance within the time that it takes, every second time at one by chance within the time that it writes, which begins
when a temporary neighbour of an output appears. Each output must have the bytes of before or of a whole run; at the end
a run that is left alone must leave whole ones and nothing else. ``--docs`` writes the table into the page.
"""

from __future__ import annotations

import argparse
import os
import random
import signal
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "benchmarks"), str(ROOT)]

from docs_table import write_table  # noqa: E402
from processes import COMMANDS, MARK, contents, prepared, started, temporary  # noqa: E402

LOOK_S = 0.0005
"""Between two looks for a temporary neighbour [s]."""
START_S = 30.0
"""Within which the processes of a command that was killed have ended [s]."""


@dataclass
class Kills:
    """What became of one command."""

    tried: int = 0
    in_time: int = 0
    writing: int = 0
    new: int = 0
    torn: int = 0
    left: int = 0


@dataclass(frozen=True)
class Whole:
    """A run that was left alone: its outputs, its time [s], and how long of that it wrote [s]."""

    outputs: list[bytes | None]
    duration: float
    written: float


def seen_to_write(process, folder: Path) -> float | None:
    """When a temporary neighbour appears first; None where the process ends before."""
    while process.poll() is None:
        if temporary(folder):
            return time.monotonic()
        time.sleep(LOOK_S)
    return None


def whole_run(name: str, folder: Path) -> Whole:
    """One run to its end; ends the program where the command fails by itself."""
    words, outputs = COMMANDS[name]
    begun, process = time.monotonic(), started(words, folder)
    first = seen_to_write(process, folder)
    if process.wait() > 1:  # 1: the answer is not a good one, and is written
        raise SystemExit(f"{name} fails by itself")
    end = time.monotonic()
    return Whole(contents(folder, outputs), end - begun, end - (first or end))


def running(group: int) -> bool:
    """Whether a process of the group lives still."""
    try:
        os.killpg(group, 0)
    except ProcessLookupError:
        return False
    return True


def killed(folder: Path, name: str, whole: Whole, near: bool, chance: random.Random, seen: Kills) -> None:
    """One run that gets SIGKILL, near its writing or anywhere; counts what is left."""
    words, outputs = COMMANDS[name]
    for one in outputs:
        (folder / one).write_text(MARK, encoding="utf-8")
    process = started(words, folder)
    if near:
        seen_to_write(process, folder)
        time.sleep(chance.random() ** 2 * whole.written)
    else:
        time.sleep(chance.uniform(0.05, 1.0) * whole.duration)
    seen.in_time += process.poll() is None
    process.send_signal(signal.SIGKILL)
    process.wait()
    until = time.monotonic() + START_S
    while running(process.pid) and time.monotonic() < until:
        time.sleep(0.01)
    found = contents(folder, outputs)
    seen.tried += 1
    seen.writing += bool(temporary(folder))
    seen.new += sum(f == w for f, w in zip(found, whole.outputs))
    seen.torn += sum(f not in (MARK.encode(), w) for f, w in zip(found, whole.outputs))
    seen.left += running(process.pid)


def table(seen: dict[str, Kills]) -> str:
    """Markdown, a command a row."""
    rows = [
        "| command | runs | killed before its end | killed while it wrote | outputs new | outputs torn or lost | processes left |",
        "|---|---|---|---|---|---|---|",
    ]
    names = ("tried", "in_time", "writing", "new", "torn", "left")
    total = Kills(*(sum(getattr(k, n) for k in seen.values()) for n in names))
    for name, k in [*seen.items(), ("all", total)]:
        rows.append(f"| {name} | " + " | ".join(str(getattr(k, n)) for n in names) + " |")
    return "\n".join(rows)


def main() -> int:
    """Kill them, count what is left."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--count", type=int, default=208)
    parser.add_argument("--minutes", type=float, default=40.0)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--docs", action="store_true")
    given = parser.parse_args()
    until, chance = time.monotonic() + 60.0 * given.minutes, random.Random(given.seed)
    seen = {name: Kills() for name in COMMANDS}
    with tempfile.TemporaryDirectory() as home:
        folders = {name: Path(home) / str(k) for k, name in enumerate(COMMANDS)}
        for folder in folders.values():
            prepared(folder)
        whole = {name: whole_run(name, folder) for name, folder in folders.items()}
        for k in range(given.count):
            if time.monotonic() > until:
                break
            name, near = list(COMMANDS)[k % len(COMMANDS)], bool(k // len(COMMANDS) % 2)
            killed(folders[name], name, whole[name], near, chance, seen[name])
        for name, folder in folders.items():
            again = whole_run(name, folder)
            outputs = zip(COMMANDS[name][1], again.outputs, whole[name].outputs)
            wrong = [o for o, a, w in outputs if a != w] + temporary(folder)
            seen[name].torn += len(wrong)
            if wrong:
                print(f"{name} leaves {', '.join(wrong)}", flush=True)
    print(table(seen))
    if given.docs:
        write_table("trust.md", "kills", table(seen))
    return int(any(k.torn or k.left for k in seen.values()))


if __name__ == "__main__":
    sys.exit(main())
