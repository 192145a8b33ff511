"""The gap of a filter in flight, measured blind: does kfgen name what a flight hides, and nothing where nothing is?

Usage: python benchmarks/flight [--count K] [--nulls N] [--stacks M] [--strength 100,30,10] [--seed S] [--jobs 2] [--duration 120] [--docs]

Flights of four vehicles are simulated by plain numpy (`vehicle.py`, `flight.py`); kfgen gets the log and a filter of 16
states with GNSS, magnetometer and barometer, without any reference. An effect's size is drawn so that it is worth X nats
on its own flight: half its squared length in the innovations of that flight without it. A random error's is the one with
which the filter that has it, of its true numbers, gains X nats of log-likelihood on that flight over the one without.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, replace
from multiprocessing import get_context
from pathlib import Path

import numpy as np
from flight import AXES, DRIVEN, LEVEL, SHAKEN
from table import table
from trial import Case, run
from vehicle import VEHICLES

sys.path.insert(0, str(Path(__file__).parents[1]))
from docs_table import write_table

HIDDEN: tuple[tuple[str, str, tuple[str, ...]], ...] = (
    ("time_delay", "gnss_p", ("delay",)),
    ("time_delay", "gnss_v", ("delay",)),
    ("time_delay", "gnss", ("delay",)),
    ("time_delay", "mag", ("delay",)),
    ("time_delay", "baro", ("delay",)),
    ("clock_drift", "gnss", ("rate",)),
    ("lever_arm", "gnss", ("x", "y", "z")),
    *(("scale_factor", f"gyro_{a}", ("coefficient",)) for a in AXES),
    *(("scale_factor", f"accel_{a}", ("coefficient",)) for a in AXES),
    ("scale_factor", "baro", ("coefficient",)),
    ("static_pressure_error", "baro", ("coefficient",)),
    ("misalignment", "gyro_x", ("xz",)),
    ("misalignment", "gyro_y", ("yx",)),
    ("misalignment", "accel_x", ("xy",)),
    ("misalignment", "accel_z", ("zx",)),
    ("g_sensitivity", "gyro_x", ("xx",)),
    ("g_sensitivity", "gyro_z", ("zy",)),
    ("temperature", "gyro_y", ("coefficient",)),
    ("supply_current", "mag_x", ("coefficient",)),
    ("supply_current", "mag_z", ("coefficient",)),
    ("coupling:throttle", "baro", ("coefficient",)),
    ("rate_ramp", "gyro_z", ("R",)),
    *(("bias_step", c, ("size",)) for c in ("gyro_y", "accel_x", "baro", "gnss_p_E", "mag_x")),
    ("hard_iron", "mag", ("x", "y", "z")),
    ("declination", "mag", ("angle",)),
    ("mounting", "mag", ("x", "y", "z")),
    (
        "soft_iron",
        "mag",
        ("xx", "yy", "xy", "xz", "yz"),
    ),  # the common scale is that of the field, which nobody knows
    *((SHAKEN, c, ("slope",)) for c in ("accel", "gyro")),
    *(("rate_random_walk", c, ("K",)) for c in ("gyro_z", "accel_x", "baro")),
    *(("gauss_markov", c, ("sigma",)) for c in ("gnss_p_N", "gnss_v_E", "baro", "mag_x")),
)
CORRELATION_TIME_S = 8.0
"""Of the Gauss-Markov errors."""
EXCITED_BY = {
    ("", "accel_x"): ("wing", "car"),
    ("", "accel_y"): ("car",),
    ("misalignment", "accel_x"): ("car",),
    ("misalignment", "accel_z"): ("wing", "car"),
    ("g_sensitivity", "gyro_x"): ("wing", "car"),
    ("g_sensitivity", "gyro_z"): ("car",),
}
"""Vehicles whose motion shows an effect, where not all do: nothing pushes a hovering body sideways."""
STACK_NATS = 100.0
"""What each effect of a pair or a triple is worth alone."""
OUTSIDE_OF_THE_CATALOGUE = ("magnet", "sine_baro", "smoothed_gnss")


def _able(name: str, where: str) -> tuple[str, ...]:
    """Vehicles whose motion shows an effect; a walker shows little of most."""
    all_but_walker = tuple(v for v in VEHICLES if v != "walker")
    return EXCITED_BY.get((name, where), EXCITED_BY.get(("", where), all_but_walker))


def _single(rng: np.random.Generator, i: int, k: int, X: float, duration_s: float) -> Case:
    """The effect `i` alone, on the `k`th vehicle that shows it."""
    name, where, parameters = HIDDEN[i]
    able = _able(name, where)
    fixed: tuple[tuple[str, float], ...] = ()
    fixed += (("time", duration_s * float(rng.uniform(0.3, 0.7))),) if name == "bias_step" else ()
    fixed += (("tau", CORRELATION_TIME_S),) if name == "gauss_markov" else ()
    fixed += (("reference", LEVEL[DRIVEN[name]]),) if name in DRIVEN else ()
    case = Case(able[(i + k) % len(able)], int(rng.integers(2**31)), duration_s, X, name, where, parameters)
    return replace(case, fixed=fixed)


def _several(rng: np.random.Generator, size: int, X: float, duration_s: float) -> Case:
    """So many effects of different kinds or places that one vehicle shows."""
    vehicle = str(rng.choice([v for v in VEHICLES if v != "walker"]))
    shown = [i for i, (name, where, _) in enumerate(HIDDEN) if vehicle in _able(name, where)]
    each = [_single(rng, int(i), 0, X, duration_s) for i in rng.choice(shown, size, replace=False)]
    first, *others = [replace(c, vehicle=vehicle, seed=each[0].seed) for c in each]
    return replace(first, beside=tuple(others))


def cases(
    count: int, strengths: Sequence[float], nulls: int, stacks: int, seed: int, duration_s: float
) -> list[Case]:
    """All cases, the vehicles in turn."""
    rng = np.random.default_rng(seed)
    out = [
        _single(rng, i, k, X, duration_s) for X in strengths for k in range(count) for i in range(len(HIDDEN))
    ]
    every = list(VEHICLES)
    out += [Case(every[k % len(every)], int(rng.integers(2**31)), duration_s) for k in range(nulls)]
    for k in range(3 * count):
        unlisted = OUTSIDE_OF_THE_CATALOGUE[k % len(OUTSIDE_OF_THE_CATALOGUE)]
        out.append(Case("quadrotor", int(rng.integers(2**31)), duration_s, unlisted=unlisted))
    return out + [_several(rng, size, STACK_NATS, duration_s) for size in (2, 3) for _ in range(stacks)]


def main() -> None:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--count", type=int, default=1, help="flights of each effect and strength")
    parser.add_argument("--nulls", type=int, default=12)
    parser.add_argument("--strength", default="100,30,10", help="nats")
    parser.add_argument("--stacks", type=int, default=6, help="pairs, and as many triples")
    parser.add_argument("--seed", type=int, default=20260101)
    parser.add_argument("--duration", type=float, default=120.0, help="of a flight [s]")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--json", type=Path, help="every score")
    parser.add_argument("--docs", action="store_true", help="write the table into docs/benchmarks.md")
    wanted = parser.parse_args()
    strengths = [float(x) for x in wanted.strength.split(",") if x]
    drawn = cases(wanted.count, strengths, wanted.nulls, wanted.stacks, wanted.seed, wanted.duration)
    for library in ("OPENBLAS", "OMP", "MKL"):
        os.environ[f"{library}_NUM_THREADS"] = "1"
    scores = []
    with ProcessPoolExecutor(wanted.jobs, mp_context=get_context("spawn")) as pool:
        for k, s in enumerate(pool.map(run, drawn), start=1):
            scores.append(s)
            c = s.case
            hidden = " + ".join(e.label for e in (c, *c.beside))
            what = f"{hidden} {c.strength:g}" if c.effect else c.unlisted or "nothing"
            print(f"{k}/{len(drawn)} {c.vehicle} {what}: {s.verdict} {list(s.findings)} {s.probability:.3f} "
                  f"{s.covered} {s.seconds:.0f} s", file=sys.stderr, flush=True)  # fmt: skip
    text = table(scores)
    print(text)
    if wanted.json:
        wanted.json.write_text(json.dumps([asdict(s) for s in scores], indent=1), encoding="utf-8")
    if wanted.docs:
        write_table("benchmarks.md", "flight", text)


if __name__ == "__main__":
    main()
