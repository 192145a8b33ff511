"""Commands that are killed at a random moment: every earlier result is still whole, or the new one is.

Usage: python benchmarks/trust/kills.py [--count 200] [--minutes 20] [--seed 0] [--docs]

A command runs once to its end and is timed. Then it runs over its own outputs and gets SIGKILL at a moment by chance
within that time; each output must have the bytes of before or of a whole run. ``--docs`` writes the table into the page.
"""

from __future__ import annotations

import argparse
import random
import signal
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "benchmarks"), str(ROOT)]

from docs_table import write_table  # noqa: E402

MARK = "made before"
COMMANDS = {
    "identify": (["identify", "log.csv", "--effects", "white_noise", "-o", "n.toml", "--json", "a.json", "--report", "r.html"], ["n.toml", "a.json", "r.html"]),
    "convert": (["convert", "noise.toml", "--to", "table", "--json", "a.json"], ["a.json"]),
    "simulate": (["simulate", "gyro-static", "--duration", "400", "-o", "s.csv"], ["s.csv"]),
    "simulate npz": (["simulate", "ahrs6", "--duration", "20", "-o", "s.npz"], ["s.npz"]),
    "emit": (["emit", "gyro-static", "--target", "c", "-o", "code", "--force"], ["code/main.c", "code/selftest.c"]),
    "run": (["run", "gyro-static", "log.csv", "--noise", "noise.toml", "-o", "e.csv", "--json", "a.json"], ["e.csv", "a.json"]),
    "fleet": (["fleet", "log*.csv", "--jobs", "2", "--json", "f.json"], ["f.json"]),
}  # fmt: skip
"""Commands with their outputs."""


@dataclass
class Kills:
    """What became of one command."""

    tried: int = 0
    in_time: int = 0
    new: int = 0
    torn: int = 0


def started(words: list[str], folder: Path) -> subprocess.Popen[bytes]:
    """The command as a process of its own group."""
    program = [sys.executable, "-c", "from kfgen.cli import main; main()", *words]
    quiet = subprocess.DEVNULL
    return subprocess.Popen(program, cwd=folder, stdout=quiet, stderr=quiet, start_new_session=True)


def prepared(folder: Path) -> None:
    """The inputs of every command."""
    for k in range(2):
        y = 0.05 * np.random.default_rng(k).standard_normal(3000)
        rows = np.column_stack([np.arange(3000) / 100.0, y])
        name = folder / f"log{k or ''}.csv"
        np.savetxt(name, rows, delimiter=",", header="t [s],gyro_x [deg/s]", comments="", fmt="%.9g")
    text = 'format = "kfgen-noise-1"\n[gyro_x]\nunit = "deg/s"\neffects = [{effect="white_noise", N=1e-3}]\n'
    (folder / "noise.toml").write_text(text, encoding="utf-8")


def killed(
    folder: Path, name: str, duration: float, whole: list[bytes], chance: random.Random
) -> tuple[bool, int, int]:
    """Whether one run died in time, how many outputs are new, and how many are neither old nor whole."""
    words, outputs = COMMANDS[name]
    for one in outputs:
        (folder / one).write_text(MARK, encoding="utf-8")
    process = started(words, folder)
    time.sleep(chance.uniform(0.2, 1.0) * duration)
    died = process.poll() is None
    if died:
        process.send_signal(signal.SIGKILL)
    process.wait()
    found = [(folder / one).read_bytes() if (folder / one).exists() else b"" for one in outputs]
    new = sum(f == w for f, w in zip(found, whole))
    return died, new, sum(f not in (MARK.encode(), w) for f, w in zip(found, whole))


def table(seen: dict[str, Kills]) -> str:
    """Markdown, a command a row."""
    rows = [
        "| command | runs | killed before its end | outputs new | outputs torn or lost |",
        "|---|---|---|---|---|",
    ]
    total = Kills(*(sum(getattr(k, n) for k in seen.values()) for n in ("tried", "in_time", "new", "torn")))
    for name, k in [*seen.items(), ("all", total)]:
        rows.append(f"| {name} | {k.tried} | {k.in_time} | {k.new} | {k.torn} |")
    return "\n".join(rows)


def main() -> int:
    """Kill them, count what is left."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--minutes", type=float, default=20.0)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--docs", action="store_true")
    given = parser.parse_args()
    until, chance = time.monotonic() + 60.0 * given.minutes, random.Random(given.seed)
    seen: dict[str, Kills] = {}
    with tempfile.TemporaryDirectory() as home:
        whole, duration = {}, {}
        for name, (words, outputs) in COMMANDS.items():
            folder = Path(home) / name.replace(" ", "_")
            folder.mkdir()
            prepared(folder)
            begun = time.monotonic()
            if started(words, folder).wait():
                print(f"{name} fails by itself", flush=True)
                return 2
            duration[name] = time.monotonic() - begun
            whole[name] = [(folder / one).read_bytes() for one in outputs]
            seen[name] = Kills()
        for k in range(given.count):
            if time.monotonic() > until:
                break
            name = list(COMMANDS)[k % len(COMMANDS)]
            folder = Path(home) / name.replace(" ", "_")
            died, new, torn = killed(folder, name, duration[name], whole[name], chance)
            one = seen[name]
            one.tried, one.in_time, one.new, one.torn = (
                one.tried + 1,
                one.in_time + died,
                one.new + new,
                one.torn + torn,
            )
    print(table(seen))
    if given.docs:
        write_table("trust.md", "kills", table(seen))
    return int(any(k.torn for k in seen.values()))


if __name__ == "__main__":
    sys.exit(main())
