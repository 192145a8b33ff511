"""The memory of one process that identifies a large log, or compares it with the noise that was found, or a long flight.

Usage: python benchmarks/trust/memory.py [--gigabytes 0.4 10] [--hours 1] [--docs]

The log is an NPY file of float32, white noise with a random walk, written in pieces to the folder for temporary files.
It is mapped: pages of the file that the system keeps for itself and can drop are not counted (RssAnon of Linux).
The flight is one of `benchmarks/flight`, its inertial sensors at 1 kHz, compared with the library's `ins15`.
``--docs`` writes the table into the page; rows that are not measured now stay there as they are.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "benchmarks"), str(ROOT)]

from docs_table import table_of, write_table  # noqa: E402

PIECE = 10_000_000
RATE_HZ, FLIGHT_HZ = 200.0, 1000.0
N = 0.05
"""Density of the white noise [rad/s/sqrt(Hz)]."""
K = 1e-5 * np.sqrt(RATE_HZ)
"""Of the random walk [rad/s/sqrt(s)]."""
HOW_IT_IS_READ = ("--rate", str(RATE_HZ), "--columns", "gyro_x=#1 [rad/s]")
WHITE_NOISE_ALONE = f"""format = "kfgen-noise-1"
[gyro_x]
unit = "rad/s"
effects = [ {{ effect = "white_noise", N = "{N} rad/s/sqrt(Hz)" }} ]
"""


def written(path: Path, n: int) -> None:
    """A record of `n` samples as NPY."""
    rng, last = np.random.default_rng(0), 0.0
    out = np.lib.format.open_memmap(path, mode="w+", dtype=np.float32, shape=(n,))
    for begin in range(0, n, PIECE):
        size = min(PIECE, n - begin)
        walk = last + np.cumsum(rng.standard_normal(size)) * K / np.sqrt(RATE_HZ)
        out[begin : begin + size] = N * np.sqrt(RATE_HZ) * rng.standard_normal(size) + walk
        last = float(walk[-1])
        out.flush()


def measured(words: list[str]) -> tuple[float, float]:
    """Peak [MB] of the memory that is a command's own, and time [s]."""
    begun, peak = time.monotonic(), 0.0
    program = [sys.executable, "-c", "from kfgen.cli import main; main()", *words]
    process = subprocess.Popen(program, stdout=subprocess.DEVNULL)
    while process.poll() is None:
        with contextlib.suppress(OSError, IndexError):
            status = Path(f"/proc/{process.pid}/status").read_text("utf-8")
            peak = max(peak, float(status.partition("RssAnon:")[2].split()[0]) / 1024.0)
        time.sleep(0.02)
    if process.returncode:
        raise SystemExit(f"kfgen {words[0]} ended with {process.returncode}")
    return peak, time.monotonic() - begun


def identified(log: Path) -> tuple[float, float, str]:
    """Memory, time, and what is said of the noise, which `compared` reads."""
    answer = log.with_suffix(".json")
    words = ["identify", str(log), *HOW_IT_IS_READ, "--json", str(answer)]
    spent = measured([*words, "-o", str(log.with_suffix(".toml"))])
    channel = json.loads(answer.read_text("utf-8"))["channels"]["gyro_x"]
    found = next(e for e in channel["effects"] if e["effect"] == "white_noise")["parameters"]["N"]["value"]
    return *spent, f"N is {found / N:.4f} times the true one"


def compared(log: Path) -> tuple[float, float, str]:
    """Memory, time, and what is said of the log beside its own noise, and beside white noise alone."""
    said, spent = [], (0.0, 0.0)
    alone = log.with_name("white.toml")
    alone.write_text(WHITE_NOISE_ALONE, encoding="utf-8")
    for model in (log.with_suffix(".toml"), alone):
        answer = model.with_suffix(".gap.json")
        words = ["gap", str(log), *HOW_IT_IS_READ, "--model", str(model), "--json", str(answer)]
        one = measured(words)
        spent = max(spent[0], one[0]), max(spent[1], one[1])
        found = json.loads(answer.read_text("utf-8"))
        named = [
            f"{s['effect']}, K {s['parameters']['K']['value'] / K:.3f} times the true one"
            if "K" in s["parameters"]
            else s["effect"]
            for s in found["steps"]
        ]
        said.append(f"{found['verdict']} {'; '.join(named)}".strip())
    return *spent, f"beside its own noise: {said[0]}; beside white noise alone: {said[1]}"


def flight(path: Path, hours: float) -> int:
    """A flight with inertial samples at `FLIGHT_HZ` as NPZ; how many."""
    sys.path.insert(0, str(ROOT / "benchmarks" / "flight"))
    import flight as flown
    import trial

    from kfgen.log.readers import write_log

    flown.IMU_HZ, flown.FINE_HZ = FLIGHT_HZ, 2.0 * FLIGHT_HZ
    log = trial.log_of(trial.Case("quadrotor", 1, 3600.0 * hours), [])
    write_log(log, path)
    return int(log.n)


def compared_flight(log: Path) -> tuple[float, float, str]:
    """Memory, time, and what is said of the flight."""
    answer = log.with_suffix(".json")
    spent = measured(["gap", str(log), "--model", "ins15", "--json", str(answer)])
    found = json.loads(answer.read_text("utf-8"))
    return *spent, " ".join([found["verdict"], *(s["effect"] for s in found["steps"])])


def with_others(rows: list[str], table: str) -> list[str]:
    """These rows, in a table that has others of other files and commands."""

    def measured_there(row: str) -> tuple[str, str]:
        cells = row.split("|")
        return cells[1].partition(",")[0].strip(), cells[3].strip()

    new = {measured_there(r): r for r in rows}
    return [*(new.pop(measured_there(r), r) for r in table.strip().splitlines()), *new.values()]


def main() -> int:
    """Write, identify, compare, remove."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--gigabytes", type=float, nargs="*", default=[0.4, 10.0])
    parser.add_argument("--hours", type=float, default=1.0, help="of the flight")
    parser.add_argument("--docs", action="store_true")
    given = parser.parse_args()
    rows = ["| file | samples | command | peak memory | time | said |", "|---|---|---|---|---|---|"]
    for size in given.gigabytes:
        n = int(size * 1e9 / 4)
        with tempfile.TemporaryDirectory(dir=os.environ.get("TMPDIR")) as folder:
            path = Path(folder) / "log.npy"
            written(path, n)
            for name, command in (("identify", identified), ("gap", compared)):
                peak, seconds, said = command(path)
                rows.append(f"| {size:g} GB | {n:,} | `{name}` | {peak:.0f} MB | {seconds:.0f} s | {said} |")
                print(rows[-1], flush=True)
    if given.hours:
        with tempfile.TemporaryDirectory(dir=os.environ.get("TMPDIR")) as folder:
            path = Path(folder) / "flight.npz"
            n = flight(path, given.hours)
            name, size = f"a flight of {given.hours:g} h at {FLIGHT_HZ:g} Hz", path.stat().st_size / 1e9
            peak, seconds, said = compared_flight(path)
        rows.append(f"| {name}, {size:.1f} GB | {n:,} | `gap` | {peak:.0f} MB | {seconds:.0f} s | {said} |")
        print(rows[-1], flush=True)
    if given.docs:
        write_table("trust.md", "memory", "\n".join(with_others(rows, table_of("trust.md", "memory"))))
    return 0


if __name__ == "__main__":
    sys.exit(main())
