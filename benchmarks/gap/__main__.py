"""The blind benchmark of ``kfgen gap``: does it name what is hidden?

Usage: python benchmarks/gap [--world static,motion,plant] [--count K] [--strength 100,30,10] [--only NAMES]
       [--nulls N] [--fresh | --seed S] [--jobs 2] [--keep DIR] [--json FILE]

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
from dataclasses import replace
from pathlib import Path
from typing import Any

for _library in ("OPENBLAS", "OMP", "MKL"):
    os.environ.setdefault(f"{_library}_NUM_THREADS", "1")

import numpy as np
from baseline import said
from case import Case, Request
from score import Score, score
from tables import report

WORLDS = ("static", "motion", "plant")
SEED = 20260101


def world(name: str) -> Any:
    """The module of a world: ``requests`` and ``make``."""
    import importlib

    return importlib.import_module(name)


def ask(place: Path, answer: Path) -> dict[str, Any]:
    """Let the command line answer; a failure is an answer too."""
    from kfgen.cli.app import app
    from typer.testing import CliRunner

    words = ["gap", str(place / "log.csv"), "--model", str(place / "model.toml"), "--json", str(answer)]
    try:
        result = CliRunner().invoke(app, words)
    except Exception as error:
        return {"error": f"{type(error).__name__}: {error}"}
    if answer.is_file():
        return dict(json.loads(answer.read_text(encoding="utf-8")))
    failure = result.exception if result.exception is not None else result.output
    return {"error": f"{type(failure).__name__}: {failure}".replace("\n", " ")}


def run(request: Request, folder: Path) -> Score:
    """Make, write, ask, score."""
    cases, truths, answers = folder / "cases", folder / "truths", folder / "answers"
    answers.mkdir(parents=True, exist_ok=True)
    case: Case = world(request.world).make(request)
    place = case.write(cases, truths)
    start = time.perf_counter()
    answer = ask(place, answers / f"{request.id}.json")
    seconds = time.perf_counter() - start
    truth = json.loads((truths / f"{request.id}.json").read_text(encoding="utf-8"))
    result = score(truth, answer, seconds)
    if case.base:
        y = next(iter(case.channels.values()))[0]
        aic, bic = said(y, float(np.median(np.diff(case.t))), case.base)
        result = replace(result, allan_aic=aic, allan_bic=bic)
    return result


def collect(requests: Sequence[Request], folder: Path, jobs: int, tell: Callable[[str], None]) -> list[Score]:
    """All cases, in a pool of processes; the order is that of the requests."""
    done: dict[str, Score] = {}
    with ProcessPoolExecutor(jobs) as pool:
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
    return parser.parse_args()


def main() -> None:
    """Run the benchmark."""
    wanted = arguments()
    seed = secrets.randbelow(2**31) if wanted.fresh else wanted.seed
    strengths = tuple(float(x) for x in wanted.strength.split(","))
    only = {n for n in wanted.only.split(",") if n}
    nulls = 5 * wanted.count if wanted.nulls is None else wanted.nulls
    everything: list[Score] = []
    for name in wanted.world.split(","):
        if name not in WORLDS:
            sys.exit(f"no world '{name}': there are {', '.join(WORLDS)}")
        drawn = world(name).requests(
            wanted.count, strengths, nulls, np.random.default_rng([seed, WORLDS.index(name)])
        )
        chosen = [
            r for r in drawn if not only or r.kind in only or (r.kind == "single" and only & set(r.effects))
        ]
        with tempfile.TemporaryDirectory() as temporary:
            folder = wanted.keep / name if wanted.keep else Path(temporary)
            start = time.perf_counter()
            tell: Callable[[str], None] = lambda line: print(line, file=sys.stderr, flush=True)
            scores = collect(chosen, folder, wanted.jobs, tell)
        print(f"\n{name}: {len(scores)} cases, seed {seed}, {time.perf_counter() - start:.0f} s\n")
        print(report(scores), flush=True)
        everything += scores
    if wanted.json:
        record = {"seed": seed, "count": wanted.count, "scores": [s.plain for s in everything]}
        wanted.json.write_text(json.dumps(record, indent=1), encoding="utf-8")


if __name__ == "__main__":
    main()
