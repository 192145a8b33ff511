"""Disks that are full or protected, and two writers of one output: every earlier result is whole, or a new one is.

Usage: python benchmarks/trust/faults.py [--only "disk full,two writers"] [--commands emit,run] [--docs]

No file of a command may grow beyond a part of what it would write; the disk is smaller than its outputs; the disk can
be read only; two runs with different inputs write the same outputs at once. A run that fails must end with exit status 2,
one message and the outputs as they were. Disks are mounted for it, which Linux allows to root; without that these rows
say so. ``--docs`` writes the table into the page.
"""

from __future__ import annotations

import argparse
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "benchmarks"), str(ROOT)]

from docs_table import write_table  # noqa: E402
from processes import COMMANDS, MARK, contents, prepared, started, temporary  # noqa: E402

SHARES = (0.0, 0.3, 0.9)
"""Of the largest output of a command: how large a file may grow."""
ROOM = 4096
"""Bytes that are left on a disk that is full: one page."""


@dataclass
class Seen:
    """What became of the runs under one fault."""

    tried: int = 0
    refused: int = 0
    torn: int = 0
    silent: int = 0


def marked(folder: Path, outputs: list[str]) -> None:
    """Earlier results."""
    for one in outputs:
        (folder / one).parent.mkdir(exist_ok=True)
        (folder / one).write_text(MARK, encoding="utf-8")


def judged(name: str, folder: Path, status: int, said: str, whole: list[bytes | None], seen: Seen) -> None:
    """Count one run: what it said, and what it left."""
    found = contents(folder, COMMANDS[name][1])
    old = [MARK.encode()] * len(found)
    seen.tried += 1
    seen.refused += status == 2
    message = said.strip().splitlines()[-1:] or [""]
    one = message[0].startswith("kfgen: ") and "Traceback" not in said and "defect" not in said
    wrong = (status == 2 and not one, status not in (0, 1, 2))
    torn = found != (old if status == 2 else whole) or bool(temporary(folder))
    seen.silent += any(wrong)
    seen.torn += torn
    if torn or any(wrong):
        print(f"{name}: exit status {status}: {said[-300:]}; {temporary(folder)}", flush=True)


def small_files(name: str, folder: Path, whole: list[bytes | None], seen: Seen) -> None:
    """No file may grow beyond a share of the largest output."""
    words, outputs = COMMANDS[name]
    for share in SHARES:
        marked(folder, outputs)
        largest = max(1, int(share * max(len(w or b"") for w in whole)))
        process = started(words, folder, subprocess.PIPE, largest)
        said = process.communicate()[1]
        judged(name, folder, process.returncode, said, whole, seen)


@contextmanager
def disk(home: Path, size: str) -> Iterator[Path]:
    """A small disk; raises `OSError` where none can be mounted."""
    place = Path(tempfile.mkdtemp(dir=home))
    if (
        not shutil.which("mount")
        or subprocess.run(
            ["mount", "-t", "tmpfs", "-o", f"size={size}", "tmpfs", str(place)],
            capture_output=True,
            check=False,
        ).returncode
    ):
        raise OSError("no disk can be mounted")
    try:
        yield place
    finally:
        subprocess.run(["umount", str(place)], check=False)


def full_disk(name: str, folder: Path, whole: list[bytes | None], seen: Seen) -> None:
    """The disk has no room for the outputs."""
    words, outputs = COMMANDS[name]
    with disk(folder.parent, "64m") as place:
        shutil.copytree(folder, place / "a")
        marked(place / "a", outputs)
        with (place / "filler").open("wb", buffering=0) as filler:
            room = shutil.disk_usage(place).free - ROOM
            filler.write(bytes(max(room, 0)))
        process = started(words, place / "a", subprocess.PIPE)
        said = process.communicate()[1]
        judged(name, place / "a", process.returncode, said, whole, seen)


def protected_disk(name: str, folder: Path, whole: list[bytes | None], seen: Seen) -> None:
    """The disk can be read only."""
    words, outputs = COMMANDS[name]
    with disk(folder.parent, "64m") as place:
        shutil.copytree(folder, place / "a")
        marked(place / "a", outputs)
        subprocess.run(["mount", "-o", "remount,ro", str(place)], check=True)
        process = started(words, place / "a", subprocess.PIPE)
        said = process.communicate()[1]
        judged(name, place / "a", process.returncode, said, whole, seen)


def two_writers(name: str, folder: Path, whole: list[bytes | None], seen: Seen) -> None:
    """Two runs of the command at once: each output is that of a whole run."""
    words, outputs = COMMANDS[name]
    for _ in range(2):
        marked(folder, outputs)
        both = [started(words, folder, subprocess.PIPE) for _ in range(2)]
        said = [p.communicate()[1] for p in both]
        refused = [k for k, p in enumerate(both) if p.returncode == 2]
        if refused:
            print(f"{name}: one of two writers is refused: {said[refused[0]].strip()[-200:]}", flush=True)
        ended = 2 if len(refused) == 2 else max(p.returncode for p in both if p.returncode != 2)
        judged(name, folder, ended, said[(refused or [0])[0]], whole, seen)


FAULTS: dict[str, Callable[[str, Path, list[bytes | None], Seen], None]] = {
    "no file may grow that large": small_files,
    "disk full": full_disk,
    "disk read-only": protected_disk,
    "two writers": two_writers,
}


def table(seen: dict[str, Seen]) -> str:
    """Markdown, a fault a row."""
    rows = [
        "| fault | runs | refused | outputs torn or lost | without a message |",
        "|---|---|---|---|---|",
    ]
    for name, s in seen.items():
        here = (
            f"{s.tried} | {s.refused} | {s.torn} | {s.silent}"
            if s.tried
            else "no disk can be mounted here | | |"
        )
        rows.append(f"| {name} | {here} |")
    return "\n".join(rows)


def main() -> int:
    """Every command under every fault."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--only", default="", help="faults, separated by commas")
    parser.add_argument("--commands", default=",".join(COMMANDS), help="names, separated by commas")
    parser.add_argument("--docs", action="store_true")
    given = parser.parse_args()
    seen = {name: Seen() for name in FAULTS if not given.only or name in given.only.split(",")}
    with tempfile.TemporaryDirectory() as home:
        for k, name in enumerate(given.commands.split(",")):
            words, outputs = COMMANDS[name]
            folder = Path(home) / str(k)
            prepared(folder)
            if started(words, folder).wait() > 1:
                raise SystemExit(f"{name} fails by itself")
            whole = contents(folder, outputs)
            for fault, counted in seen.items():
                try:
                    FAULTS[fault](name, folder, whole, counted)
                except OSError as error:
                    print(f"{fault}: {error}", flush=True)
    print(table(seen))
    if given.docs:
        write_table("trust.md", "faults", table(seen))
    return int(any(s.torn or s.silent for s in seen.values()))


if __name__ == "__main__":
    sys.exit(main())
