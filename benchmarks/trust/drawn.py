"""Draws records without a hidden effect, and with one, in every world, and keeps what `find_gap` says of each.

Usage: python benchmarks/trust/drawn.py RECORD.jsonl [--minutes 60] [--share 1.0]

The record grows by a line for each, so that a run goes on where an earlier one ended; `benchmarks/trust/nulls.py
RECORD.jsonl` counts it. Sensors at rest, sensors that move and plants are those of `benchmarks/gap`, the first in
short records; flights are those of `benchmarks/flight`. All worlds grow at the same pace.
"""

from __future__ import annotations

import argparse
import importlib
import json
import sys
import time
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "benchmarks" / "gap"), str(ROOT)]

import motion  # noqa: E402
import plant  # noqa: E402
import static  # noqa: E402
from case import Case, Request  # noqa: E402
from score import score  # noqa: E402

from kfgen.core.errors import KfgenError  # noqa: E402

SEED = 20261123
SAMPLES_AT_REST = 4000
FLIGHT_S = 60.0
STRENGTHS = (100.0, 30.0)
"""Of the planted effects [nats], in turn."""
COUNTS = {
    ("sensors at rest, short records", "null"): 2400,
    ("sensors at rest, short records", "single"): 160,
    ("moving sensors", "null"): 120,
    ("moving sensors", "single"): 90,
    ("plants", "null"): 45,
    ("flights without a reference", "null"): 24,
}
"""Records of each world and kind in a whole run."""
MADE: dict[str, tuple[str, tuple[str, ...], Callable[[Request], Case]]] = {
    "sensors at rest, short records": (
        "static",
        tuple(n for n in static.EFFECTS if n != "cross_axis_noise"),
        lambda request: static.make(request, SAMPLES_AT_REST),
    ),
    "moving sensors": ("motion", tuple(motion.EFFECTS), motion.make),
    "plants": ("plant", (), plant.make),
}
"""By world: its name in requests, the effects that are planted in turn, and how a record is made."""


def answered(case: Case) -> dict[str, Any]:
    """What `find_gap` says of a case; a refusal is an answer."""
    from kfgen.effects.noise_model import parse_noise
    from kfgen.gap.find_gap import find_gap
    from kfgen.log.log import Channel, Log
    from kfgen.model.plant.file import parse_model

    log = Log(case.t, {name: Channel.of(v, unit) for name, (v, unit) in case.channels.items()}, "record")
    try:
        parse = parse_model if "[states" in case.model else parse_noise
        return find_gap(log, parse(case.model, "model")).to_dict()
    except KfgenError as error:
        return {"error": str(error)}


def of_case(world: str, kind: str, k: int) -> dict[str, Any]:
    """The line of a record of `benchmarks/gap`."""
    name, effects, make = MADE[world]
    planted = (effects[k % len(effects)],) if kind == "single" else ()
    strength = STRENGTHS[k // len(effects) % len(STRENGTHS)] if planted else 0.0
    index = k // len(effects) if planted else k
    seed = seed_of(world, kind, k)
    case = make(Request(name, kind, planted, strength, index, seed))
    found = score(case.truth(), answered(case), 0.0)
    said = ", ".join(found.named) or found.first
    return {"exact": found.exact, "covered": found.covered, "said": said, "error": found.error}


def of_flight(kind: str, k: int) -> dict[str, Any]:
    """The line of a flight without an effect."""
    folder = str(ROOT / "benchmarks" / "flight")
    # Both benchmarks have a module `trial`.
    sys.modules.pop("trial", None)
    sys.path.insert(0, folder)
    try:
        trial = importlib.import_module("trial")
        vehicles = list(importlib.import_module("vehicle").VEHICLES)
        found = trial.run(
            trial.Case(
                vehicles[k % len(vehicles)],
                seed_of("flights", kind, k) % 2**31,
                FLIGHT_S,
            )
        )
    finally:
        sys.path.remove(folder)
    error = found.verdict if found.verdict.startswith("error") else ""
    said = ", ".join(found.findings) or found.verdict
    return {"exact": found.verdict == "no_gap", "covered": [], "said": said, "error": error}


def seed_of(world: str, kind: str, k: int) -> int:
    """A seed that is the same in every run."""
    import numpy as np

    words = [SEED, *world.encode(), *kind.encode(), k]
    return int(np.random.default_rng(words).integers(2**47))


def wanted(share: float) -> Iterator[tuple[str, str, int]]:
    """Worlds, kinds and numbers, each kind evenly spread over the run."""
    every = [
        (world, kind, k, (k + 0.5) / n)
        for (world, kind), n in COUNTS.items()
        for k in range(round(share * n))
    ]
    yield from (one[:3] for one in sorted(every, key=lambda one: one[3]))


def main() -> int:
    """Draw until all is there or the time is over."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("record", type=Path, help="lines of JSON; it grows")
    parser.add_argument("--minutes", type=float, default=60.0, help="of the processor")
    parser.add_argument("--share", type=float, default=1.0, help="of all records")
    given = parser.parse_args()
    warnings.simplefilter("ignore")
    known = {
        (line["world"], line["kind"], line["k"])
        for text in (given.record.read_text("utf-8").splitlines() if given.record.is_file() else ())
        for line in [json.loads(text)]
    }
    for world, kind, k in wanted(given.share):
        if (world, kind, k) in known:
            continue
        if time.process_time() > 60.0 * given.minutes:
            break
        begun = time.process_time()
        line = of_case(world, kind, k) if world in MADE else of_flight(kind, k)
        line = {"world": world, "kind": kind, "k": k, **line, "seconds": time.process_time() - begun}
        with given.record.open("a", encoding="utf-8") as file:
            file.write(json.dumps(line) + "\n")
        if line["error"] or (kind == "null" and not line["exact"]):
            print(f"{world}, {kind} {k}: {line['said']} {line['error']}", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
