"""Does ``kfgen gap`` stay silent on a log of the very model? Every library model in every manoeuvre.

Usage: python benchmarks/gap_silence.py [--seeds 20] [--models NAMES] [--manoeuvres NAMES] [--first SEED] [--minutes M] [--docs]

Each log is simulated from the model's continuous truth for 20 s at 50 Hz, every aiding sensor at its own rate. Whatever
the gap names in it, and whatever it calls unknown, is a false alarm. ``--docs`` writes the table into the page.
"""

from __future__ import annotations

import argparse
import math
import os
import sys
import time
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from itertools import product
from multiprocessing import get_context

from docs_table import write_table

DURATION_S, RATE_HZ = 20.0, 50.0


@dataclass(frozen=True)
class Answer:
    """What the gap said of one simulated log; nothing where it was silent."""

    model: str
    manoeuvre: str
    seed: int
    said: str


def ask(case: tuple[str, str, int]) -> Answer:
    """Simulate a log of a model and compare it with that model."""
    import warnings

    import numpy as np

    from kfgen.core.errors import KfgenError
    from kfgen.gap.core.result import NO_GAP
    from kfgen.gap.find_gap import find_gap
    from kfgen.model.discretise import DiscreteModel
    from kfgen.model.library import build
    from kfgen.simulate.simulate import simulate

    name, manoeuvre, seed = case
    warnings.simplefilter("ignore")
    model = build(name)
    try:
        discrete = DiscreteModel.at_rate(model, RATE_HZ)
        log = simulate(discrete, manoeuvre, DURATION_S, np.random.default_rng(seed))
        found = find_gap(log, model)
    except KfgenError as error:
        return Answer(name, manoeuvre, seed, f"refused: {error}")
    names = [f"{f.name} of {f.where}, {f.probability:.3f}" for f in found.findings]
    said = "" if found.verdict == NO_GAP else "; ".join([found.verdict, *names])
    return Answer(name, manoeuvre, seed, said)


def table(answers: list[Answer]) -> str:
    """False alarms of each model, and which."""
    alarms = [a for a in answers if a.said and not a.said.startswith("refused")]
    refused = Counter((a.model, a.said) for a in answers if a.said.startswith("refused"))
    asked = Counter(a.model for a in answers if not a.said.startswith("refused"))
    manoeuvres = {a.model: len({b.manoeuvre for b in answers if b.model == a.model}) for a in answers}
    lines = ["| model | logs | manoeuvres | false alarms |", "|---|---|---|---|"]
    for name, n in asked.items():
        lines.append(f"| `{name}` | {n} | {manoeuvres[name]} | {sum(a.model == name for a in alarms)} |")
    n = sum(asked.values())
    lines += [f"| all | {n} | | {len(alarms)} ({100 * len(alarms) / max(n, 1):.1f} %) |"]
    lines += [f"\n`{a.model}`, {a.manoeuvre}, seed {a.seed}: {a.said}." for a in alarms]
    lines += [
        f"\n`{model}`, {count} logs {said.partition('. ')[0]}." for (model, said), count in refused.items()
    ]
    return "\n".join(lines)


def main() -> None:
    """Run the benchmark."""
    from kfgen.manoeuvre.library import LIBRARY as MANOEUVRES
    from kfgen.model.library import LIBRARY

    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seeds", type=int, default=20, help="logs of each model in each manoeuvre")
    parser.add_argument("--first", type=int, default=0, help="the first seed")
    parser.add_argument("--models", default=",".join(LIBRARY))
    parser.add_argument("--manoeuvres", default=",".join(MANOEUVRES))
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument(
        "--minutes", type=float, default=math.inf, help="stop after so long, with what was asked by then"
    )
    parser.add_argument("--docs", action="store_true", help="write the table into docs/benchmarks.md")
    wanted = parser.parse_args()
    seeds = range(wanted.first, wanted.first + wanted.seeds)
    cases = [(m, p, s) for s, p, m in product(seeds, wanted.manoeuvres.split(","), wanted.models.split(","))]
    for library in ("OPENBLAS", "OMP", "MKL"):
        os.environ[f"{library}_NUM_THREADS"] = "1"
    answers = []
    started = time.monotonic()
    with ProcessPoolExecutor(wanted.jobs, mp_context=get_context("spawn")) as pool:
        for k, answer in enumerate(pool.map(ask, cases), start=1):
            answers.append(answer)
            if answer.said:
                print(
                    f"{k}/{len(cases)} {answer.model} {answer.manoeuvre} {answer.seed}: {answer.said}",
                    file=sys.stderr,
                    flush=True,
                )
            if time.monotonic() - started > 60.0 * wanted.minutes:
                pool.shutdown(cancel_futures=True)
                break
    text = table(answers)
    print(text)
    if wanted.docs:
        write_table("benchmarks.md", "silence", text)


if __name__ == "__main__":
    main()
