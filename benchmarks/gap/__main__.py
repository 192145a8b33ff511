"""The blind benchmark of ``kfgen gap``: does it name what is hidden?

Usage: python benchmarks/gap [--world static,real,motion,plant,recorded] [--count K] [--strength 100,30,10] [--only NAMES]
       [--nulls N] [--fresh | --seed S] [--jobs 2] [--keep DIR] [--json FILE] [--docs]

Records are made by numpy and scipy alone; the command line of kfgen sees a log and a model file; the
truth lies elsewhere and is read afterwards.
"""

from __future__ import annotations

import argparse
import json
import os
import secrets
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context
from pathlib import Path

import numpy as np

sys.path.append(str(Path(__file__).resolve().parents[1]))

from case import Request
from docs_table import write_table
from recorded_table import recorded_table
from score import Score
from tables import report
from trial import run, world
from worlds_table import unknown_table, worlds_table

WORLDS = ("static", "real", "motion", "plant", "recorded")
SEED = 20260101


def collect(requests: Sequence[Request], folder: Path, jobs: int, tell: Callable[[str], None]) -> list[Score]:
    """All cases, in a pool of processes; the order is that of the requests."""
    done: dict[str, Score] = {}
    for library in ("OPENBLAS", "OMP", "MKL"):
        os.environ[f"{library}_NUM_THREADS"] = "1"
    with ProcessPoolExecutor(jobs, mp_context=get_context("spawn")) as pool:
        waiting = {pool.submit(run, r, folder): r for r in requests}
        for future in as_completed(waiting):
            r = waiting[future]
            done[r.id] = future.result()
            s = done[r.id]
            tell(
                f"{len(done)}/{len(requests)} {r.kind} {s.cell} {r.strength:g}: {s.verdict} {s.first} {s.seconds:.1f} s"
            )
    return [done[r.id] for r in requests]


def arguments() -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(
        prog="benchmarks/gap", description=__doc__.splitlines()[0] if __doc__ else None
    )
    parser.add_argument("--world", default="static", help="separated by commas: " + ", ".join(WORLDS))
    parser.add_argument("--count", type=int, default=4, help="cases per cell (four times as many stacks)")
    parser.add_argument("--strength", default="100,30,10", help="nats")
    parser.add_argument("--only", default="", help="effects, or kinds (null, pair, unknown, …)")
    parser.add_argument("--nulls", type=int, help="null records; five per case of a cell by default")
    parser.add_argument("--seed", type=int, default=SEED)
    parser.add_argument("--fresh", action="store_true", help="draw a seed; it is printed")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--keep", type=Path, help="folder of logs, truths and answers")
    parser.add_argument("--json", type=Path, help="every score")
    parser.add_argument(
        "--docs", action="store_true", help="write the tables of these worlds into the documentation"
    )
    return parser.parse_args()


def _tell(line: str) -> None:
    print(line, file=sys.stderr, flush=True)


def main() -> None:
    """Run the benchmark."""
    wanted = arguments()
    seed = secrets.randbelow(2**31) if wanted.fresh else wanted.seed
    strengths = tuple(float(x) for x in wanted.strength.split(","))
    only = {n for n in wanted.only.split(",") if n}
    nulls = 5 * wanted.count if wanted.nulls is None else wanted.nulls
    everything: list[Score] = []
    load = os.getloadavg()[0]
    for name in wanted.world.split(","):
        if name not in WORLDS:
            sys.exit(f"no world '{name}': there are {', '.join(WORLDS)}")
        drawn = world(name).requests(
            wanted.count, strengths, nulls, np.random.default_rng([seed, WORLDS.index(name)])
        )
        chosen = [
            r for r in drawn if not only or r.kind in only or (len(r.effects) == 1 and only & set(r.effects))
        ]
        with tempfile.TemporaryDirectory() as temporary:
            folder = wanted.keep / name if wanted.keep else Path(temporary)
            start = time.perf_counter()
            scores = collect(chosen, folder, wanted.jobs, _tell)
        print(f"\n{name}: {len(scores)} cases, seed {seed}, {time.perf_counter() - start:.0f} s\n")
        print(report(scores), flush=True)
        everything += scores
        if wanted.docs and name == "recorded":
            write_table("benchmarks.md", "recorded", recorded_table(scores, seed, load))
        elif wanted.docs and only == {"unknown"}:
            drawn_by = f"--only unknown --count {wanted.count} --nulls {nulls} --seed {seed}"
            write_table("benchmarks.md", "gap unknown", unknown_table(scores, drawn_by, load))
        elif wanted.docs:
            drawn_by = f"--count {wanted.count} --strength {wanted.strength} --nulls {nulls} --seed {seed}"
            write_table("benchmarks.md", f"gap {name}", worlds_table(name, scores, drawn_by, load))
    if wanted.json:
        record = {"seed": seed, "count": wanted.count, "scores": [s.plain for s in everything]}
        wanted.json.write_text(json.dumps(record, indent=1), encoding="utf-8")


if __name__ == "__main__":
    main()
