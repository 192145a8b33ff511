"""A fleet on a Dask cluster of two workers, killed once on the way: every log once in the result, time and speed-up.

Usage: python benchmarks/fleet_cluster.py [--count 1000] [--hours 1] [--rate 10] [--seed 0] [--docs]

Logs of one gyro at rest are made. ``kfgen fleet --scheduler`` runs over them; when a third is done, one worker gets
SIGKILL, and when half is done, the command itself. The same command then goes on from its journal. For the speed-up,
every tenth log is done by one process of this machine. ``--docs`` writes the table into the page.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT / "benchmarks"), str(ROOT)]

from docs_table import measured_at, write_table  # noqa: E402

import kfgen as kf  # noqa: E402

WORKERS = 2
MAX_LOAD_FOR_SPEED_UP = 0.5
"""Load by other work at the start above which a ratio of two times means nothing."""
KILL_WORKER_AT, KILL_COMMAND_AT = 0.33, 0.5
"""Shares of the logs after which a worker and the command are killed."""
EVERY = 10
"""One log in so many is done by one process, for the speed-up."""


def make_logs(folder: Path, count: int, seconds: float, rate: float, seed: int) -> list[Path]:
    """White noise of 0.003 deg/s/sqrt(Hz) and a random walk, a little different from sensor to sensor."""
    rng = np.random.default_rng(seed)
    n, paths = round(seconds * rate), []
    for k in range(count):
        N, K = 0.003 * np.exp(0.1 * rng.normal()), 2e-5 * np.exp(0.2 * rng.normal())
        y = N * np.sqrt(rate) * rng.normal(size=n) + K / np.sqrt(rate) * np.cumsum(rng.normal(size=n))
        paths.append(folder / f"unit{k:04d}.npz")
        kf.write_log(
            kf.Log(np.arange(n) / rate, {"gyro_x": kf.Channel.of(y, "deg/s")}, source=paths[-1].name),
            paths[-1],
        )
    return paths


def command(folder: Path, *words: str) -> list[str]:
    """`kfgen fleet` over the logs of a folder."""
    return [sys.executable, "-m", "kfgen", "--quiet", "fleet", str(folder / "*.npz"), *words]


def journalled(path: Path) -> int:
    """Logs that are done, by the journal."""
    return path.read_bytes().count(b'"key"') if path.is_file() else 0


def run(folder: Path, address: str, workers: list[int], count: int) -> tuple[float, int, dict[str, object]]:
    """Time [s], logs that the killed run had done, and the answer."""
    out, journal = folder / "fleet.json", folder / "fleet.json.unfinished"
    words = command(folder, "--scheduler", address, "--json", str(out))
    began, spent, done, worker = time.monotonic(), 0.0, 0, workers[0]
    with subprocess.Popen(words, stdout=subprocess.DEVNULL) as first:
        while first.poll() is None and done < KILL_COMMAND_AT * count:
            time.sleep(0.05)
            done = journalled(journal)
            if worker and done >= KILL_WORKER_AT * count:
                os.kill(worker, signal.SIGKILL)
                worker = 0
        first.kill()
    spent += time.monotonic() - began
    done = journalled(journal)
    began = time.monotonic()
    subprocess.run(words, check=True, stdout=subprocess.DEVNULL)
    return spent + time.monotonic() - began, done, json.loads(out.read_text())


def serial(paths: list[Path], folder: Path) -> float:
    """Seconds for a log with one process of this machine, without the start of the program."""
    few = folder / "few"
    few.mkdir()
    for path in paths[::EVERY]:
        (few / path.name).symlink_to(path)
    one = folder / "one"
    one.mkdir()
    (one / paths[0].name).symlink_to(paths[0])
    times = []
    for place in (one, few):
        began = time.monotonic()
        subprocess.run(command(place, "--jobs", "1"), check=False, capture_output=True)
        times.append(time.monotonic() - began)
    return (times[1] - times[0]) / (len(paths[::EVERY]) - 1)


def speed_up(ratio: float, load: float) -> str:
    """The ratio of the times, unless other work was in one of them."""
    return f"{ratio:.2f}" if load <= MAX_LOAD_FOR_SPEED_UP else f"not measured: load {load:.1f} by other work"


def main() -> None:
    """Run it and say what came out."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    for name, default in (("count", 1000), ("hours", 1.0), ("rate", 10.0), ("seed", 0)):
        parser.add_argument(f"--{name}", type=type(default), default=default)
    parser.add_argument("--docs", action="store_true")
    given = parser.parse_args()
    from distributed import LocalCluster

    load = os.getloadavg()[0]
    with tempfile.TemporaryDirectory(prefix="kfgen-fleet-") as scratch:
        folder = Path(scratch)
        paths = make_logs(folder, given.count, 3600.0 * given.hours, given.rate, given.seed)
        os.environ["PYTHONPATH"] = os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])
        with LocalCluster(
            n_workers=WORKERS, threads_per_worker=1, processes=True, dashboard_address=None
        ) as cluster:
            workers = [nanny.process.process.pid for nanny in cluster.workers.values()]
            seconds, known, answer = run(folder, cluster.scheduler_address, workers, given.count)
        per_log = serial(paths, folder)
    logs = answer["logs"]
    assert isinstance(logs, list)
    seen = Counter(Path(entry["log"]).name for entry in logs)
    once = sum(seen[p.name] == 1 for p in paths)
    failed = sum(bool(entry.get("error")) for entry in logs)
    rows = [
        ("logs", f"{given.count} of {given.hours:g} h at {given.rate:g} Hz, one gyro each"),
        ("in the result", f"{once} once, {given.count - once} not once; {failed} with an error"),
        ("done before the command was killed", f"{known}; a worker was killed before that"),
        ("time, both runs", f"{seconds:.0f} s, {seconds / given.count:.2f} s a log"),
        ("one process", f"{per_log:.2f} s a log ({len(paths[::EVERY])} logs)"),
        ("speed-up of two workers", speed_up(per_log * given.count / seconds, load)),
    ]
    print("\n".join(f"{name}: {value}" for name, value in rows))
    if given.docs:
        where = f"{measured_at(load)}, `benchmarks/fleet_cluster.py`."
        lines = ["| what | figure |", "|---|---|", *(f"| {a} | {b} |" for a, b in rows), "", where]
        write_table("benchmarks.md", "fleet cluster", "\n".join(lines))
    if once < given.count:
        raise SystemExit(1)


if __name__ == "__main__":
    main()
