"""The memory of one process that identifies a large log.

Usage: python benchmarks/trust/memory.py [--gigabytes 1 4] [--docs]

The log is an NPY file of float32, white noise with a random walk, written in pieces to the folder for temporary files.
``--docs`` writes the table into the page.
"""

from __future__ import annotations

import argparse
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

from docs_table import write_table  # noqa: E402

PIECE = 10_000_000
RATE_HZ = 200.0
N = 0.05
"""Density of the white noise [rad/s/sqrt(Hz)]."""


def written(path: Path, n: int) -> None:
    """A record of `n` samples as NPY."""
    rng, last = np.random.default_rng(0), 0.0
    out = np.lib.format.open_memmap(path, mode="w+", dtype=np.float32, shape=(n,))
    for begin in range(0, n, PIECE):
        size = min(PIECE, n - begin)
        walk = last + np.cumsum(rng.standard_normal(size)) * 1e-5
        out[begin : begin + size] = N * np.sqrt(RATE_HZ) * rng.standard_normal(size) + walk
        last = float(walk[-1])
        out.flush()


def measured(path: Path) -> tuple[float, float, float]:
    """Peak [MB], time [s] and the N that was found."""
    answer = path.with_suffix(".json")
    words = [
        "identify",
        str(path),
        "--rate",
        str(RATE_HZ),
        "--columns",
        "gyro_x=#1 [rad/s]",
        "--json",
        str(answer),
    ]
    script = (
        "import resource, sys; from kfgen.cli import main\n"
        "try: main()\n"
        "finally: print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss, file=sys.stderr)"
    )
    begun = time.monotonic()
    done = subprocess.run([sys.executable, "-c", script, *words], capture_output=True, text=True, check=False)
    if done.returncode:
        raise SystemExit(done.stderr)
    channel = json.loads(answer.read_text("utf-8"))["channels"]["gyro_x"]
    found = next(e for e in channel["effects"] if e["effect"] == "white_noise")["parameters"]["N"]["value"]
    return int(done.stderr.split()[-1]) / 1024.0, time.monotonic() - begun, found


def main() -> int:
    """Write, identify, remove."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--gigabytes", type=float, nargs="*", default=[1.0, 4.0])
    parser.add_argument("--docs", action="store_true")
    given = parser.parse_args()
    rows = ["| file | samples | peak memory | time | N found over N |", "|---|---|---|---|---|"]
    for size in given.gigabytes:
        n = int(size * 1e9 / 4)
        with tempfile.TemporaryDirectory(dir=os.environ.get("TMPDIR")) as folder:
            path = Path(folder) / "log.npy"
            written(path, n)
            peak, seconds, found = measured(path)
        rows.append(f"| {size:g} GB | {n:,} | {peak:.0f} MB | {seconds:.0f} s | {found / N:.4f} |")
        print(rows[-1], flush=True)
    if given.docs:
        write_table("trust.md", "memory", "\n".join(rows))
    return 0


if __name__ == "__main__":
    sys.exit(main())
