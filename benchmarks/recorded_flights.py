"""What `kfgen gap` says of real flights whose logs were changed in a known way: units, axes, outliers, a step, a delay.

Usage: python benchmarks/recorded_flights.py [--docs]

Recordings are open data of other people in ``../shared/data`` (or KFGEN_DATA); what is absent is left out. Each flight is
asked as it is first: what is said then is no answer to a change.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from docs_table import ROOT, measured_at, write_table
from numpy.typing import NDArray

sys.path.insert(0, str(ROOT / "examples" / "recordings"))
import fixed_wing
import fixed_wing_flight
import walk
from common import DATA

import kfgen as kf
from kfgen.core.units import STANDARD_GRAVITY
from kfgen.log.log import Log
from kfgen.model.filter import FilterModel

Array = NDArray[np.float64]
Columns = Mapping[str, Array]
DEGREES = 180.0 / np.pi


@dataclass(frozen=True)
class Change:
    """What is done to a log, and which names say so."""

    words: str
    names: frozenset[tuple[str, str]]
    columns: Callable[[Columns, Array], dict[str, Array]]
    number: str = ""
    planted: float = 0.0


def times(factor: float, *sensors: str) -> Callable[[Columns, Array], dict[str, Array]]:
    """All channels of sensors are so many times as large."""
    return lambda c, t: {n: factor * y for n, y in c.items() if n.startswith(sensors)}


def east_north_up(c: Columns, t: Array) -> dict[str, Array]:
    """East for north, up for down."""
    pairs = [
        (p, a, b, s)
        for p in ("gnss_p", "gnss_v")
        for a, b, s in (("N", "E", 1), ("E", "N", 1), ("D", "D", -1))
    ]
    return {f"{p}_{a}": s * c[f"{p}_{b}"] for p, a, b, s in pairs}


def outliers(c: Columns, t: Array) -> dict[str, Array]:
    """3 % of the positions have errors of 20 m in each axis."""
    rng, out = np.random.default_rng(1123), {}
    for n in (n for n in c if n.startswith("gnss_p")):
        there = np.flatnonzero(np.isfinite(c[n]))
        far = there[rng.random(there.size) < 0.03]
        out[n] = c[n].copy()
        out[n][far] += 20.0 * rng.standard_normal(far.size)
    return out


def later(c: Columns, t: Array) -> dict[str, Array]:
    """All fixes 0.1 s later."""
    rows = round(0.1 / float(np.median(np.diff(t))))
    return {
        n: np.concatenate([np.full(rows, np.nan), y[:-rows]]) for n, y in c.items() if n.startswith("gnss")
    }


def step(c: Columns, t: Array) -> dict[str, Array]:
    """Heights of the receiver are 5 m off from the middle on."""
    return {"gnss_p_D": c["gnss_p_D"] + 5.0 * (t > 0.5 * (t[0] + t[-1]))}


def named(*names: str) -> frozenset[tuple[str, str]]:
    """Effects at places, ``effect place``."""
    return frozenset((n.split()[0], n.split()[1]) for n in names)


ENU = [f"axis_swap gnss_{s}_{a}" for s in "pv" for a in "NE"] + [f"sign_error gnss_{s}_D" for s in "pv"]
LATER = Change(
    "fixes 0.1 s later than they were",
    named("time_delay gnss", "time_delay gnss_p", "time_delay gnss_v"),
    later,
)
CHANGES = (
    Change("accelerometers in g", named("unit_error accel"), times(1.0 / STANDARD_GRAVITY, "accel"), "factor", 1.0 / STANDARD_GRAVITY),
    Change("gyros in degrees a second", named("unit_error gyro"), times(DEGREES, "gyro"), "factor", DEGREES),
    Change("velocities in cm/s", named("unit_error gnss_v"), times(100.0, "gnss_v"), "factor", 100.0),
    Change("east-north-up", named(*ENU), east_north_up),
    Change("gyro_x with the opposite sign", named("sign_error gyro_x"), times(-1.0, "gyro_x")),
    Change("outliers of 20 m in 3 % of the positions", named("outliers gnss_p"), outliers, "sigma", 20.0),
    Change("5 m more of gnss_p_D from the middle on", named("bias_step gnss_p_D"), step, "size", 5.0),
    LATER,
)  # fmt: skip


def flights() -> dict[str, tuple[Log, FilterModel]]:
    """The flights that are here, and their filters."""
    ways: dict[str, tuple[str, Callable[[Path], tuple[Log, FilterModel]]]] = {
        "fixed wing (P. Riseborough)": (
            "dynamic/inertialnav_swisslog1.npz",
            lambda f: (fixed_wing.flight(f)[0], kf.build("ins15", noise=fixed_wing_flight.NOISE)),
        ),
        "walk (T. Everett)": (
            "flights/rtk_walk_imu.csv",
            lambda f: (walk.recorded(f), kf.build("ins15", noise=walk.NOISE)),
        ),
        "replay (PX4-ECL)": (
            "flights/ecl_iris_gps_replay.csv",
            lambda f: (kf.read_log(f), kf.build("ins15")),
        ),
    }
    return {n: way(DATA / f) for n, (f, way) in ways.items() if (DATA / f).is_file()}


def changed(log: Log, change: Change) -> Log:
    """A log after a change."""
    columns = {n: np.array(c.values) for n, c in log.channels.items()}
    new = change.columns(columns, np.asarray(log.t))
    return replace(
        log, channels={n: replace(c, values=new.get(n, columns[n])) for n, c in log.channels.items()}
    )


def row(flight: str, log: Log, model: FilterModel, change: Change, before: set[tuple[str, str]]) -> str:
    """One line of the table."""
    begun = time.perf_counter()
    found = kf.find_gap(changed(log, change), model)
    seconds = time.perf_counter() - begun
    said = {(f.effect.name, f.where): f for f in found.findings}
    right = [said[n] for n in change.names if n in said]
    what = ", ".join(sorted({f.effect.name for f in right})) or "no"
    if right and change.number:
        what += (
            f", {change.number} {float(getattr(right[0].effect, change.number)):.3g} ({change.planted:.3g})"
        )
    others = sum(n not in change.names and n not in before for n in said)
    share = f"{len(right)} of {len(change.names)} " if len(change.names) > 3 else ""
    return f"| {flight} | {change.words} | {share}{what} | {others} | {seconds:.0f} s |"


def main() -> None:
    """Measure, print the table line by line, and write it where that is asked for."""
    load, lines = os.getloadavg()[0], []

    def say(line: str) -> None:
        print(line, flush=True)
        lines.append(line)

    say("| flight | what was done to its log | said (planted) | other new names | |")
    say("|---|---|---|---|---|")
    for flight, (log, model) in flights().items():
        begun = time.perf_counter()
        before = {(f.effect.name, f.where) for f in kf.find_gap(log, model).findings}
        said = ", ".join(f"{e} {w}" for e, w in sorted(before)) or "nothing"
        say(f"| {flight} | nothing | {said} | | {time.perf_counter() - begun:.0f} s |")
        for change in CHANGES:
            say(row(flight, log, model, change, before))
    say(f"\n{measured_at(load)}.")
    if "--docs" in sys.argv[1:]:
        write_table("benchmarks.md", "recorded flights", "\n".join(lines))


if __name__ == "__main__":
    main()
