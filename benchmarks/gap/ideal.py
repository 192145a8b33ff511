"""What an ideal analyst would name in the records of the blind benchmark: nobody can do better.

Usage: python benchmarks/gap/ideal.py [--world static] [--count K] [--strength 100,30,10] [--nulls N] [--seed S]
       [--size known|unknown] [--laws drawn|wide] [--calm M] [--jobs 2] [--beside SCORES] [--json FILE] [--docs]

The analyst knows what no user knows: the numbers of the sensor, motion or plant, the catalogue, how its parameters were
drawn, and, with the size known, how many nats the hidden effect is worth; with the size unknown, strengths of 5 to 160 nats
are equally likely (in logarithm) before. With wide laws, for sensors at rest, he knows of the parameters only what a record
can show at all, as somebody who met the sensor today. The name is the likeliest, the printed set the smallest that holds the
truth in 98 % of the cases. Whether something is hidden at all is decided by the likelihood of the record, averaged over
all effects: the threshold is the one that one in 200 of `calm` records at rest without an effect exceeds, drawn for it
alone, and elsewhere 200, which is exceeded no oftener. Nothing of kfgen is asked.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import numpy as np

sys.path.append(str(Path(__file__).resolve().parents[1]))

import ideal_motion
import ideal_plant
import ideal_rest
from case import OBVIOUS, Request
from docs_table import write_table
from ideal_laws import LAWS
from judgement import Judgement, sets_that_hold, together
from tables import share
from trial import world

WORLDS = ("static", "real", "motion", "plant")
"""As the benchmark counts them: the seeds depend on it."""
AT_REST = ("static", "real")
JUDGES: Mapping[str, Callable[[Request, float], Judgement]] = {
    "motion": ideal_motion.judged,
    "plant": ideal_plant.judged,
}
STRENGTHS = (5.0, 10.0, 20.0, 40.0, 80.0, 160.0)
"""Nats, equally likely before, where the size is not known."""
ANY_STRENGTH = 0.0
"""Of records without an effect, where the size is not known."""
FALSE_ALARMS = 0.005
HELD = 0.98
"""Share of the truths that the sets should hold."""
HEAD = [
    "| X | named right, told that something is hidden | found | found and named right | names in the set, and sets that"
    " hold the truth | kfgen gap |",
    "|---|---|---|---|---|---|",
]
Scores = Mapping[str, bool]


def judged(asked: tuple[Request, float, str]) -> Judgement:
    """By the analyst of its world."""
    request, X, laws = asked
    if request.world in AT_REST:
        return ideal_rest.judged(request, X, LAWS[laws])
    return JUDGES[request.world](request, X)


def judgements(requests: Sequence[Request], jobs: int, size_known: bool, laws: str) -> list[Judgement]:
    """In the order of sensors and strengths, so that what is reckoned for one is not reckoned again."""
    asked = [
        (k, X)
        for k, r in enumerate(requests)
        for X in ((r.strength,) if size_known or r.strength >= OBVIOUS else STRENGTHS)
    ]
    asked.sort(key=lambda a: (requests[a[0]].index % 12, a[1]))
    done: dict[int, list[Judgement]] = {}
    with ProcessPoolExecutor(jobs, mp_context=get_context("spawn")) as pool:
        found = pool.map(judged, [(requests[k], X, laws) for k, X in asked], chunksize=4)
        for (k, _), judgement in zip(asked, found):
            done.setdefault(k, []).append(judgement)
    return [together(done[k]) for k in range(len(requests))]


def threshold_of(X: float, calm: Sequence[Judgement]) -> float:
    """Evidence [nats] above which something is said to be hidden; those that serve any strength count, too."""
    quiet = [j.evidence for j in calm if j.request.strength in (X, ANY_STRENGTH)]
    return float(np.quantile(quiet, 1.0 - FALSE_ALARMS)) if quiet else -float(np.log(FALSE_ALARMS))


def row(X: float, singles: Sequence[Judgement], threshold: float, other: Scores) -> str:
    """Of one strength."""
    at = [j for j in singles if j.request.strength == X]
    said = [j for j in at if j.evidence > threshold]
    sizes, hold = sets_that_hold(HELD, said)
    cells = [f"{X:g}" if X < OBVIOUS else "size people meet", share(j.right for j in at)]
    cells += [share(j.evidence > threshold for j in at)]
    cells += [share(j.right and j.evidence > threshold for j in at)]
    cells += [f"{np.mean(sizes):.2f}; {share(hold)}"]
    cells.append(share(other[j.request.id] for j in at) if other else "-")
    return "| " + " | ".join(cells) + " |"


def calm_requests(seed: int, strengths: Sequence[float], count: int) -> list[Request]:
    """Records at rest in which nothing is hidden, for the threshold of each strength."""
    seeds = np.random.default_rng([seed, 9]).integers(2**47, size=count)
    return [Request("static", "null", (), X, i, int(s)) for X in strengths for i, s in enumerate(seeds)]


def arguments() -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(prog="benchmarks/gap/ideal.py")
    parser.add_argument("--world", default="static", choices=WORLDS)
    parser.add_argument("--count", type=int, default=4)
    parser.add_argument("--strength", default="100,30,10", help="nats")
    parser.add_argument("--nulls", type=int, default=20, help="as for the benchmark: the seeds depend on it")
    parser.add_argument("--seed", type=int, default=20260101)
    parser.add_argument("--size", choices=("known", "unknown"), default="known")
    parser.add_argument("--laws", choices=tuple(LAWS), default="drawn", help="of the parameters, at rest")
    parser.add_argument("--calm", type=int, default=200, help="records without an effect, for the threshold")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument(
        "--beside", type=Path, help="the file that --json of the benchmark wrote for these cases"
    )
    parser.add_argument("--json", type=Path, help="every judgement")
    parser.add_argument("--docs", action="store_true", help="write the table into the documentation")
    wanted = parser.parse_args()
    if wanted.laws != "drawn" and wanted.world not in AT_REST:
        parser.error(f"--laws {wanted.laws} is for {' and '.join(AT_REST)}; leave it out for {wanted.world}")
    return wanted


def main() -> None:
    """Judge the cases of the benchmark."""
    wanted = arguments()
    strengths = tuple(float(x) for x in wanted.strength.split(","))
    rng = np.random.default_rng([wanted.seed, WORLDS.index(wanted.world)])
    drawn = world(wanted.world).requests(wanted.count, strengths, wanted.nulls, rng)
    work = [r for r in drawn if r.kind == "single"]
    size_known = wanted.size == "known"
    of = (strengths if size_known else (ANY_STRENGTH,)) if wanted.world == "static" else ()
    calm = calm_requests(wanted.seed, of, wanted.calm)
    done = judgements([*work, *calm], wanted.jobs, size_known, wanted.laws)
    singles, quiet = done[: len(work)], done[len(work) :]
    other = {}
    if wanted.beside:
        scores = json.loads(wanted.beside.read_text(encoding="utf-8"))["scores"]
        other = {s["id"]: bool(s["right_first"]) for s in scores}
    every = sorted({r.strength for r in work}, reverse=True)
    lines = [*HEAD, *(row(X, singles, threshold_of(X, quiet), other) for X in every)]
    print("\n".join(lines))
    if wanted.docs:
        command = (
            f"`python benchmarks/gap/ideal.py --world {wanted.world} --count {wanted.count} "
            f"--strength {wanted.strength}\n--nulls {wanted.nulls} --seed {wanted.seed} "
            f"--size {wanted.size} --laws {wanted.laws} --calm {wanted.calm} --docs`"
        )
        knows = f"size {wanted.size}" + (", wide laws" if wanted.laws == "wide" else "")
        write_table(
            "benchmarks.md",
            f"ideal {wanted.world}, {knows}",
            "\n".join([*lines, "", f"Drawn by\n{command}."]),
        )
    if wanted.json:
        wanted.json.write_text(json.dumps([_plain(j) for j in done], indent=1), encoding="utf-8")


def _plain(j: Judgement) -> dict[str, object]:
    """As data for a file."""
    r = j.request
    logs = {"+".join(sorted(k)): v for k, v in j.logs.items()}
    return {
        "id": r.id,
        "effects": r.effects,
        "right": sorted(j.truth),
        "strength": r.strength,
        "evidence": j.evidence,
        "names": j.names,
        "logs": logs,
    }


if __name__ == "__main__":
    main()
